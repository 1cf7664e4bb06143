/** What a request amounts to, as `POST /v1/plans` answers: figures, forecasts, what would fit, and the size classes. */
import { bytes, duration, h, number, percent, quantity, replace } from "./dom.js";

const METHODS = { rsa: "Random sequential addition", growth: "Growth" };

/**
 * @param {Element} place
 * @param {any} plan
 * @param {{request: any, note: string, chart: Element | null, use: (pointer: string, value: any) => void}} context
 *   `note`: which of several packings the plan is of
 */
export function showPlan(place, plan, { request, note, chart, use }) {
  replace(
    place,
    note && h("p", { class: "muted small-text" }, note),
    h(
      "dl",
      { class: "facts large figures" },
      fact("Grains", `≈\u202f${grains(plan.grains)}`),
      fact("Packing time", duration(plan.estimated_time_s)),
      fact("Success", percent(plan.success_probability)),
      fact("Memory", bytes(plan.memory_bytes)),
    ),
    h(
      "dl",
      { class: "facts figures" },
      fact("All aggregate", percent(plan.volume_fraction_mixture, 1), "of the volume"),
      fact("Grains placed", percent(plan.volume_fraction_effective, 1), "of the volume"),
      plan.volume_fraction_with_coating > plan.volume_fraction_effective * 1.0005 &&
        fact("With coating", percent(plan.volume_fraction_with_coating, 1), "half of the distance around each grain"),
    ),
    notices(plan),
    proposal(plan, request, use),
    chart && h("div", {}, h("h3", {}, "Grading curve"), chart),
    methods(plan, request),
    aggregate(plan.figures),
    classes(plan),
  );
}

/** An expected number of grains. @param {number} expected */
export const grains = (expected) => number(expected < 10 ? expected : Math.round(expected), expected < 10 ? 2 : 4);

/** @param {string} term @param {string} figure @param {string} [explanation] */
const fact = (term, figure, explanation) =>
  h("div", {}, h("dt", {}, term), h("dd", {}, figure), explanation && h("dd", { class: "hint" }, explanation));

/** @param {any} plan */
function notices(plan) {
  /** @type {string[]} */
  const beyond = plan.extrapolations.map(
    (/** @type {string} */ words) => `The forecast is less certain, since it was not fitted to ${words}.`,
  );
  return [...plan.warnings, ...beyond].map((words, index) =>
    h(
      "div",
      { class: "notice", "data-kind": index < plan.warnings.length ? "warning" : "info" },
      h("p", {}, words.charAt(0).toUpperCase() + words.slice(1)),
    ),
  );
}

/**
 * The most that is likely to fit, and a button that takes it.
 * @param {any} plan
 * @param {any} request
 * @param {any} use
 */
function proposal(plan, request, use) {
  const { volume_fraction = null, distance_mm = null, specimen = null } = plan.proposal ?? {};
  const take = (/** @type {string} */ pointer, /** @type {any} */ value, /** @type {string} */ what) =>
    h(
      "button",
      { type: "button", class: "quiet", "aria-label": `Use ${what}`, onclick: () => use(pointer, value) },
      "Use",
    );
  const line = (/** @type {string} */ what, /** @type {string} */ figure, /** @type {Element | false} */ button) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, what),
      h("td", { class: "number" }, figure),
      h("td", { class: "number" }, button),
    );
  const rows = [];
  if (volume_fraction !== null) {
    const fits = request.mix?.volume_fraction !== undefined;
    rows.push(
      line(
        "Volume fraction",
        number(volume_fraction),
        fits && take("/mix/volume_fraction", volume_fraction, `the volume fraction ${volume_fraction}`),
      ),
    );
  }
  if (distance_mm !== null && request.distance?.type !== "maximize") {
    rows.push(
      line(
        "Distance",
        quantity(distance_mm, "mm"),
        take("/distance/gap_mm", distance_mm, `the distance ${distance_mm} mm`),
      ),
    );
  }
  if (specimen !== null) {
    const lengths = specimen.size_mm ?? [specimen.diameter_mm, specimen.height_mm];
    const size = `${lengths.map((/** @type {number} */ mm) => number(mm)).join("\u202f×\u202f")}\u202fmm`;
    rows.push(line("Smallest specimen", size, take("/specimen", specimen, `the specimen of ${size}`)));
  }
  if (!rows.length) return null;
  return h(
    "div",
    {},
    h("h3", {}, "The most that is likely to fit"),
    h("table", {}, h("tbody", {}, rows)),
    h("p", { class: "hint" }, "Each with all else as it is, at a probability of 90\u202f%."),
  );
}

/** The figures of the aggregate that laboratories compute by hand, loaded when they are opened. @param {any} figures */
function aggregate(figures) {
  if (!figures) return null;
  const place = h("div", {});
  const show = async () => replace(place, (await import("./form-figures.js")).figuresOf(figures));
  return h(
    "details",
    { class: "figures-of-aggregate", ontoggle: show },
    h("summary", {}, "Figures of the aggregate"),
    place,
  );
}

/** @param {any} plan @param {any} request */
function methods(plan, request) {
  const chosen = /** @type {Record<string, string>} */ ({
    rsa: "rsa",
    growth: "growth",
    edmd: "growth",
    monte_carlo: "growth",
  })[request.method?.type ?? ""];
  const rows = Object.entries(plan.methods).map(([name, estimate]) =>
    h(
      "tr",
      { "data-chosen": name === chosen },
      h("th", { scope: "row" }, /** @type {Record<string, string>} */ (METHODS)[name] ?? name),
      h("td", { class: "number" }, percent(estimate.success_probability)),
      h("td", { class: "number" }, duration(estimate.time_s)),
      h("td", { class: "number" }, percent(estimate.volume_fraction_with_coating_reach, 1)),
    ),
  );
  return h(
    "div",
    {},
    h("h3", {}, "Forecast of each method"),
    h(
      "table",
      {},
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          h("th", { scope: "col" }, "Method"),
          ...["Success", "Time", "Reach"].map((name) => h("th", { scope: "col", class: "number" }, name)),
        ),
      ),
      h("tbody", {}, rows),
    ),
    h(
      "p",
      { class: "hint" },
      "Reach: the volume fraction that 90\u202f% of runs reach, with the distance as a coating of the grains.",
    ),
  );
}

/** @param {any} plan */
function classes(plan) {
  if (plan.classes.length < 2) return null;
  const rows = plan.classes.map((/** @type {any} */ one) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, `${number(one.d_min_mm)} to ${quantity(one.d_max_mm, "mm")}`),
      h("td", { class: "number" }, grains(one.grains)),
      h("td", { class: "number" }, percent(one.volume_mm3 / plan.specimen_volume_mm3, 1)),
    ),
  );
  return h(
    "details",
    { open: plan.classes.length < 9 },
    h("summary", {}, `${plan.classes.length} size classes`),
    h(
      "table",
      {},
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          h("th", { scope: "col" }, "Diameter"),
          ...["Grains", "Volume"].map((name) => h("th", { scope: "col", class: "number" }, name)),
        ),
      ),
      h("tbody", {}, rows),
    ),
  );
}

/**
 * Shows why there is no plan, above the last one.
 * @param {Element} place
 * @param {{detail: string}[]} faults that belong to no field
 * @param {number} atFields how many are shown at their fields
 */
export function showFaults(place, faults, atFields) {
  const words = atFields === 1 ? "One field needs another value." : `${atFields} fields need other values.`;
  place.querySelector(":scope > [data-kind=error]")?.remove();
  // What was forecast before stays, dimmed: its proposals may be the remedy.
  for (const part of place.children) part.classList.add("stale");
  place.prepend(
    h(
      "div",
      { class: "notice", "data-kind": "error" },
      h(
        "div",
        {},
        atFields > 0 && h("p", {}, words),
        ...faults.map((fault) => h("p", {}, fault.detail)),
        place.children.length > 0 && h("p", { class: "hint" }, "Below stands the forecast of the last valid request."),
      ),
    ),
  );
}
