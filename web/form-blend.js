/** The shares of several aggregates whose blend comes nearest to a grading of a standard (`POST /v1/mixes/blend`). */
import { send } from "./api.js";
import { number } from "./dom.js";

/**
 * Finds the shares.
 * @param {any[]} aggregates as in a request
 * @param {import("./form-standards.js").Standard} grading what they are to meet
 * @returns {Promise<{aggregates: any[], said: string}>} those that have a share, and what became of them
 */
export async function blend(aggregates, { standard, name, limits }) {
  const isCurve = limits.every(([, low, high]) => low === high);
  const stockpile = (/** @type {any} */ { name: of, grading, density_kg_m3 }) => ({ name: of, grading, density_kg_m3 });
  const answer = await send("POST", "/v1/mixes/blend", {
    aggregates: aggregates.map(stockpile),
    target: { type: isCurve ? "standard" : "band", standard, name },
  });
  const shared = aggregates.map((one, i) => ({ ...one, share: Number(answer.aggregates[i].share.toPrecision(6)) }));
  const none = shared.map((one, i) => (one.share ? "" : one.name || `aggregate ${i + 1}`)).filter(Boolean);
  const residual = `Shares set: the residual is at most ${number(100 * answer.largest_residual, 2)}\u202f%.`;
  const removed = none.length ? ` Removed, for the blend is as near without: ${none.join(", ")}.` : "";
  return { aggregates: shared.filter((one) => one.share), said: residual + removed };
}
