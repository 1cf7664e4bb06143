/** The specimen to scale, in an oblique view, with its lengths and its largest grain. */
import { quantity, s } from "./dom.js";

const WIDTH = 240;
const HEIGHT = 200;

/**
 * @param {any} specimen as in a request
 * @param {number | null} d_max diameter of the largest grain in mm, if it is known
 * @returns {SVGElement | null} `null` where the lengths make no body
 */
export function drawing(specimen, d_max) {
  if (specimen?.type === "cylinder") return cylinder(specimen.diameter_mm, specimen.height_mm, d_max);
  if (specimen?.type === "box") return box(specimen.size_mm ?? [], specimen.boundary === "periodic", d_max);
  return null;
}

/** @param {any[]} lengths */
const drawable = (lengths) =>
  lengths.every((length) => typeof length === "number" && length > 0 && Number.isFinite(length));

/** @param {string} words @param {...(SVGElement | false)} parts */
const frame = (words, ...parts) =>
  s("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words }, ...parts);

/** @param {string} words @param {number} x @param {number} y @param {string} [anchor] */
const label = (words, x, y, anchor = "middle") => s("text", { x, y, "text-anchor": anchor }, words);

/** @param {any[]} size @param {boolean} periodic @param {number | null} d_max */
function box(size, periodic, d_max) {
  if (size.length !== 3 || !drawable(size)) return null;
  const [x = 1, y = 1, z = 1] = size;
  const slope = 0.42; // the depth is drawn at 42 %, to the upper right
  const scale = Math.min((WIDTH - 70) / (x + slope * y), (HEIGHT - 34) / (z + slope * y));
  const [w, d, t] = [x * scale, slope * y * scale, z * scale];
  const left = Math.max(8, (WIDTH - 56 - w - d) / 2);
  const bottom = HEIGHT - 24;
  const top = bottom - t;
  const kind = periodic ? "face periodic" : "face";
  const path = (/** @type {string} */ d_, /** @type {string} */ class_) => s("path", { d: d_, class: class_ });
  const radius = d_max ? (d_max * scale) / 2 : 0;
  return frame(
    `Box of ${x} by ${y} by ${z} mm${d_max ? `, largest grain ${d_max} mm` : ""}`,
    path(`M${left} ${top}h${w}v${t}h${-w}z`, kind),
    path(`M${left} ${top}l${d} ${-d}h${w}l${-d} ${d}z`, kind),
    path(`M${left + w} ${top}l${d} ${-d}v${t}l${-d} ${d}z`, kind),
    path(`M${left} ${bottom}l${d} ${-d}h${w}m${-w} 0v${-t}`, "hidden"),
    radius > 0.7 &&
      2 * radius <= Math.min(w, t) &&
      s("circle", { cx: left + radius + 3, cy: bottom - radius - 3, r: radius, class: "grain" }),
    label(`${quantity(x, "mm")}`, left + w / 2, bottom + 16),
    label(`${quantity(z, "mm")}`, left + w + d + 5, top - d + t / 2 + 4, "start"),
    label(`${quantity(y, "mm")}`, left + w + d / 2 + 8, bottom - d / 2 + 10, "start"),
  );
}

/** @param {any} diameter @param {any} height @param {number | null} d_max */
function cylinder(diameter, height, d_max) {
  if (!drawable([diameter, height])) return null;
  const slope = 0.3;
  const scale = Math.min((WIDTH - 80) / diameter, (HEIGHT - 34) / (height + slope * diameter));
  const [w, t, e] = [diameter * scale, height * scale, (slope * diameter * scale) / 2];
  const left = (WIDTH - 40 - w) / 2;
  const top = 8 + e;
  const radius = d_max ? (d_max * scale) / 2 : 0;
  return frame(
    `Cylinder of diameter ${diameter} mm and height ${height} mm${d_max ? `, largest grain ${d_max} mm` : ""}`,
    s("path", { d: `M${left} ${top}v${t}a${w / 2} ${e} 0 0 0 ${w} 0v${-t}`, class: "face" }),
    s("ellipse", { cx: left + w / 2, cy: top, rx: w / 2, ry: e, class: "face" }),
    s("path", { d: `M${left} ${top + t}a${w / 2} ${e} 0 0 1 ${w} 0`, class: "hidden" }),
    radius > 0.7 &&
      2 * radius <= Math.min(w, t) &&
      s("circle", { cx: left + w / 2, cy: top + t - radius, r: radius, class: "grain" }),
    label(quantity(diameter, "mm"), left + w / 2, Math.min(HEIGHT - 4, top + t + e + 14)),
    label(quantity(height, "mm"), left + w + 6, top + t / 2 + 4, "start"),
  );
}
