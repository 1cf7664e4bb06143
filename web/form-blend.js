/** The shares of several aggregates whose blend comes nearest to a grading of a standard (`POST /v1/mixes/blend`). */
import { send } from "./api.js";
import { h, number, text } from "./dom.js";

/** What became of the last blend, for the chart that follows it. */
let said = "";

/** What the last blend said; it is said once. */
export function blended() {
  const words = said;
  said = "";
  return words;
}

/**
 * A button that sets the shares, where a mix has several aggregates with shares.
 * @param {any} mix as in a request
 * @param {() => import("./form-standards.js").Standard | undefined} chosen what the shares are to meet
 * @param {Element} words where a fault is said
 * @param {(pointer: string, value: any) => void} use
 */
export function blendButton(mix, chosen, words, use) {
  const aggregates = mix?.aggregates;
  const has = (/** @type {any} */ one) => one?.share !== undefined && one.grading?.type;
  if (!Array.isArray(aggregates) || aggregates.length < 2 || !aggregates.every(has)) return null;
  const blend = async () => {
    const grading = chosen();
    if (!grading) return text(words, "Choose a grading above first.");
    const isCurve = grading.limits.every(([, low, high]) => low === high);
    const { standard, name } = grading;
    const stockpile = (/** @type {any} */ { name: of, grading: curve, density_kg_m3 }) => ({
      name: of,
      grading: curve,
      density_kg_m3,
    });
    try {
      const answer = await send("POST", "/v1/mixes/blend", {
        aggregates: aggregates.map(stockpile),
        target: { type: isCurve ? "standard" : "band", standard, name },
      });
      const shared = aggregates.map((one, i) => ({ ...one, share: Number(answer.aggregates[i].share.toPrecision(6)) }));
      const none = shared.map((one, i) => (one.share ? "" : one.name || `aggregate ${i + 1}`)).filter(Boolean);
      said = [
        `Shares set: the residual is at most ${number(100 * answer.largest_residual, 2)}\u202f%.`,
        none.length && `Removed, for the blend is nearest without: ${none.join(", ")}.`,
      ]
        .filter(Boolean)
        .join(" ");
      use(
        "/mix/aggregates",
        shared.filter((one) => one.share),
      );
    } catch (error) {
      text(words, error instanceof Error ? error.message : String(error));
    }
  };
  return h("button", { type: "button", class: "quiet", id: "blend", onclick: blend }, "Set the shares to meet it");
}
