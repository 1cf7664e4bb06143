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
/** What a blend said, for the chart that follows it. */
let said = "";

/**
 * The grading curve, with the choice of what it is compared with.
 * @param {[number, number][]} points
 * @param {number | null} finest the cut-off
 * @param {any} mix of the request
 * @param {Standard[]} standards the gradings of all standards
 * @param {(pointer: string, value: any) => void} use changes the request
 */
export function chart(points, finest, mix, standards, use) {
  if (!points.length) return null;
  const given = mix?.grading;
  const nameOf = (/** @type {{standard: string, name: string}} */ { standard, name }) => `${standard} ${name}`;
  const select = /** @type {HTMLSelectElement} */ (
    h(
      "select",
      { id: "compared" },
      h("option", { value: "" }, "DIN 1045-2 A, B, C"),
      ...standards.map((one) => h("option", {}, nameOf(one))),
    )
  );
  const place = h("div", {});
  const words = h("p", { class: "hint" });
  const chosen = () => standards.find((one) => nameOf(one) === select.value);
  const draw = () => {
    const band = chosen();
    replace(place, curve(points, finest, standards, band));
    text(words, band ? `${outside(points, band)} ${said}` : "");
  };
  const isBand = (/** @type {Standard} */ one) => one.standard !== "DIN 1045-2" && nameOf(one) === nameOf(given ?? {});
  select.value = compared ?? (standards.some(isBand) ? nameOf(given) : "");
  // The form plans anew when a field of the request changes; this is none.
  select.addEventListener("input", (event) => event.stopPropagation());
  select.addEventListener("change", (event) => {
    event.stopPropagation();
    compared = select.value;
    draw();
  });
  draw();
  said = "";
  const set = async () => {
    const grading = chosen();
    if (!grading) return text(words, "Choose a grading above first.");
    try {
      const { blend } = await import("./form-blend.js");
      const found = await blend(mix.aggregates, grading);
      said = found.said;
      use("/mix/aggregates", found.aggregates);
    } catch (error) {
      text(words, error instanceof Error ? error.message : String(error));
    }
  };
  return h(
    "div",
    {},
    place,
    h("div", { class: "field" }, h("label", { for: "compared" }, "Compared with"), select),
    canBlend(mix?.aggregates) &&
      h("button", { type: "button", class: "quiet", id: "blend", onclick: set }, "Set the shares to meet it"),
    words,
  );
}

/** Whether aggregates have shares that can be set. @param {any} aggregates */
const canBlend = (aggregates) =>
  Array.isArray(aggregates) &&
  aggregates.length > 1 &&
  aggregates.every((one) => one?.share !== undefined && one.grading?.type);

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
  const isCurve = limits.every(([, low, high]) => low === high);
  if (!worst) return isCurve ? `The curve is ${band}.` : `Within the limits of ${band}.`;
  const share = `${(100 * worst.beyond).toFixed(1)}\u202f%`;
  if (isCurve) return `Differs from ${band} by up to ${share} of the mass, at ${worst.d}\u202fmm.`;
  return `Outside of ${band} at ${found.length} of ${limits.length} sieves, by ${share} of the mass at ${worst.d}\u202fmm.`;
}
