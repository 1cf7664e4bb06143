/** One study: progress, plots, and the table of its points. */
import { absolute } from "./address.js";
import { get, Problem, request } from "./api.js";
import { badge, byId, duration, h, number, quantity, replace, text, when } from "./dom.js";
import { specimenWords } from "./job-facts.js";
import { live } from "./live.js";
import { announce, report, shell } from "./shell.js";
import { buttons, counts, nameOf } from "./study-parts.js";
import { columnName, StudyTable, words } from "./study-table.js";
import { tabs } from "./tabs.js";

const id = location.pathname.split("/").at(-1) ?? "";
const path = `/v1/studies/${encodeURIComponent(id)}`;

/** The plots, each with the figure of the table without which it is empty. */
const PLOTS = {
  success: ["Success rate", "success_rate"],
  time: ["Time", "time_s_median"],
  distance: ["Distance", "distance_mm_median"],
  volume_fraction: ["Volume fraction", "volume_fraction_effective"],
  curve: ["Growth curves", "events_median"],
  event_time: ["Time per event", "event_us_median"],
  youngs_modulus: ["Young's modulus", "youngs_modulus_gpa_mean"],
  expansion: ["Thermal expansion", "expansion_1_k_mean"],
  conductivity: ["Conductivity", "conductivity_w_m_k_mean"],
  diffusivity: ["Diffusivity", "diffusivity_m2_s_mean"],
};
/** The plots that have an abscissa of their own. */
const OWN_ABSCISSA = { curve: "the time", representative_volume: "the edge of the specimen" };

const table = new StudyTable(byId("points"), path);
const kind = /** @type {HTMLSelectElement} */ (byId("kind"));
const abscissa = /** @type {HTMLSelectElement} */ (byId("x"));
const image = /** @type {HTMLImageElement} */ (byId("plot"));
const page = {
  pause: () => watch.close(),
  resume: () => {
    watch = live(update);
  },
  gone: () => location.assign(absolute("/studies")),
};
const dark = matchMedia("(prefers-color-scheme: dark)");
let tag = "";
let plotted = "";
let quarter = -1;
let warned = 0;
/** Runs whose properties are still to be computed. */
let waiting = 0;
/** The request of the study, and what its first job packs. @type {{request: any, overview: any} | null} */
let known = null;
/** The varied fields of each point, in words. @type {string[]} */
let varied = [];

async function update() {
  const started = performance.now();
  try {
    const [study, about] = await Promise.all([get(path), known ?? what()]);
    if (!known) more(about);
    known = about;
    show(study);
    const answer = await request("GET", `${path}/table`, undefined, { headers: tag ? { "if-none-match": tag } : {} });
    if (answer.status !== 304) {
      tag = answer.headers.get("etag") ?? "";
      const document = await answer.json();
      table.set(document, study.finished_at !== null);
      varied = document.rows.map((/** @type {any} */ row) =>
        document.columns
          .filter((/** @type {string} */ name) => name.startsWith("/"))
          .map((/** @type {string} */ name) => words(row[name], name))
          .join(", "),
      );
      waiting = document.rows.reduce(
        (/** @type {number} */ sum, /** @type {any} */ row) => sum + (row.properties_waiting ?? 0),
        0,
      );
      choices(document);
      representative(document.representative_volumes ?? []);
    }
    await plot();
    report();
    // A table of thousands of points takes its time: at most a tenth of the time is spent on it.
    if (!study.finished_at || waiting > 0) return Math.max(1, (10 * (performance.now() - started)) / 1000);
  } catch (error) {
    report(error);
    if (error instanceof Problem && error.status === 404) return;
    throw error;
  }
}

/** The request of the study, and what its first job packs. */
async function what() {
  const [{ request }, { items }] = await Promise.all([
    get(`${path}?include=request`),
    get(`${path}/jobs?sort=created&limit=1&overview=true`),
  ]);
  return { request, overview: items[0]?.overview ?? null };
}

/** What else there is of the runs, in tabs. @param {{request: any}} about */
function more({ request }) {
  const part = () => import("./study-runs.js");
  const list = [
    { id: "runs", name: "Runs", make: async () => (await part()).runsPart(path, () => varied) },
    { id: "files", name: "Files", make: async () => (await part()).filesPart(path, request) },
    { id: "request", name: "Request", make: async () => (await part()).requestPart(request) },
  ];
  replace(byId("more"), tabs(list, "Parts of the study").element);
}

/** @param {any} study */
function show(study) {
  const overview = known?.overview;
  // What the points have in common, where the study has no name.
  const common = overview && `${overview.curve}, ${overview.specimen}`;
  const name = study.name || (common ? `Study of ${common}` : nameOf(study));
  document.title = `${name} - Packstone`;
  replace(byId("title"), h("bdi", {}, name));
  replace(
    byId("lead"),
    h("span", { class: "mono" }, study.id),
    " \u00b7 submitted ",
    when(study.created_at),
    ...(study.submitted_by ? [" by ", h("bdi", {}, study.submitted_by)] : []),
    ...Object.entries(study.labels).flatMap(([key, value]) => [" \u00b7 ", h("bdi", {}, `${key} = ${value}`)]),
  );
  replace(byId("state"), badge(study.finished_at ? "finished" : "open"));
  replace(byId("buttons"), buttons(study, watch.now, page));
  const progress = /** @type {HTMLProgressElement} */ (byId("progress"));
  progress.value = study.progress.fraction;
  const rest = study.progress.eta_s && !study.finished_at ? `, about ${duration(study.progress.eta_s)} left` : "";
  text(
    byId("counts"),
    `${number(study.progress.done, 1)} of ${number(study.progress.total, 1)} jobs have ended${rest}: ${counts(study)}.`,
  );
  const now = Math.floor(4 * study.progress.fraction);
  if (quarter >= 0 && now > quarter) announce(`${25 * now} percent of the jobs have ended.`);
  quarter = now;
  const fact = (/** @type {string} */ term, /** @type {any} */ value) =>
    h("div", {}, h("dt", {}, term), h("dd", {}, value));
  const { template } = known?.request ?? {};
  replace(
    byId("facts"),
    ...(overview ? [fact("Grading", overview.curve)] : []),
    ...(template?.specimen ? [fact("Specimen", specimenWords(template.specimen))] : []),
    ...(overview ? [fact("Grains", overview.shape), fact("Distance", overview.gap)] : []),
    fact("Points", number(study.points, 1)),
    fact("Seeds for each", number(study.replicates, 1)),
    fact("Varied", study.columns.map(columnName).join(", ") || "seeds"),
    fact("Seed", String(study.seed)),
    fact("Ended", when(study.finished_at)),
  );
  const warnings = /** @type {{detail: string, points: number, point: number}[]} */ (study.warnings);
  const whose = (/** @type {{points: number, point: number}} */ { points, point }) =>
    points === study.points ? "All points" : points === 1 ? `Point ${point}` : `${number(points, 1)} points`;
  const lines = warnings.slice(0, 50).map((one) => h("p", {}, `${whose(one)}: ${one.detail}.`));
  const shown =
    lines.length < 4 ? h("div", {}, lines) : h("details", {}, h("summary", {}, `${warnings.length} warnings`), lines);
  if (lines.length !== warned) replace(byId("warnings"), h("div", { class: "notice", "data-kind": "warning" }, shown));
  warned = lines.length;
}

/** Offers the plots for which there are figures, and the columns with numbers as abscissas. @param {any} document */
function choices(document) {
  const has = (/** @type {string} */ figure) =>
    document.rows.some((/** @type {any} */ row) => (row[figure] ?? null) !== null);
  const plots = Object.entries(PLOTS)
    .filter(([, [, figure = ""]]) => has(figure))
    .map(([value, [name = ""]]) => [value, name]);
  if (document.representative_volumes) plots.push(["representative_volume", "Representative volume"]);
  offer(kind, plots);
  /** @type {string[]} */
  const pointers = document.columns.filter((/** @type {string} */ name) => name.startsWith("/"));
  const columns = [...pointers, "grains", "volume_fraction_effective"];
  const numeric = columns.filter((name) =>
    document.rows.every((/** @type {any} */ row) => typeof row[name] === "number"),
  );
  offer(
    abscissa,
    numeric.map((name) => [name, columnName(name)]),
  );
}

/**
 * Shows what the scatter of the properties says of the volume that represents the material.
 * @param {any[]} volumes
 */
function representative(volumes) {
  const sized = volumes.filter((one) => one.edge_mm !== null);
  const words = (/** @type {any} */ one) => {
    const group = Object.entries(one.values).map(([name, value]) => `${columnName(name)} ${JSON.stringify(value)}`);
    return `${[columnName(one.property), ...group].join(", ")}: ${quantity(one.edge_mm, "mm", 3)}`;
  };
  replace(
    byId("representative"),
    sized.length > 0 &&
      h(
        "p",
        { class: "muted" },
        `Edge of the cube that has a property within 1 % by itself. ${sized.map(words).join("; ")}.`,
      ),
  );
}

/**
 * Replaces what a field offers; what was chosen stays, where it can.
 * @param {HTMLSelectElement} field
 * @param {string[][]} options
 */
function offer(field, options) {
  const chosen = field.value;
  if (Array.from(field.options, (option) => option.value).join() === options.map(([value]) => value).join()) return;
  replace(field, ...options.map(([value, name]) => h("option", { value }, name)));
  if (options.some(([value]) => value === chosen)) field.value = chosen;
}

/** Shows the plot that is chosen, if it has changed. */
async function plot() {
  byId("plots").hidden = !kind.value;
  if (!kind.value) {
    image.hidden = true;
    return text(byId("no-plot"), "There are no runs to plot yet.");
  }
  const query = new URLSearchParams({ title: "false", ...(dark.matches && { theme: "dark" }) });
  const own = /** @type {Record<string, string>} */ (OWN_ABSCISSA)[kind.value];
  if (!own && abscissa.value) query.set("x", abscissa.value);
  const address = `${path}/plots/${kind.value}?${query}`;
  byId("x-field").hidden = Boolean(own);
  try {
    const answer = await request("GET", address);
    const now = `${address} ${answer.headers.get("etag")}`;
    if (now === plotted) return;
    plotted = now;
    const old = image.src;
    image.src = URL.createObjectURL(await answer.blob());
    const over = own ?? columnName(abscissa.value || "the first column");
    image.alt = `${kind.selectedOptions[0]?.textContent} over ${over}; the figures are in the table below.`;
    image.hidden = false;
    URL.revokeObjectURL(old);
    text(byId("no-plot"), "");
  } catch (error) {
    if (!(error instanceof Problem) || error.status >= 500 || error.status === 0) throw error;
    plotted = "";
    image.hidden = true;
    text(byId("no-plot"), error.message);
  }
  // A file is for print, whatever the page looks like.
  query.delete("theme");
  /** @type {HTMLAnchorElement} */ (byId("plot-file")).href = absolute(`${path}/plots/${kind.value}?${query}`);
}

shell();
for (const field of [kind, abscissa, dark]) field.addEventListener("change", () => plot().catch(report));
/** @type {HTMLAnchorElement} */ (byId("csv")).href = absolute(`${path}/table?format=csv`);
/** @type {HTMLAnchorElement} */ (byId("jobs")).href = absolute(`/jobs?study=${encodeURIComponent(id)}`);
let watch = live(update);
