/** What is known about a job and its packing, in words and numbers with their units. */
import { absolute } from "./address.js";
import { duration, h, number, percent, quantity, when } from "./dom.js";
import { partialWords } from "./job-ends.js";

/** @type {Record<string, string>} */
const METHODS = {
  rsa: "random sequential addition",
  edmd: "event-driven growth",
  rsa_then_edmd: "random sequential addition, then event-driven growth",
  monte_carlo: "hard-particle Monte Carlo",
  rsa_then_monte_carlo: "random sequential addition, then hard-particle Monte Carlo",
};

/**
 * A specimen in words.
 * @param {any} specimen of the request
 */
export function specimenWords(specimen) {
  if (specimen.type === "cylinder") {
    return `cylinder, diameter ${quantity(specimen.diameter_mm, "mm")}, height ${quantity(specimen.height_mm, "mm")}`;
  }
  const lengths = specimen.size_mm.map((/** @type {number} */ l) => number(l)).join(" × ");
  return `box ${lengths}\u202fmm${specimen.boundary === "periodic" ? ", periodic" : ""}`;
}

/**
 * One line: when and by whom the job was submitted, its study, its labels.
 * @param {any} job
 * @returns {(Node | string)[]}
 */
export function leadOf(job) {
  /** @type {(Node | string)[][]} */
  const parts = [[h("span", { class: "mono" }, job.id)], ["submitted ", when(job.created_at)]];
  if (job.submitted_by) parts.push(["by ", h("bdi", {}, job.submitted_by)]);
  if (job.study_id)
    parts.push([h("a", { href: absolute(`/studies/${job.study_id}`) }, `study, point ${job.point + 1}`)]);
  if (job.attempt > 1) parts.push([`attempt ${job.attempt} of ${job.max_attempts}`]);
  for (const [key, value] of Object.entries(job.labels)) parts.push([h("bdi", {}, `${key} = ${value}`)]);
  return parts.flatMap((part, i) => (i ? [" · ", ...part] : part));
}

/**
 * By which size the grains of a request are divided into classes.
 * @param {any} request
 */
export const sizeOf = (request) => (request.mix.size === "equivalent" ? "diameter of equal volume" : "sieve size");

/** @param {[string, Node | string][]} facts @param {string} kind */
const list = (facts, kind) =>
  h(
    "dl",
    { class: kind },
    facts.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))),
  );

/** A gap, which may be very small. @param {number | null | undefined} mm */
export const gap = (mm) =>
  mm === null || mm === undefined
    ? "\u2013"
    : mm < 1e-6
      ? "below 0.001\u202fµm"
      : mm < 0.001
        ? quantity(1000 * mm, "µm", 2)
        : quantity(mm, "mm", 3);

/**
 * The figures of a result.
 * @param {any} job
 * @param {any} request
 * @param {any} report the result without its grains
 * @param {Node | null} [changes] what can reach more than a partial packing
 */
export function facts(job, request, report, changes = null) {
  const { summary, check, timings_s: timings, shapes } = report;
  /** @type {[string, Node | string][]} */
  const more = [
    ["Specimen", specimenWords(request.specimen)],
    ["Method", METHODS[summary.method_used] ?? summary.method_used],
    ["Smallest gap of two grains", gap(check.min_gap_mm)],
    ["Smallest gap to a wall", gap(check.min_wall_gap_mm)],
    ["Largest error of a size class", percent(check.max_class_mass_error, 2)],
    ["Volume fraction of all aggregate", percent(summary.volume_fraction_mixture, 1)],
    ["Seed", String(job.seed)],
    ["Version of the engine", report.engine.version],
  ];
  if (shapes) {
    const placed = summary.classes.filter((/** @type {any} */ one) => one.grains > 0);
    const sizes = [placed[0]?.d_min_mm, placed.at(-1)?.d_max_mm].map((mm) => number(mm));
    more.push(
      [`Size classes, by ${sizeOf(request)}`, `${sizes[0]} to ${sizes[1]}\u202fmm`],
      ["Flakiness index", percent(shapes.flakiness_index, 1)],
      ["Mean sphericity", number(shapes.sphericity_mean, 3)],
    );
  }
  return h(
    "section",
    { class: "panel stack", "aria-labelledby": "facts-title" },
    h("h2", { id: "facts-title", class: "visually-hidden" }, "Result"),
    summary.partial &&
      h(
        "div",
        { class: "notice", "data-kind": "warning" },
        h("div", {}, h("p", {}, partialWords(summary.partial)), changes),
      ),
    list(
      [
        ["Grains", number(summary.grains)],
        ["Volume fraction of the grains", percent(summary.volume_fraction_effective, 2)],
        ["Distance kept", summary.distance_mm > 0 ? quantity(summary.distance_mm, "mm", 3) : "none"],
        [
          shapes ? "Diameters of the spheres of equal volume" : "Grain diameters",
          `${number(summary.d_min_mm, 3)} to ${quantity(summary.d_max_mm, "mm", 3)}`,
        ],
        ["Packing time", duration(timings.total)],
      ],
      "facts large",
    ),
    list(more, "facts"),
  );
}

/**
 * Why a job failed.
 * @param {any} job
 * @param {Node | null} changes what can be done
 */
export function failure(job, changes) {
  const { error } = job;
  return h(
    "div",
    { class: "notice", "data-kind": "error" },
    h(
      "div",
      {},
      h("strong", {}, error.title),
      h("p", {}, error.detail),
      (error.errors ?? []).map((/** @type {any} */ fault) =>
        h("p", {}, fault.pointer ? h("code", {}, fault.pointer) : "", ` ${fault.detail}`),
      ),
      changes,
    ),
  );
}
