// The grain that is seen at a place of the picture: one pixel is drawn with the numbers of the grains as colours.
// @ts-check
import { camera } from "./camera.js";
import { target } from "./picture.js";

/**
 * @typedef {object} Picked
 * @property {number} index its place among the grains, largest first, from 0
 * @property {number[]} at centre, mm
 * @property {number} size of a sphere its diameter, else that of the sphere around it, mm
 * @property {number} [aggregate] index
 * @property {number} [sizeClass] index; absent beyond 254 and of spheres
 * @property {boolean} [angular] whether it is a polyhedron; absent of spheres
 * @property {number[]} [axes] semi-axes of an ellipsoid as shares of the longest
 */

/**
 * @param {import("./viewer.js").Viewer} viewer
 * @param {number} x from the left of the canvas, CSS pixels
 * @param {number} y from its top
 * @returns {Picked | undefined}
 */
export function pick(viewer, x, y) {
  const { gl, drawing, head, canvas, pose } = viewer;
  if (!drawing || !head) return;
  const full = [canvas.clientWidth, canvas.clientHeight];
  const view = camera(pose, head, full, [1, 1], [Math.floor(x), Math.floor(full[1] - y)]);
  const { frame, end } = target(gl, 1, 1, true);
  const style = { ...viewer.style(1), pick: [1] };
  style.ink = [0, 0, 0, 0];
  const [from, to] = viewer.range();
  const pixel = new Uint8Array(4);
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  drawing.draw(view, style, from, Math.min(to, viewer.arrived), viewer.large(view), true);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  end();
  if (!pixel[3]) return;
  const index = pixel[0] + 256 * pixel[1] + 65536 * pixel[2];
  const record = drawing.record(index);
  const numbers = new Uint16Array(record.buffer);
  const { size, dmax, stride } = head;
  /** @type {Picked} */
  const found = { index, at: size.map((s, i) => (s * numbers[i]) / 65535), size: (dmax * numbers[3]) / 65535 };
  if (stride < 24) return found;
  const angular = numbers[10] > 0;
  return {
    ...found,
    angular,
    axes: angular ? undefined : [1, numbers[8] / 65535, numbers[9] / 65535],
    aggregate: record[22],
    sizeClass: record[23] === 255 ? undefined : record[23],
  };
}
