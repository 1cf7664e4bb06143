/** What the list of studies and the page of one study have in common: counts in words, and what can be done. */
import { get, send } from "./api.js";
import { confirmDeletion } from "./deletion.js";
import { h, number } from "./dom.js";
import { address } from "./form-address.js";
import { announce, confirm, report } from "./shell.js";

/** @param {any} study */
export const nameOf = (study) => study.name || `Study ${study.id.slice(-8)}`;

/** How many jobs are in each state, in words. @param {any} study */
export function counts(study) {
  const words = Object.entries(study.counts)
    .filter(([, count]) => count > 0)
    .map(([state, count]) => `${number(count, 1)} ${state}`);
  return words.join(", ");
}

/**
 * The answers of `canSucceedAgain`, by the study and its number of failed jobs.
 * @type {Map<string, Promise<boolean>>}
 */
const known = new Map();

/**
 * Whether a second run of a failed job can succeed; of many failed jobs the latest hundred are looked at.
 * @param {any} study
 */
function canSucceedAgain(study) {
  const key = `${study.id} ${study.counts.failed}`;
  let asked = known.get(key);
  if (!asked) {
    asked = get(`/v1/studies/${study.id}/jobs?state=failed&limit=100`).then(({ items, next_cursor }) =>
      Boolean(next_cursor || items.some((/** @type {any} */ job) => job.error?.can_retry)),
    );
    asked.catch(() => known.delete(key));
    known.set(key, asked);
  }
  return asked;
}

/**
 * The buttons of a study.
 * @param {any} study
 * @param {() => void} changed called after each action
 * @param {{pause: () => void, resume: () => void, gone: () => void}} [page] of this study alone: it asks for nothing
 *   while the study is being deleted
 */
export function buttons(study, changed, page = { pause() {}, resume() {}, gone: changed }) {
  const name = nameOf(study);
  const path = `/v1/studies/${study.id}`;
  const one = (/** @type {string} */ what, /** @type {() => Promise<any>} */ act) =>
    h(
      "button",
      { type: "button", class: "quiet", "aria-label": `${what}: ${name}`, onclick: () => act().then(changed, report) },
      what,
    );
  const { failed, cancelled, queued, running } = study.counts;
  const retryFailed = one("Retry failed", () => send("POST", `${path}/retry?state=failed`));
  retryFailed.hidden = true;
  if (failed > 0)
    canSucceedAgain(study).then((can) => {
      retryFailed.hidden = !can;
    }, report);
  return [
    queued + running > 0 &&
      one("Cancel", async () => {
        if (
          !(await confirm(
            "Cancel this study?",
            `${number(queued + running, 1)} jobs that have not ended are cancelled. Results stay.`,
            "Cancel the study",
            "Go on",
          ))
        )
          return;
        await send("POST", `${path}/cancel`);
        announce(`Cancelled: ${name}`);
      }),
    failed > 0 && retryFailed,
    cancelled > 0 && one("Retry cancelled", () => send("POST", `${path}/retry?state=cancelled`)),
    one("Run again", async () => {
      const { request } = await get(`${path}?include=request`);
      if (request.template) location.assign(address(request));
      else report(new Error("This study is a list of jobs, which the form cannot show."));
    }),
    study.finished_at &&
      h(
        "button",
        { type: "button", class: "quiet", "aria-label": `Delete: ${name}`, onclick: () => remove().catch(report) },
        "Delete",
      ),
  ].filter(Boolean);

  async function remove() {
    const also = `Its ${number(study.jobs, 1)} jobs are deleted with their results, too.`;
    const { totals } = await get(`/v1/jobs?study=${study.id}&limit=1&totals=true`);
    if (!(await confirmDeletion({ one: "study", name, size: totals.bytes, also }))) return;
    page.pause();
    try {
      await send("DELETE", path);
      announce(`Deleted: ${name}`);
      page.gone();
    } catch (error) {
      report(error);
      page.resume();
    }
  }
}
