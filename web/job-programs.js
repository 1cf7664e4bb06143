/** The files that a packing gives, by the program that reads them (docs/models.md). */

/**
 * A file that is made on request.
 * @typedef {object} File
 * @property {string} type of the export
 * @property {string} format
 * @property {string} words what it is
 * @property {Record<string, string>} [set] options that make it this file
 * @property {string} [note] what to know before it is made
 * @property {boolean} [surface] whether it has surfaces and no solid elements
 */

/**
 * A program, its formats of the grains, and the files that are made for it.
 * @typedef {{name: string, grains: [string, string][], files: File[]}} Program
 * @type {Program[]}
 */
export const PROGRAMS = [
  {
    name: "Abaqus and CalculiX",
    grains: [],
    files: [
      {
        type: "deck",
        format: "zip",
        words: "Model that runs as it is",
        note:
          "Mesh, materials, supports, load and output. Unpack it, then run ccx model in its folder, or packstone solve " +
          "on the zip, which also computes the property.",
      },
      { type: "mesh", format: "inp", words: "Solid mesh: tetrahedra", note: "Made by Gmsh, with sets by phase." },
      { type: "voxels", format: "inp", words: "Solid mesh: hexahedra, one for each voxel" },
      { type: "slice", format: "inp", words: "Cut: triangles for plane stress or strain" },
    ],
  },
  {
    name: "Gmsh",
    grains: [],
    files: [
      { type: "mesh", format: "msh", words: "Solid mesh: tetrahedra", set: { elements: "tetrahedra" } },
      { type: "mesh", format: "msh", words: "Surface mesh", surface: true },
      { type: "mesh", format: "geo", words: "Script with the exact shapes" },
      { type: "mesh", format: "med", words: "Solid mesh for Salome and Code_Aster" },
      { type: "slice", format: "msh", words: "Cut: triangles" },
      { type: "slice", format: "geo", words: "Cut: script with the exact outlines" },
    ],
  },
  {
    name: "ParaView",
    grains: [
      ["vtp", "grains"],
      ["vtk", "grains, legacy form"],
    ],
    files: [
      { type: "voxels", format: "vti", words: "Voxels" },
      { type: "mesh", format: "vtu", words: "Solid mesh: tetrahedra" },
      { type: "slice", format: "vtu", words: "Cut: triangles" },
      { type: "properties", format: "vti", words: "Fields of stress and strain" },
    ],
  },
  {
    name: "Chrono",
    grains: [],
    files: [
      { type: "ldpm", format: "chrono", words: "Lattice discrete particle model" },
      { type: "ldpm", format: "tets", words: "Its tetrahedra, for ParaView" },
      { type: "ldpm", format: "facets", words: "Its facets, for ParaView" },
      { type: "ldpm", format: "cells", words: "Its cells, for ParaView" },
    ],
  },
  {
    name: "FFT",
    grains: [],
    files: [
      { type: "voxels", format: "vti", words: "Voxels for DAMASK", set: { for: "damask" } },
      { type: "voxels", format: "vtk", words: "Voxels for AMITEX", set: { for: "amitex" } },
      { type: "voxels", format: "zip", words: "Voxels and input for FANS", set: { for: "fans" } },
      { type: "voxels", format: "npy", words: "Voxels for automesh", set: { for: "automesh" } },
      { type: "voxels", format: "npy", words: "Voxels for NumPy" },
      { type: "voxels", format: "raw", words: "Voxels as raw bytes" },
      { type: "properties", format: "json", words: "Stiffness, expansion and conductivity, computed here" },
    ],
  },
  {
    name: "CAD",
    grains: [],
    files: [
      { type: "mesh", format: "stl", words: "Surfaces, one STL for each phase", surface: true },
      { type: "mesh", format: "geo", words: "Exact shapes for OpenCASCADE" },
    ],
  },
  {
    name: "Tables",
    grains: [
      ["csv", "grains"],
      ["json", "grains and all figures"],
      ["npy", "grains for NumPy"],
      ["html", "viewer in one file"],
    ],
    files: [
      { type: "shapes", format: "csv", words: "Shape of each grain" },
      { type: "shapes", format: "json", words: "Shape of each grain, with figures" },
      { type: "quality", format: "json", words: "Quality: is the packing random" },
      { type: "certificates", format: "csv", words: "Proofs that close grains keep their gaps" },
      { type: "certificates", format: "json", words: "The same proofs, with figures" },
      { type: "slice", format: "json", words: "Outlines of a cut" },
    ],
  },
];

/** What tells files apart: type, format and the options that are set. @param {File} file */
export const keyOf = ({ type, format, set = {} }) => [type, format, ...Object.values(set)].join(" ");

/** The solid mesh of Gmsh, which who needs solid elements is sent to. */
export const SOLID = "mesh msh tetrahedra";

/**
 * The file of a made export in words: that of its options, or of its type and format.
 * @param {any} options of the export
 */
export function wordsOf({ type, format, ...options }) {
  const of = PROGRAMS.flatMap(({ name, files }) => files.map((file) => ({ name, ...file }))).filter(
    (file) => file.type === type && file.format === format,
  );
  const fits = (/** @type {Record<string, string>} */ set) =>
    Object.entries(set).every(([name, value]) => options[name] === value);
  return of.find(({ set }) => set && fits(set)) ?? of.find(({ set }) => !set) ?? of[0];
}
