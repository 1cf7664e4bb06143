/** Curves of several packings over each other, as SVG. */
import { number, s } from "./dom.js";

/** On a narrow screen the words keep their size. */
const [WIDTH, HEIGHT] = matchMedia("(max-width: 40rem)").matches ? [360, 260] : [760, 360];
const MARGIN = { left: 56, right: 16, top: 16, bottom: 44 };

/** Sieves that mark a logarithmic axis, mm. */
const SIEVES = [0.063, 0.125, 0.25, 0.5, 1, 2, 4, 8, 16, 32, 63, 125];

/** Colours of curves, told apart with any kind of colour blindness (Okabe and Ito, 2008), in both schemes. */
export const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7"];

/**
 * Round numbers from `low` to `high`, about `count` of them.
 * @param {number} low
 * @param {number} high
 * @param {number} count
 */
function ticks(low, high, count) {
  const rough = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((k) => k * power >= rough) ?? 10);
  const list = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) list.push(i * step);
  return list;
}

/**
 * The shares of the whole aggregate, that below the cut-off too, that pass each sieve of the size classes.
 * @param {any} summary of a result
 * @param {"target_volume_mm3" | "volume_mm3"} of the volume of a class, as requested or as packed
 * @returns {[number, number][]} sieve in mm and share, from fine to coarse
 */
export function passing({ classes, specimen_volume_mm3: specimen, volume_fraction_mixture: fraction }, of) {
  const coarse = classes.reduce((/** @type {number} */ sum, /** @type {any} */ one) => sum + one[of], 0);
  const total = Math.max(coarse, (specimen ?? 0) * (fraction ?? 0));
  let share = total > 0 ? 1 - coarse / total : 0;
  /** @type {[number, number][]} */
  const curve = classes[0] ? [[classes[0].d_min_mm, share]] : [];
  for (const one of classes) {
    share += total > 0 ? one[of] / total : 0;
    curve.push([one.d_max_mm, share]);
  }
  return curve;
}

/**
 * @typedef {{name: string, colour: string, dashed?: boolean, points: [number, number][]}} Series
 * @param {Series[]} series
 * @param {{x: string, y: string, words: string, log?: boolean}} axes names of the axes, the chart in words, and whether
 *   the abscissa is logarithmic
 * @returns {SVGSVGElement}
 */
export function overlay(series, { x: xName, y: yName, words, log = false }) {
  const points = series.flatMap((one) => one.points);
  const place = log ? Math.log : (/** @type {number} */ value) => value;
  const xs = points.map(([x]) => x);
  const ys = points.map(([, y]) => y);
  const [x0, x1] = [Math.min(...xs), Math.max(...xs)];
  const low = Math.min(...ys);
  const high = Math.max(...ys);
  const room = (high - low || Math.abs(high) || 1) * 0.04;
  const [y0, y1] = [Math.min(low, Math.max(0, low - room)), high + room];
  const span = place(x1) - place(x0) || 1;
  const right = WIDTH - MARGIN.right;
  const bottom = HEIGHT - MARGIN.bottom;
  const x = (/** @type {number} */ value) => MARGIN.left + ((place(value) - place(x0)) / span) * (right - MARGIN.left);
  const y = (/** @type {number} */ value) => bottom - ((value - y0) / (y1 - y0)) * (bottom - MARGIN.top);
  const marks = log ? SIEVES.filter((d) => d >= x0 * 0.999 && d <= x1 * 1.001) : ticks(x0, x1, WIDTH / 100);
  return s(
    "svg",
    { class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words },
    ticks(y0, y1, 5).flatMap((value) => [
      s("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(value), y2: y(value) }),
      s("text", { x: MARGIN.left - 8, y: y(value) + 4, "text-anchor": "end" }, number(value, 4)),
    ]),
    marks.flatMap((value) => [
      s("line", { class: "axis", x1: x(value), x2: x(value), y1: bottom, y2: bottom + 5 }),
      s("text", { x: x(value), y: bottom + 19, "text-anchor": "middle" }, number(value, 4)),
    ]),
    s("line", { class: "axis", x1: MARGIN.left, x2: right, y1: bottom, y2: bottom }),
    s("text", { x: right, y: HEIGHT - 6, "text-anchor": "end" }, xName),
    s("text", { x: 0, y: 11 }, yName),
    series.map(({ points: own, colour, dashed }) =>
      s("path", {
        d: own.map(([px, py], i) => `${i ? "L" : "M"}${x(px).toFixed(1)} ${y(py).toFixed(1)}`).join(""),
        fill: "none",
        stroke: colour,
        "stroke-width": dashed ? 1.25 : 2.25,
        "stroke-dasharray": dashed ? "5 4" : null,
      }),
    ),
  );
}
