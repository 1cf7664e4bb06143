/** The grading curve beside the plan, over the band of a standard that the user compares it with. */
import { h, replace, text } from "./dom.js";
import { at, curve } from "./form-curve.js";

/** @typedef {import("./form-standards.js").Standard} Standard */

/**
 * What the user compares the curve with: the standard and the name of a grading, or "" for DIN 1045-2; `null` before a
 * choice.
 * @type {string | null}
 */
let compared = null;

/**
 * The grading curve, with the choice of what it is compared with.
 * @param {[number, number][]} points
 * @param {number | null} finest the cut-off
 * @param {any} grading of the request
 * @param {Standard[]} standards the gradings of all standards
 */
export function chart(points, finest, grading, standards) {
  if (!points.length) return null;
  const bands = standards.filter((one) => one.standard !== "DIN 1045-2");
  const nameOf = (/** @type {{standard: string, name: string}} */ { standard, name }) => `${standard} ${name}`;
  const select = /** @type {HTMLSelectElement} */ (
    h(
      "select",
      { id: "compared" },
      h("option", { value: "" }, "DIN 1045-2 A, B, C"),
      ...bands.map((one) => h("option", {}, nameOf(one))),
    )
  );
  const place = h("div", {});
  const words = h("p", { class: "hint" });
  const draw = () => {
    const band = bands.find((one) => nameOf(one) === select.value);
    replace(place, curve(points, finest, standards, band));
    text(words, band ? outside(points, band) : "");
  };
  select.value = compared ?? (bands.some((one) => nameOf(one) === nameOf(grading ?? {})) ? nameOf(grading) : "");
  // The form plans anew when a field of the request changes; this is none.
  select.addEventListener("input", (event) => event.stopPropagation());
  select.addEventListener("change", (event) => {
    event.stopPropagation();
    compared = select.value;
    draw();
  });
  draw();
  return h(
    "div",
    {},
    place,
    h("div", { class: "field" }, h("label", { for: "compared" }, "Compared with"), select),
    words,
  );
}

/**
 * How far a curve lies outside of a band. Below its finest point a curve that some mass passes there says nothing.
 * @param {[number, number][]} points
 * @param {Standard} grading
 * @returns {string} in words
 */
function outside(points, { standard, name, limits }) {
  const [finest = 0, passing = 0] = points[0] ?? [];
  const found = limits
    .filter(([d]) => d >= finest || passing < 1e-6)
    .map(([d, low, high]) => ({ d, beyond: Math.max(low - at(points, d), at(points, d) - high) }))
    .filter(({ beyond }) => beyond > 5e-4);
  const band = `${standard} ${name}`;
  const [worst] = found.sort((a, b) => b.beyond - a.beyond);
  if (!worst) return `Within the limits of ${band}.`;
  const share = `${(100 * worst.beyond).toFixed(1)}\u202f%`;
  return `Outside of ${band} at ${found.length} of ${limits.length} sieves, by ${share} of the mass at ${worst.d}\u202fmm.`;
}
