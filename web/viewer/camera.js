// The camera turns about the middle of the specimen at a fixed distance. To come nearer magnifies the picture, and to
// move it shifts the picture, so that the eye stays outside of all grains.
// @ts-check

/** Half the angle in which the specimen's bounding sphere is seen. */
const HALF = 0.3;

/**
 * @typedef {object} Pose
 * @property {number} az angle about z, rad
 * @property {number} el angle above the plane of x and y, rad
 * @property {number} zoom magnification; 1 shows the whole specimen
 * @property {number[]} pan shift of the picture in x and y, in halves of its shorter side
 */

/**
 * What the shaders need: the eye, three directions, `f` and `o` with ndc = f * (x, y) / z + o, the depths `zk` with
 * depth = zk[0] - zk[1] / z, and the pixels `view` that are drawn.
 * @typedef {Record<"eye" | "right" | "up" | "ahead" | "f" | "o" | "zk" | "view", number[]>} Camera
 */

/** @returns {Pose} */
export const home = () => ({ az: 0.6, el: 0.4, zoom: 1, pan: [0, 0.06] });

/** The direction of two angles. @param {number} az @param {number} el */
const direction = (az, el) => [Math.cos(el) * Math.cos(az), Math.cos(el) * Math.sin(az), Math.sin(el)];

/**
 * The camera of a picture of `full` pixels of which `view` are drawn, from `corner`, the lower left.
 * @param {Pose} pose
 * @param {import("./read.js").Head} head
 * @param {number[]} full
 * @param {number[]} [view]
 * @param {number[]} [corner]
 * @returns {Camera}
 */
export function camera({ az, el, zoom, pan }, { size, dmax }, full, view = full, corner = [0, 0]) {
  const radius = Math.hypot(...size) / 2;
  const distance = radius / Math.sin(HALF);
  // Grains reach out of the box by half of the largest.
  const near = distance - radius - dmax / 2;
  const far = distance + radius + dmax / 2;
  const back = direction(az, el);
  const side = Math.min(...full);
  return {
    eye: size.map((s, i) => s / 2 + back[i] * distance),
    right: direction(az + Math.PI / 2, 0),
    up: direction(az, el + Math.PI / 2),
    ahead: back.map((b) => -b),
    f: view.map((length) => (zoom * side) / Math.tan(HALF) / length),
    o: view.map((length, i) => (full[i] + pan[i] * side - 2 * corner[i]) / length - 1),
    zk: [far / (far - near), (far * near) / (far - near)],
    view,
  };
}
