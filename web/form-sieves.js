/**
 * Sieves as people have them: two columns, typed or pasted from a spreadsheet, sieve in mm and mass passing. Columns
 * are separated by a tab, a semicolon, spaces, or a comma where the decimal mark is a point. The rows may fall or
 * rise, and a head row is left out. Masses are in percent if any is above 1, else shares.
 */

/** @param {string} words */
const decimal = (words) => {
  const plain = words
    .trim()
    .replace(/\s*(%|mm)$/, "")
    .replace(",", ".");
  return plain === "" ? NaN : Number(plain);
};

/**
 * @param {string} words
 * @returns {{points: [number, number][], fault: string}} from fine to coarse, masses as shares; `fault` is empty
 *   where every row was understood
 */
export function sieves(words) {
  /** @type {[number, number][]} */
  const points = [];
  const rows = words.split(/\r?\n/);
  let seen = 0;
  for (const [index, row] of rows.entries()) {
    if (!row.trim()) continue;
    seen += 1;
    const cells = columns(row);
    const [sieve = NaN, passing = NaN] = cells.map(decimal);
    if (Number.isFinite(sieve) && Number.isFinite(passing) && cells.length === 2) points.push([sieve, passing]);
    else if (seen > 1 || /\d/.test(row)) {
      return {
        points: [],
        fault: `Row ${index + 1}, "${row.trim()}": two numbers are needed, sieve in mm and mass passing.`,
      };
    }
  }
  if (points.length < 2) return { points: [], fault: "At least two sieves are needed." };
  points.sort((a, b) => a[0] - b[0]);
  const inPercent = points.some(([, passing]) => passing > 1);
  for (const point of points) if (inPercent) point[1] = Number((point[1] / 100).toPrecision(12));
  return { points, fault: "" };
}

/** @param {string} row */
function columns(row) {
  const line = row.trim();
  for (const mark of [/\t+/, /\s*[;|]\s*/, /,\s+/, /\s+/]) {
    if (mark.test(line)) return line.split(mark).filter((cell) => cell && cell !== "%" && cell !== "mm");
  }
  return line.split(",");
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
