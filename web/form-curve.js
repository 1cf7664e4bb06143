/**
 * A grading curve, drawn beside the curves A, B and C of DIN 1045-2 of the same largest size, or over the band of a
 * grading of a standard. The passing is linear in ln d between two points, so that the lines are straight on this axis.
 * The part right of the cut-off is what is placed.
 */
import { number, s } from "./dom.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [400, 238, 34, 12, 24, 34];
const TICKS = [0.063, 0.125, 0.25, 0.5, 1, 2, 4, 8, 16, 31.5, 63, 125];

/** @typedef {[number, number][]} Points sieve in mm and share passing, from fine to coarse */

/**
 * @param {Points} points
 * @param {number | null} cut_off in mm
 * @param {import("./form-standards.js").Standard[]} standards the gradings of standards, or none
 * @param {import("./form-standards.js").Standard} [band] the one that is drawn as a band, in place of A, B and C
 * @returns {SVGElement | null}
 */
export function curve(points, cut_off, standards, band) {
  const d_max = points.at(-1)?.[0];
  if (!d_max) return null;
  const others = band ? [] : family(d_max, standards);
  const limits = band?.limits ?? [];
  const lower = limits.map(([d, low]) => /** @type {[number, number]} */ ([d, low]));
  const upper = limits.map(([d, , high]) => /** @type {[number, number]} */ ([d, high])).reverse();
  const all = [...points.map(([d]) => d), ...others.flatMap((other) => other.points.map(([d]) => d))];
  all.push(...limits.map(([d]) => d));
  const low = Math.log(Math.min(...all, d_max / 16));
  const high = Math.log(Math.max(...all));
  const x = (/** @type {number} */ d) => LEFT + ((Math.log(d) - low) / (high - low)) * (WIDTH - LEFT - RIGHT);
  const y = (/** @type {number} */ share) => HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM);
  const line = (/** @type {Points} */ of) =>
    of.map(([d, p], i) => `${i ? "L" : "M"}${x(d).toFixed(1)} ${y(p).toFixed(1)}`).join("");
  const from = cut_off && cut_off > 0 ? Math.min(WIDTH - RIGHT, Math.max(LEFT, x(cut_off))) : LEFT;
  const ticks = TICKS.filter((d) => Math.log(d) >= low - 1e-9 && Math.log(d) <= high + 1e-9);
  return s(
    "svg",
    { class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words(points, others) },
    s("rect", { class: "area", x: from, y: TOP, width: WIDTH - RIGHT - from, height: HEIGHT - TOP - BOTTOM }),
    limits.length && s("path", { class: "band", d: `${line(lower)}${line(upper).replace("M", "L")}Z` }),
    ...[0, 0.2, 0.4, 0.6, 0.8, 1].flatMap((share) => [
      s("line", { class: share ? "grid" : "axis", x1: LEFT, x2: WIDTH - RIGHT, y1: y(share), y2: y(share) }),
      s("text", { x: LEFT - 6, y: y(share) + 4, "text-anchor": "end" }, String(Math.round(100 * share))),
    ]),
    ...ticks.map((d) => s("text", { x: x(d), y: HEIGHT - BOTTOM + 15, "text-anchor": "middle" }, String(d))),
    s("text", { x: WIDTH - RIGHT, y: HEIGHT - 3, "text-anchor": "end" }, "sieve, mm"),
    s("text", { x: 2, y: 10 }, "passing, %"),
    ...others.flatMap((other) => [
      s("path", { class: "other", d: line(other.points) }),
      s(
        "text",
        { x: x(d_max / 4) - 4, y: y(at(other.points, d_max / 4)) - 4, "text-anchor": "end" },
        other.name.charAt(0),
      ),
    ]),
    s("path", { class: "main", d: line(points) }),
  );
}

/**
 * The curves of DIN 1045-2 of the next largest size.
 * @param {number} d_max
 * @param {import("./form-standards.js").Standard[]} standards
 */
function family(d_max, standards) {
  const curves = standards
    .filter((one) => one.standard === "DIN 1045-2")
    .map(({ name, limits }) => ({
      name,
      points: limits.map(([d, low]) => /** @type {[number, number]} */ ([d, low])),
    }));
  const largest = (/** @type {{points: Points}} */ curve_) => curve_.points.at(-1)?.[0] ?? 0;
  const size = curves
    .map(largest)
    .filter((d) => d >= 0.8 * d_max && d <= 2.1 * d_max)
    .sort((a, b) => Math.abs(Math.log(a / d_max)) - Math.abs(Math.log(b / d_max)))[0];
  return curves.filter((curve_) => largest(curve_) === size);
}

/** What passes a diameter. @param {Points} points @param {number} d */
export function at(points, d) {
  const next = points.findIndex(([sieve]) => sieve >= d);
  const b = points[next];
  const a = points[next - 1];
  if (!b) return 1;
  if (!a) return b[0] === d ? b[1] : 0;
  return a[1] + ((b[1] - a[1]) * Math.log(d / a[0])) / Math.log(b[0] / a[0]);
}

/** @param {Points} points @param {{name: string}[]} others */
function words(points, others) {
  const all = points
    .filter((_, i) => points.length < 12 || i % 8 === 0)
    .map(([d, p]) => `${number(d)} mm ${Math.round(100 * p)} %`);
  const names = others.map((other) => other.name).join(", ");
  return `Mass passing by sieve: ${all.join(", ")}.${names ? ` Beside it the standard curves ${names}.` : ""}`;
}
