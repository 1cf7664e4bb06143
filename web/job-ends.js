/** How a run ended that kept its packing before its target, as a mark and in words. */
import { badge, number, percent, quantity } from "./dom.js";

/** Why a run ended before its target, by the reason in its result. @type {Record<string, string>} */
const REASONS = {
  time_limit: "at its limit of time",
  event_limit: "at its limit of events",
  stalled: "because its grains jammed",
  saturated: "because no place was left for a grain",
  timed_out: "at the time limit of the job",
  finished: "because a client asked for what it had",
};

/** The mark of a packing that is partial; nothing for any other. @param {any} summary of a result, or none */
export const partialBadge = (summary) => (summary?.partial ? badge("partial") : null);

/**
 * How far a partial packing came, in one sentence.
 * @param {any} partial of the summary of a result
 */
export function partialWords(partial) {
  const {
    reason,
    volume_fraction_requested: asked,
    volume_fraction_reached: reached,
    distance_mm_requested: gap,
    distance_mm_reached: kept,
    size_scale: scale,
    grains_requested: wanted,
    grains_placed: placed,
  } = partial;
  return [
    `Partial packing: the run ended ${REASONS[reason] ?? reason}, at a volume fraction of ${percent(reached, 2)}`,
    asked === null || asked === undefined ? "" : ` of ${percent(asked, 2)}`,
    gap > 0 && kept !== gap ? `, with a distance of ${quantity(kept, "mm", 3)} of ${quantity(gap, "mm", 3)}` : "",
    placed < wanted ? `, with the ${number(placed)} largest of ${number(wanted)} grains` : "",
    scale !== 1 ? `, with all sizes times ${number(scale, 5)}` : "",
    ".",
  ].join("");
}
