/** The page of a job: its progress while it runs, then its result. */
import { absolute, within } from "./address.js";
import { events, get, Problem, request as ask, send } from "./api.js";
import { badge, byId, h, replace, text } from "./dom.js";
import { cancelJob, maximizes } from "./job-cancel.js";
import { changeLinks, changesOf } from "./job-changes.js";
import { partialBadge } from "./job-ends.js";
import { failure, facts, leadOf } from "./job-facts.js";
import { growthPart, RunPart } from "./job-run.js";
import { announce, report, shell } from "./shell.js";
import { tabs } from "./tabs.js";

const path = `/v1${within(location.pathname)}`;
const run = new RunPart(byId("run"));
/** @type {any} The job as last heard of, */
let job;
/** @type {any} and its request. */
let request;
/** What it packs, as the service says it. */
let title = "";
/** @type {{close: () => void} | null} */
let stream = null;
/** Attempt and state whose result is on the page. */
let shown = "";

const ended = (/** @type {any} */ of = job) => ["succeeded", "failed", "cancelled"].includes(of.state);

/** Title, state and actions. */
function head() {
  const name = job.name ?? (title || `Job ${job.id.slice(-8)}`);
  document.title = `${job.state === "running" ? "Running: " : ""}${name} - Packstone`;
  replace(byId("title"), h("bdi", {}, name), badge(job.state, job), partialBadge(job.result?.summary));
  replace(byId("lead"), ...leadOf(job));
  const button = (/** @type {string} */ label, /** @type {() => Promise<unknown>} */ act, kind = "") =>
    h(
      "button",
      {
        type: "button",
        class: kind,
        "data-action": label,
        onclick: async (/** @type {Event} */ event) => {
          const pressed = /** @type {HTMLButtonElement} */ (event.currentTarget);
          pressed.disabled = true;
          report();
          await act().catch(report);
          pressed.disabled = false;
        },
      },
      label,
    );
  const focus = document.activeElement?.getAttribute("data-action");
  replace(
    byId("actions"),
    mayFinish() ? button("Stop and keep", finish) : null,
    !ended() && !job.cancel_requested ? button("Cancel", cancel) : null,
    job.state === "cancelled" || job.error?.can_retry ? button("Retry", retry) : null,
    provenChange(),
    request && again(),
    ended() ? button("Delete", remove, "danger") : null,
  );
  if (focus) /** @type {HTMLElement | null} */ (document.querySelector(`[data-action="${focus}"]`))?.focus();
}

/** After a failure that a second run would repeat: the first change that can succeed, as a link. */
function provenChange() {
  const [change] = job.state === "failed" && !job.error?.can_retry ? (job.error?.changes ?? []) : [];
  if (!change || !request) return null;
  const link = changeLinks([change], request, report)?.querySelector("a");
  if (!link) return null;
  link.classList.add("primary");
  link.dataset.action = "Change";
  replace(link, `Try: ${change.title}`);
  return link;
}

/** A link to the form, filled with the request: its address is made when it is about to be used. */
function again() {
  const link = h(
    "a",
    { class: "button", href: absolute("/"), "data-action": "Run again with changes" },
    "Run again with changes",
  );
  const fill = async () => {
    const { address } = await import("./form-address.js");
    link.href = address(request);
  };
  for (const event of ["pointerenter", "focus"])
    link.addEventListener(event, () => fill().catch(report), { once: true });
  link.addEventListener("click", (event) => {
    if (link.hash) return;
    event.preventDefault();
    fill().then(() => location.assign(link.href), report);
  });
  return link;
}

/** Whether the run can end with the packing that it has reached. */
function mayFinish() {
  const hasGrains = job.progress && job.progress.step !== "sampling";
  return job.state === "running" && hasGrains && !job.cancel_requested && !job.finish_requested;
}

async function finish() {
  update(await send("POST", job.links.finish));
  announce("The run ends with the packing that it has reached");
}

async function cancel() {
  const done = await cancelJob(job, maximizes(request));
  if (!done) return;
  update(done.job);
  announce(done.words);
}

async function retry() {
  const again = await send("POST", job.links.retry);
  run.reset();
  job = again;
  update(again);
  announce("The job waits again");
  follow();
}

async function remove() {
  const { confirmDeletion } = await import("./deletion.js");
  const also = "The result and all files that were made of it are deleted, too.";
  if (!(await confirmDeletion({ one: "job", name: job.name, size: job.result?.bytes, also }))) return;
  await send("DELETE", path);
  location.assign(absolute("/jobs"));
}

/**
 * Shows a job. An answer may come later than an event that tells of more: an attempt that has ended does not run again.
 * @param {any} now
 */
function update(now) {
  if (job && now.attempt <= job.attempt && ended() && !ended(now)) return;
  const before = job?.state;
  job = now;
  head();
  run.show(job);
  if (before && before !== job.state)
    announce(`The job ${job.state === "succeeded" ? "has succeeded" : `is ${job.state}`}`);
  if (ended()) stop();
  const key = `${job.attempt} ${job.state}`;
  if (key === shown) return;
  shown = key;
  const warnings = job.warnings.map((/** @type {string} */ w) =>
    h("div", { class: "notice", "data-kind": "warning" }, h("p", {}, w)),
  );
  replace(
    byId("result"),
    job.error ? failure(job, changeLinks(job.error.changes ?? [], request, report)) : null,
    ...warnings,
    job.state === "cancelled"
      ? h("div", { class: "notice" }, h("p", {}, "The job was cancelled and has no result."))
      : null,
  );
  if (job.state === "succeeded") {
    replace(byId("request"));
    result(key).catch(report);
  }
}

/** Shows the result. @param {string} key of the job that it belongs to */
async function result(key) {
  const [found, { ViewPart }] = await Promise.all([get(job.links.summary), import("./job-view.js")]);
  if (key !== shown) return;
  const open = async () => {
    const answer = await ask("GET", `${job.links.result}?format=view`);
    return /** @type {ReadableStream<Uint8Array>} */ (answer.body);
  };
  const { partial } = found.summary;
  const view = new ViewPart({ name: `${job.id.slice(-8)}${partial ? "-partial" : ""}`, open }, found, request);
  // What else can be made of the packing, by what it is for.
  const more = tabs(
    [
      {
        id: "slices",
        name: "Slices",
        make: async () => (await import("./job-slices.js")).slicePart(job, request, found, view.viewer),
      },
      { id: "plots", name: "Plots", make: () => plots(found) },
      { id: "files", name: "Files", make: files },
      { id: "models", name: "Stiffness and models", make: models },
      {
        id: "request",
        name: "Request",
        make: async () => (await import("./job-request.js")).requestPart(job, request),
      },
    ],
    "Parts of the result",
  );
  async function files() {
    const { ExportPart } = await import("./job-exports.js");
    const part = new ExportPart(job, request, found);
    exports = part;
    // Its list is shown when it is on the page.
    setTimeout(() => part.start().catch(report));
    return part.element;
  }
  async function models() {
    const { ModelPart } = await import("./job-model.js");
    const part = new ModelPart(job, request, async () => exports?.refresh());
    await part.start();
    return part.element;
  }
  /** @type {import("./job-exports.js").ExportPart | undefined} */
  let exports;
  byId("result").prepend(view.element);
  byId("result").append(
    facts(job, request, found, partial ? changeLinks(changesOf(partial, request), request, report) : null),
    more.element,
  );
  await view.start();
}

/** The plots of the result, and the growth of its grains. @param {any} found */
async function plots(found) {
  const { plotPart } = await import("./job-plots.js");
  return h("div", { class: "stack" }, plotPart(job, request, found), growthPart(found, request));
}

/** Shows the progress. The first one that tells of grains offers to keep them. @param {any} now */
function progress(now) {
  const before = mayFinish();
  job.progress = now;
  run.progress(now);
  if (mayFinish() !== before) head();
}

/** Hears of the job until it ends. */
function follow() {
  stop();
  stream = events(
    `${path}/events`,
    { state: update, end: update, progress },
    {
      down: () => get(path).then(update, report),
    },
  );
}

function stop() {
  stream?.close();
  stream = null;
}

shell();
try {
  const found = await Promise.all([get(`${path}?overview=true`), get(`${path}/request`)]);
  request = found[1];
  title = found[0].overview?.title ?? "";
  update(found[0]);
  if (job.state !== "succeeded") {
    const { requestPart } = await import("./job-request.js");
    if (job.state !== "succeeded") replace(byId("request"), requestPart(job, request));
  }
  if (!ended()) follow();
} catch (error) {
  text(byId("title"), error instanceof Problem && error.status === 404 ? "No such job" : "Job");
  report(error);
}
