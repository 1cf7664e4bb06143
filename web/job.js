/** The page of a job: its progress while it runs, then its result. */
import { absolute, within } from "./address.js";
import { events, get, Problem, request as ask, send } from "./api.js";
import { curl, json, python } from "./code.js";
import { badge, byId, copyButton, h, replace, text } from "./dom.js";
import { downloadPart, ExportPart } from "./job-exports.js";
import { ModelPart } from "./job-model.js";
import { changeLinks, changesOf } from "./job-changes.js";
import { partialBadge } from "./job-ends.js";
import { failure, facts, leadOf } from "./job-facts.js";
import { growthPart, RunPart } from "./job-run.js";
import { plotPart, slicePart } from "./job-slices.js";
import { announce, confirm, report, shell } from "./shell.js";

const path = `/v1${within(location.pathname)}`;
const run = new RunPart(byId("run"));
/** @type {any} The job as last heard of, */
let job;
/** @type {any} and its request. */
let request;
/** @type {{close: () => void} | null} */
let stream = null;
/** Attempt and state whose result is on the page. */
let shown = "";

const ended = (/** @type {any} */ of = job) => ["succeeded", "failed", "cancelled"].includes(of.state);

/** Title, state and actions. */
function head() {
  const name = job.name ?? `Job ${job.id.slice(-8)}`;
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
    request && again(),
    ended() ? button("Delete", remove, "danger") : null,
  );
  if (focus) /** @type {HTMLElement | null} */ (document.querySelector(`[data-action="${focus}"]`))?.focus();
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
  update(await send("POST", job.links.cancel));
  announce("The job is being cancelled");
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
  const words = "The job, its result and all files that were made of it are deleted. This cannot be undone.";
  if (!(await confirm("Delete this job?", words, "Delete job"))) return;
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
  if (job.state === "succeeded") result(key).catch(report);
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
  const exports = new ExportPart(job, request, found);
  const model = new ModelPart(job, request, () => exports.refresh());
  const parts = [
    facts(job, request, found, partial ? changeLinks(changesOf(partial, request), request, report) : null),
    view.element,
    model.element,
    h(
      "div",
      { class: "columns" },
      slicePart(job, request, found),
      h("div", { class: "stack" }, downloadPart(job), exports.element, growthPart(found, request)),
    ),
    plotPart(job, request, found),
  ];
  byId("result").append(...parts);
  await Promise.all([view.start(), exports.start(), model.start()]);
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

/** The request as JSON, curl and Python. */
function requestPart() {
  const long = json(request).length > 200_000;
  if (long) {
    return h(
      "section",
      { class: "panel", "aria-labelledby": "request-title" },
      h("h2", { id: "request-title" }, "Request"),
      h("p", {}, "The request is long. ", h("a", { href: absolute(job.links.request) }, "Read it as JSON"), "."),
    );
  }
  const withKey = job.submitted_by !== null;
  /** @type {Record<string, string>} */
  const forms = { JSON: `${json(request)}\n`, curl: curl(request, withKey), Python: python(request, withKey) };
  const words = h("pre", { tabindex: "0", "aria-label": "Request as JSON" }, forms.JSON);
  const choose = (/** @type {string} */ kind) => {
    text(words, forms[kind] ?? "");
    words.setAttribute("aria-label", `Request as ${kind}`);
  };
  return h(
    "section",
    { class: "panel stack tight", "aria-labelledby": "request-title" },
    h("h2", { id: "request-title" }, "Request"),
    h(
      "div",
      { class: "actions" },
      h(
        "span",
        { class: "choices", role: "radiogroup", "aria-label": "Form of the request" },
        Object.keys(forms).map((kind) =>
          h(
            "label",
            {},
            h("input", { type: "radio", name: "form", checked: kind === "JSON", onchange: () => choose(kind) }),
            kind,
          ),
        ),
      ),
      copyButton(() => words.textContent ?? ""),
    ),
    words,
  );
}

shell();
try {
  const found = await Promise.all([get(path), get(`${path}/request`)]);
  request = found[1];
  update(found[0]);
  replace(byId("request"), requestPart());
  if (!ended()) follow();
} catch (error) {
  text(byId("title"), error instanceof Problem && error.status === 404 ? "No such job" : "Job");
  report(error);
}
