/** A row of the list of jobs: what the job packs, its state, and what can be done with it. */
import { absolute } from "./address.js";
import { get, send } from "./api.js";
import { confirmDeletion } from "./deletion.js";
import { badge, duration, h, number, percent, replace, when } from "./dom.js";
import { cancelJob, maximizesBy } from "./job-cancel.js";
import { partialBadge } from "./job-ends.js";
import { announce, report } from "./shell.js";

/** Numbers stay with their units. @param {string} words */
const kept = (words) => words.replace(/(\d) (mm|%)/g, "$1\u202f$2");

/** What a job is called: by its name, else by its mix. @param {any} job */
export const titleOf = (job) => job.name || kept(job.overview?.title ?? "") || `Job ${job.id.slice(-8)}`;

/** Whether a job waits or runs. @param {any} job */
export const isOpen = (job) => job.state === "queued" || job.state === "running";

/** What is said before jobs are deleted. */
export const ALSO = "The result and all files that were made of it are deleted, too.";

/**
 * @param {any} first
 * @param {{changed: () => void, chosen: Set<string>, choose: () => void}} list what its rows share: `chosen` has the
 *   IDs whose boxes are checked
 * @returns {import("./rows.js").Row<any>}
 */
export function makeRow(first, { changed, chosen, choose }) {
  const { id } = first;
  const cell = (/** @type {string} */ kind, /** @type {string} */ label) =>
    h("td", { role: "cell", class: kind, "data-label": label });
  const box = h("input", {
    type: "checkbox",
    onchange: () => {
      if (box.checked) chosen.add(id);
      else chosen.delete(id);
      choose();
    },
  });
  const name = h("th", { scope: "row", role: "rowheader" });
  const state = cell("state", "State");
  const owner = cell("wide owner", "Owner");
  const mix = ["Curve", "Specimen", "Fraction", "Shape", "Gap"].map((label) =>
    cell(label === "Fraction" ? "wide number" : "wide", label),
  );
  const grains = cell("wide number", "Grains");
  const times = cell("wide", "Submitted");
  const actions = cell("actions-cell", "");
  const row = h(
    "tr",
    { role: "row" },
    h("td", { role: "cell", class: "box" }, box),
    name,
    state,
    mix,
    grains,
    times,
    owner,
    actions,
  );
  let version = "";
  return {
    row,
    show(job) {
      box.checked = chosen.has(id);
      const { progress, overview } = job;
      const waits = job.waiting?.detail;
      const now = `${job.updated_at} ${job.name} ${job.state} ${progress?.fraction} ${job.cancel_requested} ${job.finish_requested} ${waits} ${job.expires_at}`;
      if (now === version) return;
      version = now;
      box.setAttribute("aria-label", `Choose ${titleOf(job)}`);
      const labels = Object.entries(job.labels);
      replace(
        name,
        h("a", { class: "name", href: absolute(`/jobs/${id}`) }, h("bdi", {}, titleOf(job))),
        job.name && overview && h("div", { class: "hint narrow" }, kept(overview.title)),
        h(
          "div",
          { class: "hint" },
          `seed ${job.seed}`,
          job.study_id && " · ",
          job.study_id && h("a", { href: absolute(`/studies/${job.study_id}`) }, "study"),
          job.study_id && `, point ${job.point}`,
          job.submitted_by && [" · by ", h("bdi", {}, job.submitted_by)],
        ),
        labels.length > 0 &&
          h(
            "div",
            { class: "labels" },
            labels.map(([key, value]) =>
              h(
                "a",
                { class: "tag", href: absolute(`/jobs?${new URLSearchParams({ label: `${key}=${value}` })}`) },
                h("bdi", {}, `${key} = ${value}`),
              ),
            ),
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
      replace(owner, job.owner && h("bdi", {}, job.owner), job.shared && h("div", { class: "hint" }, "shared"));
      const fraction = overview?.volume_fraction;
      const values = overview
        ? [
            kept(overview.curve),
            kept(overview.specimen),
            fraction === null ? "\u2013" : percent(fraction, fraction < 0.0995 ? 1 : 0),
            overview.shape,
            kept(overview.gap),
          ]
        : mix.map(() => "");
      mix.forEach((one, i) => replace(one, values[i]));
      const { summary } = job.result ?? {};
      replace(grains, summary && number(summary.grains, 1));
      const end = job.finished_at ? Date.parse(job.finished_at) : Date.now();
      const took = job.started_at && job.state !== "queued" ? duration((end - Date.parse(job.started_at)) / 1000) : "";
      replace(
        times,
        h("div", { class: "nowrap" }, when(job.created_at)),
        took && h("div", { class: "hint" }, `took ${took}`),
        job.expires_at && h("div", { class: "hint" }, "expires ", when(job.expires_at)),
      );
      const focus =
        document.activeElement?.closest("tr") === row ? document.activeElement?.getAttribute("data-do") : null;
      replace(actions, buttons(job, changed));
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

/** What can be done with a job in its state. @param {any} job @param {() => void} changed */
function buttons(job, changed) {
  const name = titleOf(job);
  const one = (/** @type {string} */ what, /** @type {string} */ kind, /** @type {() => Promise<any>} */ act) =>
    h(
      "button",
      {
        type: "button",
        class: "quiet",
        "data-do": kind,
        "aria-label": `${what}: ${name}`,
        onclick: () => act().then(changed, report),
      },
      what,
    );
  const path = `/v1/jobs/${job.id}`;
  return [
    isOpen(job) &&
      !job.cancel_requested &&
      one("Cancel", "cancel", async () => {
        const done = await cancelJob(job, maximizesBy(job.overview));
        if (done) announce(`${name}: ${done.words}`);
      }),
    (job.state === "cancelled" || job.error?.can_retry) && one("Retry", "retry", () => send("POST", `${path}/retry`)),
    one("Run again", "change", async () => {
      const [{ address }, request] = await Promise.all([import("./form-address.js"), get(`${path}/request`)]);
      location.assign(address(request));
    }),
    !isOpen(job) &&
      one("Delete", "delete", async () => {
        if (!(await confirmDeletion({ one: "job", name, size: job.result?.bytes, also: ALSO }))) return;
        await send("DELETE", path);
        announce(`Deleted: ${name}`);
      }),
  ].filter(Boolean);
}
