/** The list of jobs: filters in the address, pages, and what can be done with each job. */
import { absolute } from "./address.js";
import { get, send } from "./api.js";
import { badge, byId, duration, h, number, replace, when } from "./dom.js";
import { address } from "./form-address.js";
import { partialBadge } from "./job-ends.js";
import { live } from "./live.js";
import { rows } from "./rows.js";
import { announce, confirm, report, shell } from "./shell.js";

/** Members of the address that the interface takes as they are. */
const FILTERS = ["state", "name", "label", "method", "study", "sort", "cursor"];

const filters = /** @type {HTMLFormElement} */ (byId("filters"));
const body = /** @type {HTMLTableSectionElement} */ (byId("jobs"));
let timer = 0;

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
  for (const [name, value] of new FormData(filters)) if (value) chosen.append(name, String(value));
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
    const page = await get(`/v1/jobs?${query_}`);
    if (here !== query().toString()) return;
    rows(body, page.items, (job) => job.id, makeRow);
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
  const chosen = new URLSearchParams();
  for (const name of ["state", "label"]) for (const value of query_.getAll(name)) chosen.append(name, value);
  const remove = async () => {
    const { deleted: count } = await send("DELETE", `/v1/jobs?${chosen}&dry_run=true`);
    const jobs = count === 1 ? "1 finished job" : `${number(count)} finished jobs`;
    if (!count) return announce("No finished job fits these filters; jobs of studies are left to their study.");
    const words = "They are removed for good, with their results and exports. Jobs of studies stay.";
    if (!(await confirm(`Delete ${jobs}?`, words, "Delete"))) return;
    let [deleted, more] = [0, true];
    while (more) {
      const answer = await send("DELETE", `/v1/jobs?${chosen}`);
      [deleted, more] = [deleted + answer.deleted, answer.more];
    }
    announce(`Deleted: ${number(deleted)} jobs`);
  };
  const act = () => remove().then(watch.now, report);
  return h("button", { type: "button", class: "quiet", "data-do": "delete-all", onclick: act }, "Delete finished jobs");
}

/** @param {any} first @returns {import("./rows.js").Row<any>} */
function makeRow(first) {
  const { id } = first;
  const [name, state, grains, took, actions] = [
    h("th", { scope: "row", role: "rowheader" }),
    h("td", { role: "cell" }),
    h("td", { role: "cell", class: "number wide" }),
    h("td", { role: "cell", class: "number wide" }),
    h("td", { role: "cell", class: "actions-cell" }),
  ];
  const row = h(
    "tr",
    { role: "row" },
    name,
    state,
    grains,
    h("td", { role: "cell", class: "wide nowrap" }, when(first.created_at)),
    took,
    actions,
  );
  let version = "";
  return {
    row,
    show(job) {
      const { progress } = job;
      const waits = job.waiting?.detail;
      const now = `${job.updated_at} ${job.name} ${job.state} ${progress?.fraction} ${job.cancel_requested} ${job.finish_requested} ${waits}`;
      if (now === version) return;
      version = now;
      replace(
        name,
        h("a", { class: "name", href: absolute(`/jobs/${id}`) }, h("bdi", {}, job.name || `Job ${id.slice(-8)}`)),
        job.study_id &&
          h(
            "div",
            { class: "hint" },
            h("a", { href: absolute(`/studies/${job.study_id}`) }, "Study"),
            `, point ${job.point}`,
          ),
      );
      replace(
        state,
        badge(job.state, job),
        " ",
        partialBadge(job.result?.summary),
        job.state === "running" && progress && bar(progress),
        job.error && h("div", { class: "hint" }, job.error.title),
        waits && h("div", { class: "hint" }, `Waits: ${waits}`),
      );
      const { summary } = job.result ?? {};
      replace(grains, summary && number(summary.grains, 1));
      const end = job.finished_at ? Date.parse(job.finished_at) : Date.now();
      replace(
        took,
        job.started_at && job.state !== "queued" ? duration((end - Date.parse(job.started_at)) / 1000) : "",
      );
      const focus =
        document.activeElement?.closest("tr") === row ? document.activeElement?.getAttribute("data-do") : null;
      replace(actions, buttons(job));
      if (focus)
        /** @type {HTMLElement} */ (actions.querySelector(`[data-do=${focus}]`) ?? name.firstElementChild).focus();
    },
  };
}

/** @param {any} progress */
const bar = ({ fraction, eta_s }) =>
  h(
    "div",
    { class: "running" },
    h("progress", { value: fraction, max: 1, "aria-label": "Progress" }),
    eta_s ? h("span", { class: "hint" }, duration(eta_s)) : null,
  );

/** What can be done with a job in its state. @param {any} job */
function buttons(job) {
  const name = job.name || `job ${job.id.slice(-8)}`;
  const one = (/** @type {string} */ what, /** @type {string} */ kind, /** @type {() => Promise<any>} */ act) =>
    h(
      "button",
      {
        type: "button",
        class: "quiet",
        "data-do": kind,
        "aria-label": `${what}: ${name}`,
        onclick: () => act().then(watch.now, report),
      },
      what,
    );
  const path = `/v1/jobs/${job.id}`;
  const waits = job.state === "queued" || job.state === "running";
  return [
    waits &&
      !job.cancel_requested &&
      one("Cancel", "cancel", async () => {
        await send("POST", `${path}/cancel`);
        announce(`Cancelled: ${name}`);
      }),
    (job.state === "cancelled" || job.error?.can_retry) && one("Retry", "retry", () => send("POST", `${path}/retry`)),
    one("Run again", "change", async () => location.assign(address(await get(`${path}/request`)))),
    !waits &&
      one("Delete", "delete", async () => {
        if (
          !(await confirm("Delete this job?", `"${name}", its result and its exports are removed for good.`, "Delete"))
        )
          return;
        await send("DELETE", path);
        announce(`Deleted: ${name}`);
      }),
  ].filter(Boolean);
}

shell();
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
