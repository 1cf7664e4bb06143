/** The growth of the grains as a chart: volume fraction, or distance, against time. Drawn as SVG. */
import { number, s } from "./dom.js";

const [WIDTH, HEIGHT] = [720, 260];
const MARGIN = { left: 56, right: 16, top: 30, bottom: 40 };

/**
 * Round numbers from `low` to `high`, about `count` of them.
 * @param {number} low
 * @param {number} high
 * @param {number} count
 */
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((k) => k * power >= rough) ?? 10);
  const list = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) list.push(i * step);
  return list;
}

/**
 * @typedef {{t: number, y: number}} Point `t` in s
 * @param {Point[]} points in the order of time
 * @param {{label: string, target?: number | null}} axis what is drawn, with its unit
 * @returns {SVGSVGElement}
 */
export function growthChart(points, { label, target }) {
  const end = Math.max(1e-3, ...points.map((p) => p.t));
  const first = Math.min(...points.map((p) => p.t));
  const start = first < end ? first : 0;
  const values = points.map((p) => p.y).concat(target ?? []);
  let [low, high] = [Math.min(...values), Math.max(...values)];
  const room = (high - low || Math.abs(high) || 1) * 0.08;
  [low, high] = [Math.max(0, low - room), high + room];
  const x = (/** @type {number} */ t) =>
    MARGIN.left + ((t - start) / (end - start)) * (WIDTH - MARGIN.left - MARGIN.right);
  const y = (/** @type {number} */ v) =>
    HEIGHT - MARGIN.bottom - ((v - low) / (high - low)) * (HEIGHT - MARGIN.top - MARGIN.bottom);
  const [bottom, right] = [HEIGHT - MARGIN.bottom, WIDTH - MARGIN.right];
  const line = points.map((p, i) => `${i ? "L" : "M"}${x(p.t).toFixed(1)} ${y(p.y).toFixed(1)}`).join("");
  const last = points.at(-1);
  const words = last
    ? `${label}: ${number(last.y, 4)} after ${number(last.t, 3)} s${target ? `, target ${number(target, 4)}` : ""}.`
    : label;
  return s(
    "svg",
    { class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words },
    ticks(low, high, 5)
      .map((v) => [
        s("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(v), y2: y(v) }),
        s("text", { x: MARGIN.left - 8, y: y(v) + 4, "text-anchor": "end" }, number(v, 4)),
      ])
      .flat(),
    ticks(start, end, 6)
      .map((t) => [
        s("line", { class: "axis", x1: x(t), x2: x(t), y1: bottom, y2: bottom + 5 }),
        s("text", { x: x(t), y: bottom + 19, "text-anchor": "middle" }, number(t, 4)),
      ])
      .flat(),
    s("line", { class: "axis", x1: MARGIN.left, x2: right, y1: bottom, y2: bottom }),
    s("text", { x: right, y: HEIGHT - 4, "text-anchor": "end" }, "time, s"),
    s("text", { x: 0, y: 14 }, label),
    target ? s("line", { class: "other", x1: MARGIN.left, x2: right, y1: y(target), y2: y(target) }) : null,
    line ? s("path", { class: "main", d: line }) : null,
    last ? s("circle", { cx: x(last.t), cy: y(last.y), r: 3.5, fill: "var(--accent)" }) : null,
  );
}
