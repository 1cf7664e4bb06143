/** What is drawn over the picture of a packing: the axes, a scale bar, and the grain that was asked for. */
import { h, number, quantity, replace, s } from "./dom.js";
import { camera } from "./viewer/camera.js";

/** Length of an axis, pixels. */
const AXIS = 30;
/** Longest scale bar, pixels. */
const BAR = 110;

/** The largest round length below another one. @param {number} length */
function roundLength(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return power * ([5, 2, 1].find((k) => k * power <= length) ?? 1);
}

/**
 * @typedef {object} Grain what is known of a grain
 * @property {import("./viewer/pick.js").Picked} picked
 * @property {[string, string][]} facts
 */

export class Overlay {
  /** @param {import("./viewer/viewer.js").Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    this.drawing = s("svg", { class: "over", "aria-hidden": "true" });
    this.card = h("div", { class: "grain", role: "status", hidden: true });
    /** @type {Grain | null} */
    this.grain = null;
    viewer.addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(viewer.canvas);
  }

  /** Shows a grain and what is known of it; `null` takes it away. @param {Grain | null} grain */
  show(grain) {
    this.grain = grain;
    this.card.hidden = !grain;
    replace(
      this.card,
      grain &&
        h(
          "dl",
          {},
          grain.facts.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))),
        ),
      grain && h("button", { type: "button", class: "quiet", onclick: () => this.show(null) }, "Close"),
    );
    this.draw();
  }

  draw() {
    const { head, pose, canvas } = this.viewer;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!head || !width) return;
    const { eye, right, up, ahead, f, o } = camera(pose, head, [width, height]);
    const dot = (/** @type {number[]} */ a, /** @type {number[]} */ b) =>
      a.reduce((sum, x, i) => sum + x * (b[i] ?? 0), 0);
    /** Where a point in mm is seen, and how many pixels a mm is there. @param {number[]} point */
    const project = (point) => {
      const e = point.map((p, i) => p - (eye[i] ?? 0));
      const z = dot(e, ahead);
      const x = ((f[0] ?? 1) * dot(e, right)) / z + (o[0] ?? 0);
      const y = ((f[1] ?? 1) * dot(e, up)) / z + (o[1] ?? 0);
      return { x: ((1 + x) * width) / 2, y: ((1 - y) * height) / 2, scale: ((f[0] ?? 1) * width) / 2 / z };
    };
    const [ox, oy] = [width - 50, height - 86];
    const axes = ["x", "y", "z"].flatMap((name, i) => {
      const [dx, dy] = [AXIS * (right[i] ?? 0), -AXIS * (up[i] ?? 0)];
      return [
        s("line", { x1: ox, y1: oy, x2: ox + dx, y2: oy + dy }),
        s("text", { x: ox + 1.35 * dx, y: oy + 1.35 * dy + 4, "text-anchor": "middle" }, name),
      ];
    });
    const { scale } = project(head.size.map((length) => length / 2));
    const length = roundLength(BAR / scale);
    const [end, bottom] = [width - 16, height - 16];
    const start = end - length * scale;
    const bar = [
      s("path", { d: `M${start} ${bottom - 4}v4H${end}v-4`, fill: "none" }),
      s("text", { x: (start + end) / 2, y: bottom - 7, "text-anchor": "middle" }, quantity(length, "mm")),
    ];
    /** @type {SVGElement[]} */
    let ring = [];
    if (this.grain) {
      const { at, size } = this.grain.picked;
      const place = project(at);
      const r = Math.max(6, (size / 2) * place.scale);
      ring = [s("circle", { class: "ring", cx: place.x, cy: place.y, r })];
    }
    this.drawing.setAttribute("viewBox", `0 0 ${width} ${height}`);
    replace(this.drawing, axes, bar, ring);
  }
}

/**
 * What is known of a grain, in words.
 * @param {import("./viewer/pick.js").Picked} picked
 * @param {number} total number of grains
 * @param {any} summary of the result
 * @returns {[string, string][]}
 */
export function factsOf(picked, total, summary) {
  const { index, at, size, axes, angular, aggregate, sizeClass } = picked;
  const spheres = angular === undefined;
  const own = spheres
    ? summary.classes.findLast((/** @type {any} */ one) => one.d_min_mm <= size * (1 + 1e-4))
    : summary.classes[sizeClass ?? -1];
  const named = summary.aggregates?.[aggregate ?? -1];
  const mm = (/** @type {number} */ value) => quantity(value, "mm", 4);
  /** @type {[string, string | false | undefined][]} */
  const facts = [
    ["Grain", `${number(index + 1)} of ${number(total)}, largest first`],
    [spheres ? "Diameter" : "Enclosing sphere", mm(size)],
    ["Axes", axes && `${axes.map((axis) => number(axis * size, 3)).join(" × ")}\u202fmm`],
    ["Shape", !spheres && (angular ? "angular" : "ellipsoid")],
    ["Size class", own && `${number(own.d_min_mm)} to ${quantity(own.d_max_mm, "mm")}`],
    ["Aggregate", summary.aggregates?.length > 1 && (named?.name ?? `${(aggregate ?? 0) + 1}`)],
    ["Centre", `${at.map((x) => number(x, 4)).join(", ")}\u202fmm`],
  ];
  return /** @type {[string, string][]} */ (facts.filter(([, value]) => value));
}
