/**
 * Eight grains of the shape that the fields say, as a picture, and five shapes to start from, from round to crushed.
 * The service draws the grains (`POST /v1/shapes`); this module projects them and shades their faces.
 */
import { send } from "./api.js";
import { h, number, replace, s } from "./dom.js";

/** Shapes to start from. @type {[string, any][]} */
const SHAPES = [
  ["Round", { type: "ellipsoid", ratios: { type: "constant", elongation: 0.9, flatness: 0.85 } }],
  ["Worn", { type: "polyhedron", faces: 40, rounding: 0.2, ratios: { type: "triangle", k: 0.7 } }],
  ["Blunt", { type: "polyhedron", faces: 24, rounding: 0.08, ratios: { type: "triangle", k: 0.55 } }],
  ["Angular", { type: "polyhedron", faces: 16, rounding: 0.02, ratios: { type: "triangle", k: 0.45 } }],
  ["Crushed", { type: "polyhedron", faces: 9, ratios: { type: "triangle", k: 0.35 } }],
];
/** Width of the place of a grain, whose volume is that of a sphere of diameter 1. */
const CELL = 1.7;
/** Towards the light, as the reader sees it: from the upper left, and from the reader. */
const LIGHT = [-0.42, 0.54, 0.73];

/** @typedef {{vertices: number[][], faces: number[][], elongation: number, flatness: number, sphericity: number}} Grain */

/** What was drawn last at each place, by its shape. @type {WeakMap<Element, string>} */
const shown = new WeakMap();
/** @type {WeakMap<Element, AbortController>} */
const asking = new WeakMap();

/**
 * Shows the grains of a shape.
 * @param {HTMLElement} place
 * @param {any} shape as in a request
 * @param {(shape: any) => void} take takes another shape
 */
export async function showShapes(place, shape, take) {
  const key = JSON.stringify(shape);
  if (shown.get(place) === key) return;
  shown.set(place, key);
  asking.get(place)?.abort();
  const here = new AbortController();
  asking.set(place, here);
  if (!place.firstElementChild) replace(place, starts(take), h("figure", { class: "samples" }));
  for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (place.querySelectorAll("[data-shape]"))) {
    button.setAttribute("aria-pressed", String(button.dataset.shape === key));
  }
  const figure = /** @type {HTMLElement} */ (place.querySelector("figure"));
  try {
    const { grains } = await send("POST", "/v1/shapes", { shape }, { signal: here.signal, quiet: true });
    replace(figure, picture(grains), h("figcaption", { class: "hint" }, caption(grains)));
  } catch {
    // What is wrong is said at the fields; the picture is that of the last shape.
    if (!here.signal.aborted) shown.delete(place);
  }
}

/** @param {(shape: any) => void} take */
const starts = (take) =>
  h(
    "div",
    { class: "actions", role: "group", "aria-label": "Shapes to start from, from round to crushed" },
    h("span", { class: "hint" }, "Start from"),
    SHAPES.map(([name, shape]) =>
      h(
        "button",
        {
          type: "button",
          class: "quiet",
          "data-shape": JSON.stringify(shape),
          onclick: () => take(structuredClone(shape)),
        },
        name,
      ),
    ),
  );

/** @param {Grain[]} grains */
function caption(grains) {
  const range = (/** @type {"sphericity" | "elongation" | "flatness"} */ member) => {
    const values = grains.map((grain) => grain[member]);
    const [low, high] = [Math.min(...values), Math.max(...values)].map((value) => number(value, 2));
    return low === high ? low : `${low} to ${high}`;
  };
  return `Eight grains of equal volume: elongation ${range("elongation")}, flatness ${range("flatness")}, sphericity ${range("sphericity")}.`;
}

/** @param {Grain[]} grains */
function picture(grains) {
  const columns = 4;
  const rows = Math.ceil(grains.length / columns);
  return s(
    "svg",
    { viewBox: `0 0 ${columns * CELL} ${rows * CELL}`, role: "img", "aria-label": "Eight grains of this shape" },
    grains.map((grain, i) =>
      s(
        "g",
        { transform: `translate(${((i % columns) + 0.5) * CELL} ${(Math.floor(i / columns) + 0.5) * CELL})` },
        polygons(grain),
      ),
    ),
  );
}

/**
 * The faces that the reader sees, who looks along z. Grains are convex, so that no face hides another.
 * @param {Grain} grain
 */
function polygons({ vertices, faces }) {
  // Grains that are longer than their place are drawn smaller.
  const reach = Math.max(...vertices.map(([x = 0, y = 0]) => Math.hypot(x, y)));
  const scale = Math.min(1, (0.48 * CELL) / reach);
  return faces.flatMap((face) => {
    const corners = face.map((vertex) => vertices[vertex] ?? [0, 0, 0]);
    const normal = normalOf(corners);
    if ((normal[2] ?? 0) <= 0) return [];
    const light = Math.max(
      0,
      normal.reduce((sum, part, i) => sum + part * (LIGHT[i] ?? 0), 0),
    );
    const points = corners.map(([x = 0, y = 0]) => `${(scale * x).toFixed(3)},${(-scale * y).toFixed(3)}`).join(" ");
    return [s("polygon", { points, style: { "--light": `${Math.round(25 + 75 * light)}%` } })];
  });
}

/** The unit normal of a polygon (Newell's method). @param {number[][]} corners */
function normalOf(corners) {
  const sum = [0, 0, 0];
  corners.forEach(([x = 0, y = 0, z = 0], i) => {
    const [u = 0, v = 0, w = 0] = corners[(i + 1) % corners.length] ?? [];
    sum[0] += (y - v) * (z + w);
    sum[1] += (z - w) * (x + u);
    sum[2] += (x - u) * (y + v);
  });
  const length = Math.hypot(...sum) || 1;
  return sum.map((part) => part / length);
}
