/**
 * The grading curve of a request, drawn between the standard curves A, B and C of the same largest size (DIN 1045-2).
 * Curves through sieves are linear in ln d, so that they are straight between two sieves on this axis; Fuller's curve
 * is (d / d_max)^q. The part right of the cut-off is what is placed.
 */
import { number, s } from "./dom.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [400, 238, 34, 12, 24, 34];
const TICKS = [0.063, 0.125, 0.25, 0.5, 1, 2, 4, 8, 16, 31.5, 63, 125];

/** @typedef {[number, number][]} Points sieve in mm and share passing, from fine to coarse */

/**
 * @param {any} mix as in a request; the curve of several aggregates is the mean of theirs by their shares
 * @param {{name: string, points: Points}[]} curves the standard curves
 * @returns {Points} empty where there is no curve to draw
 */
export function pointsOf(mix, curves) {
  if (!Array.isArray(mix?.aggregates)) return ofOne(mix?.grading, curves);
  const all = mix.aggregates.map((/** @type {any} */ one) => ({
    share: Number(one?.share ?? one?.mass_kg_m3 / one?.density_kg_m3),
    points: ofOne(one?.grading, curves),
  }));
  // Masses give volumes in a cubic metre of concrete.
  const byMass = mix.aggregates.some((/** @type {any} */ one) => one?.mass_kg_m3 !== undefined);
  const sum = byMass ? all.reduce((/** @type {number} */ to, /** @type {any} */ { share }) => to + share, 0) : 1;
  /** @type {{share: number, points: Points}[]} */
  const parts = all.map((/** @type {any} */ one) => ({ ...one, share: one.share / sum }));
  if (!parts.every(({ share, points }) => share > 0 && points.length)) return [];
  const sieves = new Set(parts.flatMap(({ points }) => points.map(([d]) => d)));
  return [...sieves]
    .sort((a, b) => a - b)
    .map((d) => [d, parts.reduce((sum, { share, points }) => sum + share * at(points, d), 0)]);
}

/** @param {any} grading as in a request @param {{name: string, points: Points}[]} curves @returns {Points} */
function ofOne(grading, curves) {
  const d = Number(grading?.d_max_mm);
  const q = Number(grading?.exponent);
  switch (grading?.type) {
    case "standard":
      return curves.find((curve) => curve.name === grading.name)?.points ?? [];
    case "fuller":
      return d > 0 && q > 0
        ? Array.from({ length: 41 }, (_, i) => {
            const share = 10 ** (-2.5 * (1 - i / 40));
            return /** @type {[number, number]} */ ([d * share, share ** q]);
          })
        : [];
    case "sieves":
      return (grading.points ?? []).filter((/** @type {any} */ p) => p?.[0] > 0 && p[1] >= 0 && p[1] <= 1);
    case "classes": {
      let passing = 0;
      return (Array.isArray(grading.classes) ? grading.classes : []).flatMap((/** @type {any} */ one) => [
        [one.d_min_mm, passing],
        [one.d_max_mm, (passing += one.mass_fraction)],
      ]);
    }
    case "monodisperse":
      return grading.diameter_mm > 0
        ? [
            [grading.diameter_mm, 0],
            [grading.diameter_mm, 1],
          ]
        : [];
    default:
      return [];
  }
}

/**
 * @param {Points} points
 * @param {number | null} cut_off in mm
 * @param {{name: string, points: Points}[]} curves the standard curves
 * @returns {SVGElement | null}
 */
export function curve(points, cut_off, curves) {
  const d_max = points.at(-1)?.[0];
  if (!d_max) return null;
  const others = family(d_max, curves);
  const all = [...points, ...others.flatMap((other) => other.points)].map(([d]) => d).filter((d) => d > 0);
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
 * The standard curves of the next largest size.
 * @param {number} d_max
 * @param {{name: string, points: Points}[]} curves
 */
function family(d_max, curves) {
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
