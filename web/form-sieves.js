/**
 * The points of a curve in their field: a row each, the sieve in mm and what passes it in percent, as the page writes
 * them and people type them. Every other table is read by the service (`form-reading.js`).
 */

const NUMBER = /^(\d+[.,]?\d*|[.,]\d+)$/;

/** The cells of a row, parted by spaces, a tab or a semicolon. @param {string} row */
const cells = (row) => row.trim().split(/\s*;\s*|\s+/);

/**
 * Whether a text can be what somebody types as points, and is not done with: rows of at most two numbers.
 * @param {string} words
 */
export function areTyped(words) {
  const rows = words.split(/\r?\n/).filter((row) => row.trim());
  const isList = rows.length > 1 && rows.every((row) => cells(row).length === 1 && row.includes(","));
  return !isList && rows.every((row) => cells(row).length <= 2 && cells(row).every((cell) => NUMBER.test(cell)));
}

/**
 * @param {string} words
 * @returns {{points: [number, number][], fault: string}} from fine to coarse, masses as shares; `fault` is empty
 *   where every row was understood. Masses are in percent if any is above 1, else shares.
 */
export function sieves(words) {
  /** @type {[number, number][]} */
  const points = [];
  for (const [index, row] of words.split(/\r?\n/).entries()) {
    if (!row.trim()) continue;
    const [sieve = NaN, passing = NaN, ...more] = cells(row).map((cell) =>
      NUMBER.test(cell) ? Number(cell.replace(",", ".")) : NaN,
    );
    if (!Number.isFinite(sieve) || !Number.isFinite(passing) || more.length) {
      return {
        points: [],
        fault: `Row ${index + 1}, "${row.trim()}": two numbers are needed, sieve in mm and mass passing in %.`,
      };
    }
    points.push([sieve, passing]);
  }
  if (points.length < 2) return { points: [], fault: "At least two sieves are needed." };
  points.sort((a, b) => a[0] - b[0]);
  const inPercent = points.some(([, passing]) => passing > 1);
  for (const point of points) if (inPercent) point[1] = Number((point[1] / 100).toPrecision(12));
  return { points, fault: "" };
}

/**
 * The rows of points, in percent.
 * @param {any} points
 */
export const rowsOf = (points) =>
  Array.isArray(points)
    ? points
        .map((point) =>
          Array.isArray(point) && typeof point[1] === "number"
            ? `${point[0]}\t${Number((100 * point[1]).toPrecision(12))}`
            : JSON.stringify(point),
        )
        .join("\n")
    : "";
