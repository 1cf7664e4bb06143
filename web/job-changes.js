/** What can be done after a job that ended short of its target: its request with changes that can succeed, as links. */
import { absolute } from "./address.js";
import { h } from "./dom.js";

/** @typedef {{title: string, patch: any}} Change a change of a request: its words, and a JSON merge patch (RFC 7396) */

/**
 * Changes of the request of a partial packing that can reach more.
 * @param {any} partial of the summary of a result
 * @param {any} request
 * @returns {Change[]}
 */
export function changesOf(partial, request) {
  const { reason, volume_fraction_reached: reached, volume_fraction_requested: asked } = partial;
  const { time_s, events, sweeps } = request.method?.stop ?? {};
  const fraction = request.mix?.volume_fraction;
  if (reason === "time_limit" && time_s)
    return [{ title: "Twice the time limit", patch: { method: { stop: { time_s: 2 * time_s } } } }];
  if (reason === "event_limit" && (events || sweeps)) {
    const stop = events ? { events: 2 * events } : { sweeps: 2 * sweeps };
    return [{ title: `Twice the limit of ${events ? "events" : "sweeps"}`, patch: { method: { stop } } }];
  }
  if (reason === "timed_out" && request.timeout_s)
    return [{ title: "Twice the time limit", patch: { timeout_s: 2 * request.timeout_s } }];
  if (reason === "finished") return [{ title: "The same to its end", patch: {} }];
  if (typeof fraction !== "number" || !(asked > 0) || !(reached < asked)) return [];
  const lower = Math.floor(((980 * fraction * reached) / asked) * (1 + 1e-12)) / 1000;
  return lower > 0 ? [{ title: `A volume fraction of ${lower}`, patch: { mix: { volume_fraction: lower } } }] : [];
}

/** A document with a JSON merge patch (RFC 7396). @param {any} document @param {any} patch @returns {any} */
export function patched(document, patch) {
  if (typeof patch !== "object" || patch === null || Array.isArray(patch)) return patch;
  const isObject = typeof document === "object" && document !== null && !Array.isArray(document);
  const merged = new Map(Object.entries(isObject ? document : {}));
  for (const [name, value] of Object.entries(patch)) {
    if (value === null) merged.delete(name);
    else merged.set(name, patched(merged.get(name), value));
  }
  return Object.fromEntries(merged);
}

/**
 * Links to the form with the request as it becomes by each change.
 * @param {Change[]} changes
 * @param {any} request
 * @param {(error: unknown) => void} report
 */
export function changeLinks(changes, request, report) {
  if (!changes.length) return null;
  const links = changes.map(({ title, patch }) => {
    const link = h("a", { class: "button", href: absolute("/") }, title);
    const fill = async () => {
      const { address } = await import("./form-address.js");
      link.href = address(patched(request, patch));
    };
    for (const event of ["pointerenter", "focus"])
      link.addEventListener(event, () => fill().catch(report), { once: true });
    link.addEventListener("click", (event) => {
      if (link.hash) return;
      event.preventDefault();
      fill().then(() => location.assign(link.href), report);
    });
    return link;
  });
  return h("div", { class: "actions" }, h("span", {}, "What can succeed:"), links);
}
