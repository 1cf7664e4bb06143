/** Cancelling a job: whose run has a valid packing already, it is asked whether that is kept. */
import { send } from "./api.js";
import { h } from "./dom.js";

/**
 * Whether a run has a packing that is valid, and goes on only to make it better.
 * @param {any} job
 * @param {boolean} maximizes whether the distance or the volume fraction is to be as large as possible
 */
export const hasValidPacking = (job, maximizes) =>
  maximizes && job.state === "running" && Boolean(job.progress) && job.progress.step !== "sampling";

/**
 * Asks what becomes of the packing that a run has.
 * @param {number} [count] of such runs
 * @returns {Promise<"keep" | "drop" | null>} `null`: the run goes on
 */
export function askToKeep(count = 1) {
  return new Promise((resolve) => {
    /** @type {"keep" | "drop" | null} */
    let answer = null;
    const button = (/** @type {string} */ words, /** @type {"keep" | "drop" | null} */ what, kind = "") =>
      h(
        "button",
        {
          type: "button",
          class: kind,
          autofocus: what === "keep",
          onclick: () => {
            answer = what;
            dialog.close();
          },
        },
        words,
      );
    const dialog = h(
      "dialog",
      { class: "small", "aria-labelledby": "keep-title", "aria-describedby": "keep-text" },
      h("h2", { id: "keep-title" }, count === 1 ? "Keep the packing?" : `Keep ${count} packings?`),
      h(
        "p",
        { id: "keep-text" },
        "The run has a valid packing and goes on only to make it better. To cancel drops the packing; to stop keeps it.",
      ),
      h(
        "div",
        { class: "actions" },
        button("Stop and keep", "keep", "primary"),
        button("Cancel and drop", "drop", "danger"),
        button("Go on", null),
      ),
    );
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(answer);
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}

/**
 * Cancels a job, or ends its run with the packing that it has.
 * @param {any} job
 * @param {boolean} maximizes
 * @returns {Promise<{job: any, words: string} | null>} the job as it is then, and what was done; `null`: nothing
 */
export async function cancelJob(job, maximizes) {
  const answer = hasValidPacking(job, maximizes) ? await askToKeep() : "drop";
  if (!answer) return null;
  const kept = answer === "keep";
  return {
    job: await send("POST", `/v1/jobs/${job.id}/${kept ? "finish" : "cancel"}`),
    words: kept ? "The run ends with the packing that it has reached" : "The job is being cancelled",
  };
}

/** Whether a request is one for as much as possible. @param {any} request */
export const maximizes = (request) =>
  request?.distance?.type === "maximize" || request?.mix?.volume_fraction === "maximize";

/** The same by the overview of a job in a list. @param {any} overview */
export const maximizesBy = (overview) => overview?.gap === "largest" || /, densest,/.test(overview?.title ?? "");
