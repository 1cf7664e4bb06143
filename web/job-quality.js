/** The figures of a made file by which its quality is judged. */
import { number, percent, quantity } from "./dom.js";

/** A small relative error, with its sign. @param {number} share */
const error = (share) => `${share < 0 ? "\u2212" : "+"}${percent(Math.abs(share), 2)}`;

/**
 * @param {any} report of an export
 * @returns {[string, string][]} names and values
 */
export function qualityOf(report) {
  const { tetrahedra, triangles } = report;
  /** @type {[string, string | false | undefined][]} */
  const figures = [];
  const has = (/** @type {any} */ value) => typeof value === "number";
  const solid = tetrahedra ?? (typeof triangles === "object" ? triangles : null);
  if (solid) {
    figures.push(
      ["elements", number(solid.elements)],
      ["nodes", number(solid.nodes)],
      ["smallest gamma", number(solid.smallest_gamma, 2)],
      ["gamma below 0.03", number(solid.elements_below_gamma_0_03)],
      ["error of the volume", has(solid.specimen_volume_error) && error(solid.specimen_volume_error)],
      ["largest error of a grain", has(solid.largest_grain_volume_error) && error(solid.largest_grain_volume_error)],
      ["error of the area", has(solid.area_error) && error(solid.area_error)],
    );
  } else if (has(report.number_of_elements)) {
    figures.push(
      ["elements", number(report.number_of_elements)],
      ["nodes", number(report.nodes)],
      ["unknowns", number(report.degrees_of_freedom)],
    );
  } else if (has(triangles)) {
    figures.push(["triangles", number(triangles)]);
  }
  figures.push(
    ["edges", has(report.shortest_edge_mm) && edges(report)],
    ["error of the grains", has(report.aggregate_volume_error) && error(report.aggregate_volume_error)],
    ["grains short of volume", report.grains_short_of_volume > 0 && number(report.grains_short_of_volume)],
  );
  if (report.shape)
    figures.push(
      ["voxels", report.shape.map((/** @type {number} */ n) => number(n)).join(" × ")],
      ["volume fraction of the labels", percent(report.volume_fraction_labels, 2)],
      ["exact", percent(report.volume_fraction, 2)],
      ["grains without a voxel", report.grains_without_voxel > 0 && number(report.grains_without_voxel)],
    );
  if (has(report.facet_area_in_grains))
    figures.push(
      ["tetrahedra", number(report.tetrahedra)],
      ["facets", number(report.facets)],
      ["facet area in grains", percent(report.facet_area_in_grains, 1)],
    );
  figures.push(["area fraction of the cut", has(report.area_fraction) && percent(report.area_fraction, 2)]);
  return /** @type {[string, string][]} */ (figures.filter(([, value]) => value));
}

/** @param {any} report */
const edges = ({ shortest_edge_mm: low, longest_edge_mm: high }) => `${number(low, 2)} to ${quantity(high, "mm", 2)}`;
