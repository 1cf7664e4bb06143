/**
 * Numbers as people type them: with a point or a comma as decimal mark, one by one or in lists. A page never sends
 * another number than was typed, and a list that can be read in two ways is a fault.
 */

/** Largest whole number from 0 on up to which all can be told apart, here and in requests. */
const MOST = Number.MAX_SAFE_INTEGER;

/** What a value of a field with a unit is multiplied with where it has another one. @type {Record<string, any>} */
const FACTORS = {
  mm: { cm: 10, m: 1000, "\u00b5m": 0.001, "\u03bcm": 0.001 },
  s: { min: 60, h: 3600 },
  "kg/m\u00b3": { "kg/m3": 1 },
  // A share.
  "": { "%": 0.01 },
};

/**
 * The number that was typed, in the unit of its field where it has one: `100 mm`, `10 cm`, and of a share `50 %`. Else
 * the text, for the server to refuse.
 * @param {string} words
 * @param {string} [unit] of the field
 * @returns {number | string}
 */
export function numberOf(words, unit = "") {
  const typed = words.trim().replace("\u2212", "-");
  const [, figure = "", mark = ""] = /^([-+\d.,]+(?:e[-+]?\d+)?)\s*(\D.*)?$/i.exec(typed) ?? [];
  const value = Number(/^[-+]?\d*,\d+(e[-+]?\d+)?$/i.test(figure) ? figure.replace(",", ".") : figure || NaN);
  const factor = mark === unit || !mark ? 1 : FACTORS[unit]?.[mark];
  if (!Number.isFinite(value * factor)) return words;
  return factor === 1 ? value : Number(rounded(value * factor));
}

/**
 * What is wrong with a whole number that would be sent as another one; empty where nothing is.
 * @param {string} words
 */
export const faultOf = (words) =>
  /^[-+]?\d+$/.test(words.trim()) && !Number.isSafeInteger(Number(words))
    ? `${words.trim()} is out of range: whole numbers reach from -${MOST} to ${MOST}.`
    : "";

/**
 * Values that are offered in place of one that cannot be: what a percentage is as a share, and the bound that was
 * passed.
 * @param {string} words what was typed
 * @param {string} fault as the service says it, "must be at least 0.1 and at most 1"
 * @param {string} unit of the field
 * @returns {string[]}
 */
export function offersOf(words, fault, unit) {
  const value = numberOf(words, unit);
  if (!fault || typeof value !== "number") return [];
  const found = (/** @type {RegExp} */ pattern) => Number(pattern.exec(fault)?.[1] ?? NaN);
  const least = found(/(?:at least|number from|largest grain is(?: \S+ mm \()?) ?(-?\d[-+.\de]*)/);
  const most = found(/(?:at most|from \S+ to) (-?\d[-+.\de]*)/);
  if (most === 1 && value > 1 && value <= 100) return [rounded(value / 100), "1"];
  // What a mix states, and what of it is placed, are in proportion; the last digit is rounded down.
  const placed = found(/have a volume fraction of ([\d.]+):/);
  if (placed > most) return [rounded(Math.floor((value * most * 1e4) / placed) / 1e4)];
  if (value > most) return [String(most)];
  return value < least ? [String(least)] : [];
}

/** A number without what binary fractions add to it. @param {number} value */
const rounded = (value) => String(Number(value.toPrecision(12)));

/** @param {string} _ @param {any} value @param {{source?: string}} [context] how it was written, in newer browsers */
function exactly(_, value, context) {
  const fault = typeof value === "number" ? faultOf(context?.source ?? "") : "";
  if (fault) throw new Error(fault);
  return value;
}

/**
 * Reads JSON. A whole number that would become another one is refused.
 * @param {string} words
 * @returns {any}
 * @throws {Error} where it is no JSON, or has such a number
 */
export const parse = (words) => JSON.parse(words, exactly);

/**
 * The parts of a list. Semicolons, tabs and line breaks separate where there are any, and commas are decimal marks.
 * Else spaces and commas separate; a comma between two digits is what the list as a whole allows for.
 * @param {string} words
 * @returns {{parts: string[], fault: string}}
 */
export function listOf(words) {
  const typed = words.trim();
  if (/[;\t\n]/.test(typed)) {
    const parts = typed.split(/[;\t\n]/).map((part) => part.trim());
    return { parts: parts.filter(Boolean), fault: "" };
  }
  // Separators beyond doubt: spaces, and commas that are not between two digits.
  const parts = typed.split(/\s*,\s+|\s+,?|,(?!\d)|(?<!\d),/).filter(Boolean);
  if (!parts.some((part) => part.includes(","))) return { parts, fault: "" };
  const values = parts.flatMap((part) => part.split(","));
  const steps = values.slice(1).map((value, i) => Math.sign(Number(value) - Number(values[i])));
  const isSorted = steps.every((step) => step !== 0 && step === steps[0]);
  const hasPoints = typed.includes(".");
  const hasWhole = values.some((value) => /^[-+]?\d+$/.test(value));
  if (parts.length === 1 && (!hasWhole || (values.length > 2 && isSorted))) return { parts: values, fault: "" };
  const areDecimals = parts.every((part) => typeof numberOf(part) === "number" && part.includes(","));
  if (parts.length > 1 && areDecimals && !hasPoints && !isSorted) return { parts, fault: "" };
  return {
    parts: [],
    fault: `"${typed}" can be read in two ways: separate values by semicolons, as 0,4; 0,5, or write decimal points.`,
  };
}
