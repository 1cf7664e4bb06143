/** The plots that the server draws, one at a time and large, with the values that they show. */
import { absolute } from "./address.js";
import { passing } from "./charts.js";
import { h, percent, quantity, replace } from "./dom.js";

/** Grains times volume fraction below which too few pairs may be close for a pair correlation. */
const PAIRS = 200;

/** @type {Record<string, [string, string]>} The short name of each plot, and what it shows. */
const PLOTS = {
  grading: ["Grading", "Grading curve: mass passing, requested and packed"],
  radial: ["Pairs", "Pair correlation by class of the reference grain"],
  profile: ["Walls", "Volume fraction against depth from the walls"],
  distance: ["Distance", "Distance between grains against packing time"],
  zingg: ["Zingg", "Zingg's diagram: elongation against flatness"],
  flakiness: ["Flakiness", "Share of flaky mass by particle size fraction"],
  quality: ["Quality", "Quality: volumes near the walls, near pairs and bond order against chance"],
};

/**
 * A table of values.
 * @param {string[]} heads
 * @param {string[][]} rows
 */
const values = (heads, rows) =>
  h(
    "div",
    { class: "table", tabindex: "0", role: "region", "aria-label": "Values of the plot" },
    h(
      "table",
      {},
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          heads.map((head, i) => h("th", { scope: "col", class: i ? "number" : "" }, head)),
        ),
      ),
      h(
        "tbody",
        {},
        rows.map((row) =>
          h(
            "tr",
            {},
            row.map((cell, i) => (i ? h("td", { class: "number" }, cell) : h("th", { scope: "row" }, cell))),
          ),
        ),
      ),
    ),
  );

/**
 * The values of a plot as a table, where the result has them; else where they are to be had.
 * @param {string} kind
 * @param {any} job
 * @param {any} report
 */
function valuesOf(kind, job, report) {
  if (kind === "grading") {
    const packed = passing(report.summary, "volume_mm3");
    return values(
      ["Sieve", "Passing, requested", "Passing, packed"],
      passing(report.summary, "target_volume_mm3").map(([d, requested], i) => [
        quantity(d, "mm"),
        percent(requested, 1),
        percent(packed[i]?.[1], 1),
      ]),
    );
  }
  if (kind === "distance")
    return values(
      ["Packing time", "Distance", "Volume fraction"],
      report.growth_curve.map((/** @type {any} */ p) => [
        quantity(p.packing_time_s, "s", 3),
        quantity(p.distance_mm, "mm", 4),
        percent(p.volume_fraction, 2),
      ]),
    );
  const file = { zingg: "shapes?format=csv", flakiness: "shapes?format=csv" }[kind] ?? "quality?format=json";
  if (kind === "profile") return null;
  return h(
    "p",
    { class: "hint" },
    h("a", { href: absolute(`${job.links.exports}/${file}`), download: "" }, "Values as a file"),
  );
}

/**
 * The plots for which the packing has data (docs/plots.md).
 * @param {any} job
 * @param {any} request
 * @param {any} report
 */
export function plotPart(job, request, report) {
  const grown = (report.growth_curve ?? []).some((/** @type {any} */ p) => typeof p.distance_mm === "number");
  const pairs = report.summary.grains * report.summary.volume_fraction_effective > PAIRS;
  const shapes = Boolean(report.shapes);
  /** @type {Record<string, boolean>} */
  const has = {
    grading: true,
    radial: pairs,
    profile: request.specimen.boundary !== "periodic",
    distance: grown,
    zingg: shapes,
    flakiness: shapes,
    quality: pairs,
  };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const kinds = Object.keys(PLOTS).filter((kind) => has[kind] && job.links.plots[kind]);
  let shown = kinds[0] ?? "grading";
  const figure = h("figure", { class: "large-plot" });
  const show = () => {
    const [, words] = PLOTS[shown] ?? ["", ""];
    const image = h("img", {
      class: "plot",
      alt: words,
      width: 640,
      height: 452,
      src: absolute(`${job.links.plots[shown]}?title=false${dark.matches ? "&theme=dark" : ""}`),
    });
    image.addEventListener("error", () => replace(figure, h("p", { class: "hint" }, `${words}: not available.`)));
    const file = h("a", { href: absolute(job.links.plots[shown]), download: "" }, "SVG");
    replace(figure, image, h("figcaption", {}, words, " · ", file), valuesOf(shown, job, report));
  };
  dark.addEventListener("change", show);
  show();
  return h(
    "section",
    { class: "panel stack", "aria-labelledby": "plots-title" },
    h("h2", { id: "plots-title", class: "visually-hidden" }, "Plots"),
    h(
      "span",
      { class: "choices", role: "radiogroup", "aria-label": "Plot" },
      kinds.map((kind) =>
        h(
          "label",
          {},
          h("input", {
            type: "radio",
            name: "plot",
            value: kind,
            checked: kind === shown,
            onchange: () => {
              shown = kind;
              show();
            },
          }),
          PLOTS[kind]?.[0],
        ),
      ),
    ),
    figure,
  );
}
