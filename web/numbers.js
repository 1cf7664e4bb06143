/**
 * Numbers as people type them: with a point or a comma as decimal mark, one by one or in lists. A page never sends
 * another number than was typed, and a list that can be read in two ways is a fault.
 */

/** Largest whole number from 0 on up to which all can be told apart, here and in requests. */
const MOST = Number.MAX_SAFE_INTEGER;

/**
 * The number that was typed; else the text, for the server to refuse.
 * @param {string} words
 * @returns {number | string}
 */
export function numberOf(words) {
  const typed = words.trim().replace("\u2212", "-");
  const plain = /^[-+]?\d*,\d+(e[-+]?\d+)?$/i.test(typed) ? typed.replace(",", ".") : typed;
  const value = Number(plain);
  return plain && Number.isFinite(value) ? value : words;
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
 * Values that are offered in place of one that cannot be: the number before its unit, what a percentage is as a share,
 * and the bound that was passed.
 * @param {string} words what was typed
 * @param {string} fault as the service says it, "must be at least 0.1 and at most 1"
 * @param {string} unit of the field
 * @returns {string[]}
 */
export function offersOf(words, fault, unit) {
  const [, figure = "", mark = ""] = /^([-+\d.,e]+)\s*(\D*)$/i.exec(words.trim()) ?? [];
  const value = numberOf(figure);
  if (!fault || typeof value !== "number") return [];
  const found = (/** @type {RegExp} */ pattern) => Number(pattern.exec(fault)?.[1] ?? NaN);
  const least = found(/(?:at least|number from|largest grain is(?: \S+ mm \()?) ?(-?\d[-+.\de]*)/);
  const most = found(/(?:at most|from \S+ to) (-?\d[-+.\de]*)/);
  const isShare = mark === "%" ? unit !== "%" : most === 1 && value > 1 && value <= 100;
  if (isShare) return [rounded(value / 100), ...(mark ? [] : ["1"])];
  if (mark && mark === unit) return [String(value)];
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
