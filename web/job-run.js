/** A job that waits or runs: its progress as a bar, in words, and the growth of its grains as a chart. */
import { duration, h, number, percent, replace, text, when } from "./dom.js";
import { growthChart } from "./growth.js";
import { announce } from "./shell.js";

/** @type {Record<string, string>} */
const STEPS = {
  sampling: "Sampling diameters",
  rsa: "Random sequential addition",
  edmd: "Growing the grains",
  monte_carlo: "Hard-particle Monte Carlo",
  check: "Checking the packing",
  export: "Making exports",
  write: "Writing the result",
};

export class RunPart {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.place = place;
    this.share = h("strong", {}, "");
    this.rest = h("span", { class: "muted" });
    this.bar = h("progress", { max: 1, "aria-label": "Progress of the job" });
    this.words = h("p", { class: "muted" });
    this.chart = h("figure", { class: "growth" });
    /** @type {import("./growth.js").Point[]} */
    this.points = [];
    this.quarter = 0;
    this.panel = h(
      "section",
      { class: "panel stack tight", "aria-labelledby": "run-title" },
      h("h2", { id: "run-title", class: "visually-hidden" }, "Progress"),
      h("div", { class: "progress-line" }, this.share, this.rest),
      this.bar,
      this.words,
      this.chart,
    );
  }

  /** @param {any} job */
  show(job) {
    if (job.state !== "queued" && job.state !== "running") {
      this.panel.remove();
      return;
    }
    if (!this.panel.isConnected) replace(this.place, this.panel);
    this.started = job.started_at;
    if (job.state === "queued") {
      this.bar.removeAttribute("value");
      text(this.share, "Queued");
      text(this.rest, "");
      if (job.waiting) {
        const until = job.waiting.until ? [", at the latest at ", when(job.waiting.until)] : [];
        replace(this.words, `It waits: ${job.waiting.detail}. It is tried again when that has ended`, ...until, ".");
        return;
      }
      text(
        this.words,
        job.attempt > 1 ? `Attempt ${job.attempt} starts when a worker is free.` : "It starts when a worker is free.",
      );
    } else this.progress(job.progress);
  }

  /** @param {any} progress of a job that runs */
  progress(progress) {
    if (!progress) {
      text(this.share, "Starting");
      return;
    }
    const { growth } = progress;
    const predictable = !growth || growth.predictable;
    this.bar.value = progress.fraction;
    text(this.share, predictable ? percent(progress.fraction, progress.fraction < 0.995 ? 0 : 1) : "Running");
    const elapsed = `running for ${duration((Date.now() - Date.parse(this.started)) / 1000)}`;
    text(this.rest, progress.eta_s === null ? elapsed : `about ${duration(progress.eta_s)} left`);
    const counted = progress.total ? `${number(progress.done)} of ${number(progress.total)} ${progress.unit}` : "";
    text(
      this.words,
      [STEPS[progress.step] ?? progress.step, counted, growth ? "" : progress.message].filter(Boolean).join(" · "),
    );
    const quarter = Math.floor(4 * progress.fraction);
    if (quarter > this.quarter) {
      this.quarter = quarter;
      announce(`${25 * quarter} % done`);
    }
    if (growth) this.#grow(growth);
  }

  /** @param {any} growth */
  #grow(growth) {
    const t = (Date.now() - Date.parse(this.started)) / 1000;
    const distance = growth.distance_mm !== null && growth.distance_mm !== undefined;
    const y = distance ? growth.distance_mm : growth.volume_fraction;
    if (this.points.length > 2000) this.points = this.points.filter((_, i) => i % 2);
    this.points.push({ t, y });
    const words =
      `Volume fraction ${number(growth.volume_fraction, 4)}, ${number(growth.events)} events` +
      `, ${number(growth.events_per_s, 3)} events per s`;
    replace(
      this.chart,
      growthChart(this.points, { label: distance ? "distance, mm" : "volume fraction" }),
      h("figcaption", { class: "hint" }, words),
    );
  }

  /** A new attempt starts from nothing. */
  reset() {
    this.points = [];
    this.quarter = 0;
    replace(this.chart);
  }
}

/**
 * The growth of a finished packing, where grains were grown.
 * @param {any} report
 * @param {any} request
 */
export function growthPart(report, request) {
  const curve = report.growth_curve ?? [];
  if (curve.length < 2) return null;
  const distance = curve.every((/** @type {any} */ p) => typeof p.distance_mm === "number");
  const points = curve.map((/** @type {any} */ p) => ({
    t: p.packing_time_s,
    y: distance ? p.distance_mm : p.volume_fraction,
  }));
  const target = distance ? request.distance?.gap_mm : report.summary.volume_fraction_effective;
  return h(
    "section",
    { class: "panel", "aria-labelledby": "growth-title" },
    h("h2", { id: "growth-title" }, "Growth of the grains"),
    h(
      "figure",
      { class: "growth" },
      growthChart(points, { label: distance ? "distance, mm" : "volume fraction", target }),
      h(
        "figcaption",
        { class: "hint" },
        distance
          ? "Distance that all grains keep, against the time of packing."
          : "Volume of the grains at their size over that of the specimen, against the time of packing.",
      ),
    ),
  );
}
