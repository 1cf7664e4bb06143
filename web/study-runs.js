/** The runs of a study: a table of its jobs from which some are compared, and their files by program. */
import { absolute } from "./address.js";
import { get, send } from "./api.js";
import { badge, bytes, duration, h, number, percent, replace, text } from "./dom.js";
import { materialsFor } from "./job-exports.js";
import { partialBadge } from "./job-ends.js";
import { keyOf, PROGRAMS } from "./job-programs.js";
import { announce, report } from "./shell.js";

/** Runs that are shown at once. */
const PAGE = 100;
/** Most packings that are compared. */
const MOST_COMPARED = 4;
/** Files that are made at once. */
const AT_ONCE = 4;

/**
 * A table of the runs, with boxes to compare some.
 * @param {string} path of the study in the interface
 * @param {() => string[]} values the varied fields of a point, in words
 */
export function runsPart(path, values) {
  /** @type {Set<string>} */
  const chosen = new Set();
  const compare = h("span", { class: "actions", role: "status" });
  const choose = () => {
    const fits = chosen.size > 1 && chosen.size <= MOST_COMPARED;
    const link = h("a", { class: "button", href: absolute(`/compare?jobs=${[...chosen].join()}`) }, "Compare");
    replace(
      compare,
      chosen.size > 0 && h("strong", {}, `${chosen.size} chosen`),
      fits ? link : h("span", { class: "hint" }, `Choose 2 to ${MOST_COMPARED} packings to compare them`),
    );
  };
  const row = (/** @type {any} */ job) => {
    const summary = job.result?.summary;
    const box = h("input", {
      type: "checkbox",
      "aria-label": `Choose the run of point ${job.point}, seed ${job.seed}`,
      disabled: job.state !== "succeeded",
      onchange: (/** @type {Event} */ event) => {
        if (/** @type {HTMLInputElement} */ (event.target).checked) chosen.add(job.id);
        else chosen.delete(job.id);
        choose();
      },
    });
    const ran = job.started_at && job.finished_at && Date.parse(job.finished_at) - Date.parse(job.started_at);
    const figure = (/** @type {import("./dom.js").Child} */ words) => h("td", { class: "number" }, words);
    return h(
      "tr",
      {},
      h("td", { class: "box" }, box),
      h("th", { scope: "row", class: "plain" }, h("a", { href: absolute(`/jobs/${job.id}`) }, `Seed ${job.seed}`)),
      figure(String(job.point)),
      h("td", {}, values()[job.point] ?? ""),
      h("td", {}, badge(job.state, job), " ", partialBadge(summary)),
      figure(summary ? number(summary.grains, 6) : "\u2013"),
      figure(summary ? percent(summary.volume_fraction_effective, 2) : "\u2013"),
      figure(typeof ran === "number" ? duration(ran / 1000) : "\u2013"),
      figure(job.result ? bytes(job.result.bytes) : "\u2013"),
    );
  };
  const heads = ["Run", "Point", "Varied", "State", "Grains", "Placed", "Time", "Size"];
  const right = new Set(["Point", "Grains", "Placed", "Time", "Size"]);
  const body = h("tbody", {});
  const more = h("div", { class: "actions" });
  const load = async (cursor = "") => {
    const page = await get(`${path}/jobs?sort=created&limit=${PAGE}${cursor && `&cursor=${cursor}`}`);
    body.append(...page.items.map(row));
    const next = () => load(page.next_cursor).catch(report);
    replace(more, page.next_cursor && h("button", { type: "button", onclick: next }, "More runs"));
  };
  load().catch(report);
  choose();
  return h(
    "section",
    { class: "panel stack tight", "aria-labelledby": "runs-title" },
    h("div", { class: "head" }, h("h2", { id: "runs-title" }, "Runs"), compare),
    h(
      "div",
      { class: "table", tabindex: "0", role: "region", "aria-label": "Runs of the study" },
      h(
        "table",
        { id: "runs" },
        h(
          "thead",
          {},
          h(
            "tr",
            {},
            h("th", { scope: "col", class: "box" }, h("span", { class: "visually-hidden" }, "Choose")),
            heads.map((name) => h("th", { scope: "col", class: right.has(name) ? "number" : "" }, name)),
          ),
        ),
        body,
      ),
    ),
    more,
  );
}

/**
 * The files of all runs by the program that reads them.
 * @param {string} path of the study in the interface
 * @param {any} request of the study
 */
export async function filesPart(path, request) {
  const packed = (/** @type {string | null} */ cursor) =>
    get(`${path}/jobs?state=succeeded&sort=created&limit=${PAGE}${cursor ? `&cursor=${cursor}` : ""}`);
  const [{ exports }, { items, next_cursor }] = await Promise.all([get("/v1/capabilities"), packed(null)]);
  /** Where the runs begin that are not shown yet. @type {string | null} */
  let cursor = next_cursor;
  const known = new Set(
    exports.flatMap((/** @type {any} */ e) => e.formats.map((/** @type {any} */ f) => `${e.type} ${f.name}`)),
  );
  let program = /** @type {import("./job-programs.js").Program} */ (PROGRAMS[0]);
  const file = h("select", { id: "runs-file", onchange: () => show() });
  const make = h("button", { type: "button", onclick: () => all().catch(report) }, "Make for all runs");
  const list = h("ul", { class: "files", "aria-label": "Files of the runs" });
  const more = h("button", { type: "button", hidden: !cursor, onclick: () => next().catch(report) }, "More runs");
  const choices = h("span", { class: "choices", role: "radiogroup", "aria-labelledby": "runs-files-title" });
  /** The places of the links, by the runs. @type {Map<any, HTMLElement>} */
  let places = new Map();

  const chosen = () => program.files.find((one) => keyOf(one) === file.value);
  const choose = (/** @type {import("./job-programs.js").Program} */ one) => {
    program = one;
    const made = one.files.filter(({ type, format }) => known.has(`${type} ${format}`));
    replace(
      file,
      one.grains.map(([format, words]) => h("option", { value: `grains ${format}` }, `${words} (${format})`)),
      made.map((of) => h("option", { value: keyOf(of) }, `${of.words} (${of.format})`)),
    );
    show();
  };
  const link = (/** @type {string} */ href) =>
    h("a", { class: "button", href: absolute(href), download: "" }, "Download");

  function show() {
    make.hidden = file.value.startsWith("grains ");
    places = new Map();
    replace(list, items.map(line));
  }

  /** A run with the place of its link. @param {any} job */
  function line(job) {
    const grains = /^grains (\w+)/.exec(file.value)?.[1];
    const place = h("div", { class: "actions" }, grains && link(`${job.links.result}?format=${grains}`));
    places.set(job, place);
    const called = `Point ${job.point}, seed ${job.seed}`;
    return h(
      "li",
      {},
      h(
        "div",
        { class: "file" },
        h("a", { href: absolute(`/jobs/${job.id}`) }, called),
        h("span", { class: "muted" }, ` ${number(job.result.summary.grains, 6)} grains`),
      ),
      place,
    );
  }

  /** Shows the runs that follow. */
  async function next() {
    const page = await packed(cursor);
    cursor = page.next_cursor;
    items.push(...page.items);
    list.append(...page.items.map(line));
    more.hidden = !cursor;
    return page.items;
  }

  /** Makes the file of each run, those that are not shown yet too, a few at once, and offers each once it is there. */
  async function all() {
    const of = chosen();
    if (!of) return;
    make.disabled = true;
    const { type, format, set = {} } = of;
    const materials = request?.template?.materials ? null : materialsFor(of);
    const query = new URLSearchParams({ format, ...set, ...(materials ? { materials } : {}) });
    const here = places;
    const waiting = [...items];
    const one = async () => {
      for (let job = waiting.shift(); job && list.isConnected && here === places; job = waiting.shift()) {
        const place = /** @type {HTMLElement} */ (here.get(job));
        try {
          replace(place, badge("running"));
          await send("POST", `${job.links.exports}/${type}?${query}`);
          replace(place, await made(job, type, format));
        } catch (error) {
          replace(place, h("span", { class: "fault" }, /** @type {Error} */ (error).message));
        }
      }
    };
    do await Promise.all(Array.from({ length: AT_ONCE }, one));
    while (cursor && list.isConnected && here === places && waiting.push(...(await next())));
    make.disabled = false;
    announce("The files are finished");
  }

  /** Waits for the newest file of a type and format. @param {any} job @param {string} type @param {string} format */
  async function made(job, type, format) {
    for (;;) {
      const page = await get(job.links.exports);
      const item = page.items.find((/** @type {any} */ e) => e.type === type && e.options.format === format);
      if (item?.state === "succeeded")
        return [h("span", { class: "muted" }, `${bytes(item.bytes)} `), link(item.links.file)];
      if (!item || item.error) return h("span", { class: "fault" }, item?.error?.detail ?? "not made");
      await new Promise((resolve) => setTimeout(resolve, 500));
    }
  }

  replace(
    choices,
    PROGRAMS.map((one) =>
      h(
        "label",
        {},
        h("input", { type: "radio", name: "runs-program", checked: one === program, onchange: () => choose(one) }),
        one.name,
      ),
    ),
  );
  choose(program);
  return h(
    "section",
    { class: "panel stack", "aria-labelledby": "runs-files-title" },
    h("h2", { id: "runs-files-title" }, "Files by program"),
    choices,
    h("div", { class: "row" }, h("div", { class: "field" }, h("label", { for: "runs-file" }, "File"), file), make),
    h("p", { class: "hint" }, "With the options that a job's page starts from; other options are chosen there."),
    items.length ? list : h("p", { class: "muted" }, "No run has a packing yet."),
    more,
  );
}

/** The request as JSON. @param {any} request */
export function requestPart(request) {
  const shown = JSON.stringify(request, null, 2);
  const words = h("pre", { tabindex: "0", "aria-label": "Request as JSON" });
  text(words, shown.length > 200_000 ? `${shown.slice(0, 200_000)}\n...` : shown);
  return h(
    "section",
    { class: "panel stack tight", "aria-labelledby": "study-request-title" },
    h("h2", { id: "study-request-title" }, "Request"),
    words,
  );
}
