/** The list of jobs: filters in the address, pages, and what can be done with each job. */
import { absolute } from "./address.js";
import { get, send } from "./api.js";
import { confirmDeletion } from "./deletion.js";
import { byId, bytes, h, number, replace, text } from "./dom.js";
import { askToKeep, hasValidPacking, maximizesBy } from "./job-cancel.js";
import { ALSO, isOpen, makeRow, titleOf } from "./jobs-table.js";
import { live } from "./live.js";
import { rows } from "./rows.js";
import { announce, report, shell } from "./shell.js";

/** Members of the address that the interface takes as they are. */
const FILTERS = ["state", "name", "label", "method", "study", "sort", "cursor"];

const filters = /** @type {HTMLFormElement} */ (byId("filters"));
const body = /** @type {HTMLTableSectionElement} */ (byId("jobs"));
/** The box that chooses all jobs of the page. */
const all = /** @type {HTMLInputElement} */ (byId("all"));
/** Most packings that are compared. */
const MOST_COMPARED = 4;
/** The totals are counted again after this, in ms: the server walks all jobs that fit. */
const TOTALS_MS = 10_000;

/** The IDs of the jobs whose boxes are checked. @type {Set<string>} */
const chosen = new Set();
/** The jobs that are shown. @type {any[]} */
let items = [];
let timer = 0;
/** When the totals were asked for, and of which filters. */
let counted = 0;
let countedOf = "";

/** The filters of the address, as a query of the interface. */
function query() {
  const given = new URLSearchParams(location.search);
  const query_ = new URLSearchParams({ limit: "50" });
  for (const name of FILTERS) for (const value of given.getAll(name)) if (value) query_.append(name, value);
  return query_;
}

/** Shows the filters of the address in their fields. */
function fill() {
  const given = query();
  for (const field of /** @type {NodeListOf<HTMLInputElement | HTMLSelectElement>} */ (
    filters.querySelectorAll("[name]")
  )) {
    field.value = given.get(field.name) ?? "";
  }
  const study = given.get("study");
  byId("of-study").hidden = !study;
  replace(
    byId("of-study"),
    study && h("a", { href: absolute(`/studies/${study}`) }, "One study"),
    study && " only. ",
    study && h("a", { href: absolute("/jobs") }, "Show all jobs"),
  );
}

/** Takes the filters from their fields into the address. */
function filter() {
  const chosen = new URLSearchParams();
  const study = new URLSearchParams(location.search).get("study");
  // A title that was copied from the list has narrow spaces.
  for (const [name, value] of new FormData(filters))
    if (value) chosen.append(name, String(value).replaceAll("\u202f", " "));
  if (study) chosen.set("study", study);
  history.pushState(null, "", absolute(`/jobs${chosen.size ? `?${chosen}` : ""}`));
  watch.now();
}

/**
 * Asks for the page of the list and shows it.
 * @returns {Promise<number | void>} while jobs of it run, it is asked for again after a second, for their progress
 */
async function update() {
  const query_ = query();
  const here = query_.toString();
  try {
    const due = countedOf !== here || Date.now() - counted > TOTALS_MS;
    const page = await get(`/v1/jobs?${query_}&overview=true${due ? "&totals=true" : ""}`);
    if (here !== query().toString()) return;
    items = page.items;
    const known = new Set(items.map((job) => job.id));
    for (const id of chosen) if (!known.has(id)) chosen.delete(id);
    rows(
      body,
      items,
      (job) => job.id,
      (job) => makeRow(job, { changed, chosen, choose }),
    );
    choose();
    // Whose each job is, as soon as there are several owners.
    if (items.some((job) => job.owner !== items[0].owner)) byId("table").classList.add("owners");
    if (page.totals) {
      [counted, countedOf] = [Date.now(), here];
      total(page.totals);
    }
    byId("table").hidden = !page.items.length;
    byId("empty").hidden = page.items.length > 0;
    pages(query_, page);
    report();
    return page.items.some((/** @type {any} */ job) => job.state === "running") ? 1 : undefined;
  } catch (error) {
    report(error);
    throw error;
  }
}

/** Links to other pages of the list. @param {URLSearchParams} query_ @param {any} page */
function pages(query_, page) {
  const to = (/** @type {string | null} */ cursor) => {
    const next = new URLSearchParams(query_);
    next.delete("limit");
    next.delete("cursor");
    if (cursor) next.set("cursor", cursor);
    return absolute(`/jobs${next.size ? `?${next}` : ""}`);
  };
  const filtered = [...query_.keys()].some((name) => name !== "limit" && name !== "sort" && name !== "cursor");
  replace(
    byId("empty"),
    filtered ? "No job fits these filters. " : "No jobs yet. ",
    filtered
      ? h("a", { href: absolute("/jobs") }, "Show all jobs")
      : h("a", { href: absolute("/") }, "Describe a packing"),
  );
  replace(
    byId("pages"),
    query_.has("cursor") && h("a", { class: "button", href: to(null) }, "First page"),
    page.next_cursor && h("a", { class: "button", rel: "next", href: to(page.next_cursor) }, "Next page"),
    page.items.length > 0 && deletion(query_),
  );
}

/**
 * A button that deletes the finished jobs of the list, where its filters are those of the deletion.
 * @param {URLSearchParams} query_
 */
function deletion(query_) {
  const state = query_.get("state");
  const others = ["name", "method", "study"].some((name) => query_.has(name));
  if (others || state === "queued" || state === "running" || !(state || query_.has("label"))) return null;
  const filter_ = new URLSearchParams();
  for (const name of ["state", "label"]) for (const value of query_.getAll(name)) filter_.append(name, value);
  const remove = async () => {
    const { deleted: count, bytes: size } = await send("DELETE", `/v1/jobs?${filter_}&dry_run=true`);
    if (!count) return announce("No finished job fits these filters; jobs of studies are left to their study.");
    const also = "Their results and exports are deleted, too. Jobs of studies stay.";
    if (!(await confirmDeletion({ count, one: "finished job", size, also }))) return;
    let [deleted, more] = [0, true];
    while (more) {
      const answer = await send("DELETE", `/v1/jobs?${filter_}`);
      [deleted, more] = [deleted + answer.deleted, answer.more];
    }
    counted = 0;
    announce(`Deleted: ${number(deleted)} jobs`);
  };
  const act = () => remove().then(watch.now, report);
  return h("button", { type: "button", class: "quiet", "data-do": "delete-all", onclick: act }, "Delete finished jobs");
}

/** Something was done with a job. */
function changed() {
  counted = 0;
  watch.now();
}

/** Shows how many jobs are chosen and what can be done with them. */
function choose() {
  const those = items.filter((job) => chosen.has(job.id));
  all.checked = those.length > 0 && those.length === items.length;
  all.indeterminate = those.length > 0 && !all.checked;
  const open = those.filter((job) => isOpen(job) && !job.cancel_requested);
  const ended = those.filter((job) => !isOpen(job));
  const packed = those.filter((job) => job.state === "succeeded");
  const ids = packed.map((job) => job.id).join(",");
  const focus = document.activeElement?.getAttribute("data-bulk");
  const button = (/** @type {string} */ words, /** @type {string} */ kind, /** @type {() => Promise<any>} */ act) =>
    h("button", { type: "button", "data-bulk": kind, onclick: () => act().then(watch.now, report) }, words);
  const canCompare = packed.length === those.length && packed.length > 1 && packed.length <= MOST_COMPARED;
  replace(
    byId("chosen"),
    those.length > 0 && h("strong", {}, `${those.length} chosen`),
    canCompare &&
      h("a", { class: "button", "data-bulk": "compare", href: absolute(`/compare?jobs=${ids}`) }, "Compare"),
    those.length > 0 && !canCompare && h("span", { class: "hint" }, `Compare takes 2 to ${MOST_COMPARED} packings`),
    open.length > 0 && button(`Cancel ${open.length}`, "cancel", () => cancelAll(open)),
    ended.length > 0 && button(`Delete ${ended.length}`, "delete", () => removeAll(ended)),
  );
  if (focus) /** @type {HTMLElement | null} */ (document.querySelector(`[data-bulk="${focus}"]`))?.focus();
}

/** Cancels jobs; those that have a valid packing after one question. @param {any[]} jobs */
async function cancelAll(jobs) {
  const valid = jobs.filter((job) => hasValidPacking(job, maximizesBy(job.overview)));
  const answer = valid.length ? await askToKeep(valid.length) : "drop";
  if (!answer) return;
  const kept = answer === "keep" ? valid : [];
  await each(kept, "POST", "/finish", "Stopped and kept");
  await each(
    jobs.filter((job) => !kept.includes(job)),
    "POST",
    "/cancel",
    "Cancelled",
  );
}

/** Deletes jobs after one question. @param {any[]} jobs */
async function removeAll(jobs) {
  const size = jobs.reduce((sum, job) => sum + (job.result?.bytes ?? 0), 0);
  const also = jobs.length === 1 ? ALSO : "Their results and all files that were made of them are deleted, too.";
  const name = jobs.length === 1 ? titleOf(jobs[0]) : undefined;
  if (await confirmDeletion({ count: jobs.length, one: "job", name, size, also }))
    await each(jobs, "DELETE", "", "Deleted");
}

/**
 * Does the same with some jobs, one after the other.
 * @param {any[]} jobs
 * @param {string} method
 * @param {string} action
 * @param {string} done
 */
async function each(jobs, method, action, done) {
  for (const { id } of jobs) {
    await send(method, `/v1/jobs/${id}${action}`);
    chosen.delete(id);
  }
  if (!jobs.length) return;
  counted = 0;
  announce(`${done}: ${jobs.length} jobs`);
}

/** Shows how many jobs fit the filters, and what they take. @param {any} totals */
function total({ jobs, more, bytes: size }) {
  const words = `${more ? "More than " : ""}${number(jobs, 1)} ${jobs === 1 ? "job" : "jobs"}`;
  text(byId("totals"), jobs ? `${words}, results of ${bytes(size)}` : "");
}

shell();
all.addEventListener("change", () => {
  for (const { id } of items) {
    if (all.checked) chosen.add(id);
    else chosen.delete(id);
  }
  for (const box of /** @type {NodeListOf<HTMLInputElement>} */ (body.querySelectorAll(".box input")))
    box.checked = all.checked;
  choose();
});
filters.addEventListener("submit", (event) => {
  event.preventDefault();
  filter();
});
filters.addEventListener("input", () => {
  clearTimeout(timer);
  timer = setTimeout(filter, 250);
});
addEventListener("popstate", () => {
  clearTimeout(timer);
  fill();
  watch.now();
});
fill();
const watch = live(update);
