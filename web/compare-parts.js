/** What is compared of packings: their requests, their figures, their curves. */
import { COLOURS, overlay, passing } from "./charts.js";
import { duration, h, number, percent, quantity } from "./dom.js";
import { gap } from "./job-facts.js";
import { differences, fieldWords, valueWords } from "./request-difference.js";

/**
 * @typedef {object} Packing
 * @property {string} letter
 * @property {string} title
 * @property {any} job
 * @property {any} request
 * @property {any} report
 */

/** The mark of a packing: its letter in its colour. @param {number} i @param {string} letter */
export const mark = (i, letter) => h("span", { class: "mark", style: { "--of": COLOURS[i % COLOURS.length] } }, letter);

/**
 * A table with a column for each packing.
 * @param {Packing[]} packings
 * @param {string} label
 * @param {[string, string[], string?][]} rows name, values, and the difference of two
 * @param {boolean} [withDifference]
 */
function table(packings, label, rows, withDifference = false) {
  return h(
    "div",
    { class: "table", tabindex: "0", role: "region", "aria-label": label },
    h(
      "table",
      {},
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          h("th", { scope: "col" }, label),
          packings.map(({ letter }, i) => h("th", { scope: "col", class: "number" }, mark(i, letter))),
          withDifference && h("th", { scope: "col", class: "number" }, "B \u2212 A"),
        ),
      ),
      h(
        "tbody",
        {},
        rows.map(([name, values, difference]) =>
          h(
            "tr",
            {},
            h("th", { scope: "row" }, name),
            values.map((value) => h("td", { class: "number" }, value)),
            withDifference && h("td", { class: "number" }, difference ?? ""),
          ),
        ),
      ),
    ),
  );
}

/**
 * In what the requests differ.
 * @param {Packing[]} packings
 */
export function requestPart(packings) {
  const found = differences(packings.map(({ request }) => request));
  const words =
    found.length === 0
      ? "The requests are the same."
      : `The requests differ in ${found.length === 1 ? "one field" : `${found.length} fields`}.`;
  const rows = found.map(
    ({ path, values }) =>
      /** @type {[string, string[]]} */ ([fieldWords(path), values.map((one) => valueWords(one, path))]),
  );
  return h(
    "section",
    { class: "stack tight", "aria-labelledby": "requests-title" },
    h("h2", { id: "requests-title" }, "Requests"),
    h("p", { class: "muted" }, words),
    found.length > 0 && h("div", { class: "requests" }, table(packings, "Field", rows)),
  );
}

/** @type {[string, (packing: Packing) => any, (value: any) => string][]} The figures: name, value, notation. */
const FIGURES = [
  ["Grains", ({ report }) => report.summary.grains, (value) => number(value)],
  ["Volume fraction of the grains", ({ report }) => report.summary.volume_fraction_effective, (v) => percent(v, 2)],
  ["Volume fraction of all aggregate", ({ report }) => report.summary.volume_fraction_mixture, (v) => percent(v, 2)],
  ["Distance kept", ({ report }) => report.summary.distance_mm, (value) => quantity(value, "mm", 3)],
  ["Smallest gap of two grains", ({ report }) => report.check.min_gap_mm, gap],
  ["Smallest gap to a wall", ({ report }) => report.check.min_wall_gap_mm, gap],
  ["Smallest diameter", ({ report }) => report.summary.d_min_mm, (value) => quantity(value, "mm", 3)],
  ["Largest diameter", ({ report }) => report.summary.d_max_mm, (value) => quantity(value, "mm", 3)],
  ["Largest error of a size class", ({ report }) => report.check.max_class_mass_error, (value) => percent(value, 2)],
  ["Mean sphericity", ({ report }) => report.shapes?.sphericity_mean, (value) => number(value, 3)],
  ["Flakiness index", ({ report }) => report.shapes?.flakiness_index, (value) => percent(value, 1)],
  ["Packing time", ({ report }) => report.timings_s.total, (value) => duration(value)],
];

/**
 * The figures of the results and the differences of two.
 * @param {Packing[]} packings
 */
export function figurePart(packings) {
  const rows = FIGURES.map(([name, of, show]) => ({ name, show, values: packings.map(of) }))
    .filter(({ values }) => values.some((value) => typeof value === "number"))
    .map(({ name, show, values }) => {
      const [a, b] = values;
      const both = typeof a === "number" && typeof b === "number";
      const change = both && a !== 0 ? ` (${b < a ? "\u2212" : "+"}${percent(Math.abs(b / a - 1), 1)})` : "";
      const difference = !both
        ? ""
        : a === b
          ? "the same"
          : `${b < a ? "\u2212" : "+"}${show(Math.abs(b - a))}${change}`;
      return /** @type {[string, string[], string]} */ ([
        name,
        values.map((value) => (typeof value === "number" ? show(value) : "\u2013")),
        difference,
      ]);
    });
  return h(
    "section",
    { class: "stack tight", "aria-labelledby": "figures-title" },
    h("h2", { id: "figures-title" }, "Figures"),
    table(packings, "Figure", rows, packings.length === 2),
  );
}

/**
 * The curves of the packings over each other.
 * @param {Packing[]} packings
 */
export function plotPart(packings) {
  const colour = (/** @type {number} */ i) => COLOURS[i % COLOURS.length] ?? "";
  const curves = packings.flatMap(({ letter, report }, i) => {
    const curve = (/** @type {"target_volume_mm3" | "volume_mm3"} */ of) =>
      passing(report.summary, of).map(([d, share]) => /** @type {[number, number]} */ ([d, 100 * share]));
    return [
      { name: letter, colour: colour(i), points: curve("volume_mm3") },
      { name: letter, colour: colour(i), dashed: true, points: curve("target_volume_mm3") },
    ];
  });
  const growth = packings
    .map(({ letter, report }, i) => ({
      name: letter,
      colour: colour(i),
      points: (report.growth_curve ?? []).map(
        (/** @type {any} */ p) =>
          /** @type {[number, number]} */ ([p.packing_time_s, p.distance_mm ?? p.volume_fraction]),
      ),
    }))
    .filter(({ points }) => points.length > 1);
  const keys = h(
    "p",
    { class: "keys" },
    packings.map(({ letter, title }, i) => h("span", {}, mark(i, letter), " ", h("bdi", {}, title))),
  );
  return h(
    "section",
    { class: "panel stack", "aria-labelledby": "plots-title" },
    h("h2", { id: "plots-title" }, "Plots"),
    keys,
    h(
      "figure",
      {},
      overlay(curves, {
        x: "sieve, mm",
        y: "passing, % of the mass",
        log: true,
        words: `Grading curves of ${packings.length} packings`,
      }),
      h("figcaption", { class: "hint" }, "Grading: packed as lines, requested dashed."),
    ),
    h("details", {}, h("summary", {}, "Values of the grading curves"), gradingTable(packings)),
    growth.length > 0 &&
      h(
        "figure",
        {},
        overlay(growth, { x: "packing time, s", y: "distance in mm, or volume fraction", words: "Growth curves" }),
        h("figcaption", { class: "hint" }, "Growth of the grains."),
      ),
  );
}

/** The shares that pass each sieve as a table. @param {Packing[]} packings */
function gradingTable(packings) {
  const curves = packings.map(({ report }) => new Map(passing(report.summary, "volume_mm3")));
  const sieves = [...new Set(curves.flatMap((curve) => [...curve.keys()]))].sort((a, b) => a - b);
  return table(
    packings,
    "Sieve",
    sieves.map((d) => [
      quantity(d, "mm"),
      curves.map((curve) => {
        const share = curve.get(d);
        return share === undefined ? "\u2013" : percent(share, 1);
      }),
    ]),
  );
}
