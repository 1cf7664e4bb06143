/** The options of exports as fields of a form: their names, units and defaults (docs/models.md). */
import { h } from "./dom.js";

/**
 * @typedef {{label: string, unit?: string, value?: number, min?: number, max?: number, choices?: string[],
 *   flag?: boolean, hint?: string}} Option
 *   `value` is the server's default; `flag`: true or false
 * @type {Record<string, Option>}
 */
const OPTIONS = {
  segments: { label: "Segments of a circumference", min: 6, max: 256, hint: "16 where no edge length is given" },
  size_mm: { label: "Edge length", unit: "mm", min: 0, hint: "in place of segments" },
  min_size_mm: { label: "Shortest edge", unit: "mm", min: 0 },
  max_size_mm: { label: "Longest edge", unit: "mm", min: 0 },
  size_field: { label: "Finer where grains are close", flag: true, value: 1 },
  max_segments: { label: "Most segments where grains are close", min: 6, max: 256 },
  volume_correction: { label: "Volume of the polyhedra", choices: ["scaled", "none"] },
  max_bytes: { label: "Longest file", unit: "bytes", min: 1, value: 500000000 },
  cells: { label: "Voxels along the longest edge", min: 1, max: 8192, hint: "100 where no edge is given" },
  voxel_mm: { label: "Edge of a voxel", unit: "mm", min: 0, hint: "in place of a number" },
  label: { label: "Labels", choices: ["phase", "grain", "aggregate"] },
  fractions: { label: "With shares of aggregate", flag: true, value: 0 },
  samples: { label: "Lines per edge of a voxel", min: 1, max: 16, value: 4 },
  axis: { label: "Axis", choices: ["z", "x", "y"] },
  at_mm: { label: "Position", unit: "mm", min: 0, hint: "the middle when empty" },
  pixels: { label: "Pixels along the longer edge", min: 16, max: 8192, hint: "for png; 1000 when empty" },
  spacing: { label: "Spacing of boundary nodes", unit: "d_min", min: 0, max: 100, value: 1.5 },
  fictitious_diameter: { label: "Diameter of boundary nodes", unit: "d_min", min: 0, max: 100, value: 1.1 },
  boundary_nodes: { label: "Boundary nodes", choices: ["poisson_disk", "random"] },
  seed: { label: "Seed of the boundary nodes", min: 0, value: 0 },
  surface_radius: {
    label: "Radius of boundary nodes",
    unit: "d_min",
    min: 0,
    max: 100,
    hint: "half the diameter when empty",
  },
  closer_than_mm: {
    label: "Pairs closer than",
    unit: "mm",
    min: 0,
    hint: "a tenth of the smallest diameter when empty",
  },
};

/** What an export is, by its type. @type {Record<string, string>} */
export const TYPES = {
  mesh: "Surface mesh",
  voxels: "Voxel model",
  slice: "Cross-section",
  ldpm: "Lattice discrete particle model",
  certificates: "Proofs that close pairs do not overlap",
  shapes: "Shapes of the grains",
  quality: "Quality: is the packing random",
};

/** What a format is for. @type {Record<string, string>} */
export const FORMATS = {
  msh: "Gmsh mesh",
  geo: "Gmsh script",
  stl: "STL",
  vti: "ParaView",
  raw: "raw bytes",
  inp: "Abaqus",
  svg: "SVG",
  png: "PNG",
  json: "JSON",
  chrono: "Project Chrono",
  tets: "tetrahedra",
  facets: "facets",
  cells: "cells",
  csv: "CSV",
};

/**
 * Fields for some options.
 * @param {string[]} names
 * @param {() => void} changed
 * @returns {{elements: HTMLElement[], values: () => Record<string, string | number | boolean>}} `values` has those that
 *   differ from the server's defaults
 */
export function fields(names, changed) {
  /** @type {[string, Option, HTMLInputElement | HTMLSelectElement][]} */
  const all = [];
  /** @type {(name: string) => HTMLElement[]} */
  const make = (name) => {
    const option = OPTIONS[name];
    if (!option) return [];
    const id = `option-${name}`;
    const { choices, flag, unit, hint } = option;
    const field = choices
      ? h(
          "select",
          { id },
          choices.map((c) => h("option", { value: c }, c.replaceAll("_", " "))),
        )
      : flag
        ? h("input", { id, type: "checkbox", checked: option.value === 1 })
        : h("input", {
            id,
            type: "number",
            step: "any",
            min: option.min,
            max: option.max,
            placeholder: option.value ?? "",
            "aria-describedby": hint ? `${id}-hint` : null,
          });
    field.addEventListener("input", changed);
    all.push([name, option, field]);
    if (flag) return [h("label", { class: "check" }, field, option.label)];
    return [
      h(
        "div",
        { class: "field" },
        h("label", { for: id }, option.label),
        unit ? h("div", { class: "with-unit" }, field, h("span", { class: "unit" }, unit)) : field,
        hint ? h("p", { class: "hint", id: `${id}-hint` }, hint) : null,
      ),
    ];
  };
  const elements = names.flatMap(make);
  const values = () => {
    /** @type {Record<string, string | number | boolean>} */
    const out = {};
    for (const [name, option, field] of all) {
      if (option.flag) {
        const { checked } = /** @type {HTMLInputElement} */ (field);
        if (checked !== (option.value === 1)) out[name] = checked;
      } else if (option.choices) {
        if (field.value !== option.choices[0]) out[name] = field.value;
      } else if (field.value !== "") out[name] = Number(field.value);
    }
    return out;
  };
  return { elements, values };
}
