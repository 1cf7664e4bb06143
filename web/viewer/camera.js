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
 * What the shaders need: the eye, three directions, `f` and `o` with ndc = f * (x, y) / z + o, and the depths `zk` with
 * depth = zk[0] - zk[1] / z.
 * @typedef {Record<"eye" | "right" | "up" | "ahead" | "f" | "o" | "zk", number[]>} Camera
 */

/** @returns {Pose} */
export const home = () => ({ az: 0.6, el: 0.4, zoom: 1, pan: [0, 0.06] });

/**
 * The camera of a picture of `full` pixels of which the window `[x, y, width, height]`, from the lower left, is drawn.
 * @param {Pose} pose
 * @param {number[]} size lengths of the specimen, mm
 * @param {number} reach how far grains reach out of the box, mm
 * @param {number[]} full
 * @param {number[]} window
 * @returns {Camera}
 */
export function camera(pose, size, reach, full, window) {
  const { az, el, zoom, pan } = pose;
  const radius = Math.hypot(...size) / 2;
  const distance = radius / Math.sin(HALF);
  const back = [Math.cos(el) * Math.cos(az), Math.cos(el) * Math.sin(az), Math.sin(el)];
  const right = [-Math.sin(az), Math.cos(az), 0];
  const up = [-Math.sin(el) * Math.cos(az), -Math.sin(el) * Math.sin(az), Math.cos(el)];
  const [near, far] = [distance - radius - reach, distance + radius + reach];
  const side = Math.min(...full);
  const scale = zoom / Math.tan(HALF);
  const axis = (/** @type {number} */ i) => {
    const [at, length] = [window[i], window[i + 2]];
    return [(scale * side) / length, (full[i] + pan[i] * side - 2 * at) / length - 1];
  };
  const [x, y] = [axis(0), axis(1)];
  return {
    eye: size.map((s, i) => s / 2 + back[i] * distance),
    right,
    up,
    ahead: back.map((b) => -b),
    f: [x[0], y[0]],
    o: [x[1], y[1]],
    zk: [far / (far - near), (far * near) / (far - near)],
  };
}
