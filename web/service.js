/** The state of the service for whoever runs it: readiness, queue, workers, disk, versions, limits. */
import { absolute } from "./address.js";
import { get, Problem, request, send } from "./api.js";
import { badge, byId, bytes, duration, h, number, replace, when } from "./dom.js";
import { live } from "./live.js";
import { announce, report, shell } from "./shell.js";

/** @typedef {(name: string, labels?: Record<string, string>) => number | null} Metric */

/** Reads the text form of Prometheus. @param {string} words @returns {Metric} */
function metrics(words) {
  /** @type {Map<string, number>} */
  const found = new Map();
  for (const [, name = "", labels = "", value = ""] of words.matchAll(/^(\w+)(\{[^}]*\})? (\S+)$/gm)) {
    if (!labels.includes(",")) found.set(name + labels, Number(value));
  }
  return (name, labels = {}) => {
    const [label] = Object.entries(labels);
    return found.get(label ? `${name}{${label[0]}="${label[1]}"}` : name) ?? null;
  };
}

/** @param {string} term @param {any} value @param {string} [hint] */
const fact = (term, value, hint) =>
  h("div", {}, h("dt", {}, term), h("dd", {}, value), hint && h("dd", { class: "hint" }, hint));
/** @param {[string, any][]} entries */
const list = (entries) =>
  h(
    "dl",
    { class: "list" },
    entries.filter(([, value]) => value !== null).flatMap(([term, value]) => [h("dt", {}, term), h("dd", {}, value)]),
  );

/** @param {Metric} of */
function blockedWorkers(of) {
  const blocked = of("packstone_workers_blocked") ?? 0;
  return blocked ? `${number(blocked, 1)} of them get no job` : undefined;
}

/** @param {Metric} of */
function showMetrics(of) {
  const count = (/** @type {string} */ name, /** @type {Record<string, string>} */ labels) =>
    number(of(name, labels), 1);
  const free = of("packstone_disk_free_bytes");
  const kept = of("packstone_disk_min_free_bytes");
  const short = free !== null && kept !== null && free < 2 * kept;
  const running = of("packstone_jobs", { state: "running" }) ?? 0;
  replace(
    byId("queue"),
    fact("Waiting", count("packstone_jobs", { state: "queued" })),
    fact("Running", number(running, 1), `of ${count("packstone_workers", {})} on this server`),
    fact("Work that waits", duration(of("packstone_queue_work_seconds")), "CPU time, by forecast"),
    fact("Oldest waits", duration(of("packstone_queue_age_seconds"))),
    fact("Worker processes", count("packstone_worker_processes", {}), blockedWorkers(of)),
    fact("Results to check", count("packstone_results_unchecked", {}), "of worker processes"),
    fact("Open studies", count("packstone_studies_open", {})),
  );
  replace(
    byId("jobs"),
    list([
      ...["succeeded", "failed", "cancelled"].map(
        (state) =>
          /** @type {[string, any]} */ ([
            `Jobs ${state}`,
            h("a", { href: absolute(`/jobs?state=${state}`) }, count("packstone_jobs", { state })),
          ]),
      ),
      ["Exports that wait", count("packstone_exports", { state: "queued" })],
      ["Exports failed", count("packstone_exports", { state: "failed" })],
      ["Faults of the store", count("packstone_store_faults_total", {})],
      ["Webhooks that wait", count("packstone_webhook_deliveries_waiting", {})],
      ["Requests over their rate", count("packstone_http_requests_over_rate_total", {})],
    ]),
  );
  const used = ["results", "exports", "cache"].map(
    (kind) =>
      /** @type {[string, any]} */ ([
        kind === "cache" ? "Cache of exports" : kind === "exports" ? "Exports kept" : "Results",
        bytes(of("packstone_stored_bytes", { kind })),
      ]),
  );
  replace(
    byId("disk"),
    list([
      ["Free", bytes(free)],
      ["Must stay free", bytes(kept)],
      ...used,
      ["Memory of the server", bytes(of("process_resident_memory_bytes"))],
      ["CPU time of the server", duration(of("process_cpu_seconds_total"))],
    ]),
    short &&
      h(
        "div",
        { class: "notice", "data-kind": "warning" },
        h("p", {}, "The disk is almost full: below the space that must stay free no job is accepted."),
      ),
  );
}

/** What the table of faulty workers shows: it is made anew only where that changes, so that a button keeps its focus. */
let shownFaulty = "";

/** The worker processes that have sent wrong results, for administrators. */
async function showFaulty() {
  const { items } = await get("/v1/workers");
  if (JSON.stringify(items) === shownFaulty) return;
  shownFaulty = JSON.stringify(items);
  byId("faulty").hidden = items.length === 0;
  replace(
    byId("faulty-workers"),
    ...items.map((/** @type {any} */ item) =>
      h(
        "tr",
        {},
        h("th", { scope: "row" }, item.worker),
        h("td", {}, item.key ?? ""),
        h("td", { class: "number" }, number(item.wrong_results, 1), item.blocked && ", gets no job"),
        h("td", {}, h("a", { href: absolute(`/jobs/${item.last_job}`) }, when(item.last_at))),
        h("td", {}, item.last_fault),
        h("td", {}, h("button", { type: "button", onclick: () => allow(item).catch(report) }, "Allow again")),
      ),
    ),
  );
}

/** @param {{key: string | null, worker: string}} item */
async function allow({ key, worker }) {
  await send("POST", "/v1/workers/allow", { key, worker });
  announce(`${worker} gets jobs again`);
  await showFaulty();
}

async function update() {
  try {
    await get("/readyz", { quiet: true });
    replace(byId("ready"), badge("ready"));
  } catch (error) {
    const words = error instanceof Problem && error.status ? error.message : "The server does not answer.";
    replace(byId("ready"), badge("failed"), " ", words);
  }
  try {
    const answer = await request("GET", "/metrics");
    showMetrics(metrics(await answer.text()));
    byId("figures").hidden = false;
    await showFaulty().catch((error) => {
      // A key for the metrics alone.
      if (!(error instanceof Problem) || error.status !== 403) throw error;
    });
    report();
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 403) report(error);
    else {
      byId("figures").hidden = true;
      replace(
        byId("refused"),
        "The key of this session may not read the figures of the service: it needs the role admin.",
      );
    }
  }
  return 2;
}

/** What does not change while the service runs. */
async function about() {
  const [capabilities, key] = await Promise.all([get("/v1/capabilities"), get("/v1/key")]);
  const { limits, engine } = capabilities;
  replace(
    byId("versions"),
    list([
      ["Service", capabilities.version],
      ["Engine", engine.version],
      ["Random generator", engine.rng],
      ["Webhooks", capabilities.webhooks ? "sent" : "not sent"],
    ]),
  );
  replace(
    byId("limits"),
    list([
      ["Jobs at once", number(limits.workers, 1)],
      ["Jobs that wait", number(limits.max_queued, 1)],
      ["Jobs of a study", number(limits.max_study_jobs, 1)],
      ["Grains of a packing", number(limits.max_grains, 1)],
      ["Memory of a packing", bytes(limits.max_memory_bytes)],
      ["Body of a request", bytes(limits.max_body_bytes)],
      ["Longest attempt", duration(limits.max_timeout_s)],
      ["Downloads at once", number(limits.max_downloads, 1)],
      ["Cache of exports", bytes(limits.export_cache_bytes)],
    ]),
  );
  const bound = (/** @type {number | null} */ value, /** @type {(value: number) => string} */ show) =>
    value === null ? "no bound" : show(value);
  replace(
    byId("key"),
    list([
      ["Key", key.name ?? "none is asked for"],
      ["Owner", key.owner],
      ["Role", key.role],
      ["Waiting jobs", `${number(key.used.queued, 1)}, ${bound(key.quotas.max_queued, (n) => `of ${number(n, 1)}`)}`],
      ["Running jobs", `${number(key.used.running, 1)}, ${bound(key.quotas.max_running, (n) => `of ${number(n, 1)}`)}`],
      ["Stored", `${bytes(key.used.stored_bytes)}, ${bound(key.quotas.max_stored_bytes, (n) => `of ${bytes(n)}`)}`],
      ["Requests in a second", bound(key.max_requests_per_second, (n) => number(n))],
    ]),
  );
}

shell();
about().catch(report);
live(update);
