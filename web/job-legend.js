/** What the colours of the viewer mean, and the size classes as a table. */
import { h, number, percent, quantity } from "./dom.js";
import { aggregates, classes, css, viridis } from "./viewer/colours.js";

/**
 * The legend: a scale by size, or one colour for each size class or aggregate.
 * @param {any} summary of the result
 * @param {string} colour size, class or aggregate
 * @param {{dmin: number, dmax: number}} head of the view, mm
 * @param {string} what the size is called
 * @returns {HTMLElement[]}
 */
export function legend(summary, colour, { dmin, dmax }, what) {
  const steps = colour === "aggregate" ? aggregates : classes(summary.classes.length);
  if (colour !== "size") {
    const names =
      colour === "class"
        ? summary.classes.map((/** @type {any} */ c) => `${number(c.d_min_mm)} to ${number(c.d_max_mm)} mm`)
        : summary.aggregates.map((/** @type {any} */ a, /** @type {number} */ i) => a.name ?? `aggregate ${i + 1}`);
    return names.map((/** @type {string} */ name, /** @type {number} */ i) =>
      h(
        "div",
        {},
        h("span", { class: "swatch", style: { background: css(steps[i] ?? [0, 0, 0]) } }),
        h("bdi", {}, name),
      ),
    );
  }
  const at = (/** @type {number} */ d) => `${(100 * Math.log(d / dmin)) / (Math.log(dmax / dmin) || 1)}%`;
  const sieves = [0.063, 0.125, 0.25, 0.5, 1, 2, 4, 8, 16, 32, 63, 125].filter(
    (d) => d > dmin * 1.12 && d < dmax / 1.12,
  );
  // A label takes about a seventh of the scale.
  const apart = (/** @type {number} */ a, /** @type {number} */ b) => Math.log(b / a) / Math.log(dmax / dmin) > 1 / 6;
  let last = dmin;
  const between = sieves.filter((d) => {
    const fits = apart(last, d) && apart(d, dmax);
    if (fits) last = d;
    return fits;
  });
  const marks = dmax > 1.001 * dmin ? [dmin, ...between, dmax] : [dmin];
  return [
    h("div", {}, `${what}, mm`),
    h("div", { class: "bar-of", style: { background: `linear-gradient(to right, ${viridis.map(css).join(", ")})` } }),
    h(
      "div",
      { class: "ticks" },
      marks.map((d) => h("span", { style: { left: at(d) } }, number(Number(d.toPrecision(2))))),
    ),
  ];
}

/**
 * Grains and volumes of the size classes as a table.
 * @param {any} summary of the result
 * @param {string} by what size the classes are divided by
 */
export function classTable({ classes: rows, specimen_volume_mm3: volume }, by) {
  const steps = classes(rows.length);
  return h(
    "details",
    {},
    h("summary", {}, `Size classes by ${by} as a table`),
    h(
      "div",
      { class: "table" },
      h(
        "table",
        {},
        h(
          "thead",
          {},
          h(
            "tr",
            {},
            h("th", { scope: "col" }, "Size class"),
            ["Grains", "Requested, of the specimen", "Placed, of the specimen"].map((name) =>
              h("th", { scope: "col", class: "number" }, name),
            ),
          ),
        ),
        h(
          "tbody",
          {},
          rows.map((/** @type {any} */ c, /** @type {number} */ i) =>
            h(
              "tr",
              {},
              h(
                "th",
                { scope: "row" },
                h("span", { class: "swatch", hidden: true, style: { background: css(steps[i] ?? [0, 0, 0]) } }),
                `${number(c.d_min_mm)} to ${quantity(c.d_max_mm, "mm")}`,
              ),
              h("td", { class: "number" }, number(c.grains)),
              h("td", { class: "number" }, percent(c.target_volume_mm3 / volume, 2)),
              h("td", { class: "number" }, percent(c.volume_mm3 / volume, 2)),
            ),
          ),
        ),
      ),
    ),
  );
}
