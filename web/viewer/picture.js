// The picture of a viewer at any resolution: drawn in tiles, four rays a pixel, and written as PNG band by band.
// @ts-check
import { camera } from "./camera.js";
import { png } from "./png.js";

/** Most grains that are drawn before the page gets its turn. */
const SLICE = 250_000;
/** Longest side of a tile as it is drawn, pixels. */
const TILE = 4096;

/**
 * A target of its own for drawings.
 * @param {WebGL2RenderingContext} gl
 * @param {number} width
 * @param {number} height
 * @param {boolean} depth
 */
function target(gl, width, height, depth) {
  const frame = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  const parts = [
    [gl.COLOR_ATTACHMENT0, gl.RGBA8],
    [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24],
  ];
  const buffers = parts.slice(0, depth ? 2 : 1).map(([at, format]) => {
    const buffer = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, at, gl.RENDERBUFFER, buffer);
    return buffer;
  });
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  const end = () => {
    gl.deleteFramebuffer(frame);
    for (const buffer of buffers) gl.deleteRenderbuffer(buffer);
  };
  return { frame, end };
}

/**
 * @param {import("./viewer.js").Viewer} viewer
 * @param {number} width pixels
 * @param {number} height pixels
 * @param {number[]} [background] red, green, blue from 0 to 255; transparent when absent
 * @returns {Promise<Blob>}
 */
export async function picture(viewer, width, height, background) {
  const { gl, drawing, head } = viewer;
  if (!drawing || !head) throw new Error("Nothing is loaded.");
  const pose = { ...viewer.pose };
  const style = viewer.style();
  if (background && style.ink[3])
    style.ink = Array(3)
      .fill(background[0] > 127 ? 0.35 : 0.65)
      .concat(1);
  const [from, end] = viewer.ends();
  const most = Math.min(TILE, gl.getParameter(gl.MAX_RENDERBUFFER_SIZE)) / 2;
  const [w, h] = [Math.min(most, width), Math.min(most / 2, height)];
  const pixels = [2 * w, 2 * h];
  const [fine, coarse] = [target(gl, 2 * w, 2 * h, true), target(gl, w, h, false)];
  const tile = new Uint8Array(4 * w * h);
  const pack = gl.createBuffer();
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, pack);
  gl.bufferData(gl.PIXEL_PACK_BUFFER, tile.length, gl.STREAM_COPY);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);

  /** Draws the tile whose upper left corner is there. @param {number} left @param {number} top */
  const draw = async (left, top) => {
    const view = camera(
      pose,
      head.size,
      head.dmax / 2,
      [2 * width, 2 * height],
      [2 * left, 2 * (height - top - h), ...pixels],
    );
    for (let i = from; i < end || i === from; i += SLICE) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, fine.frame);
      if (i === from) drawing.start(view, style, pixels);
      drawing.grains(view, style, pixels, i, Math.min(end, i + SLICE), viewer.large(view, pixels[1]));
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      await drawing.done();
      if (gl.isContextLost()) throw new Error("The graphics context was lost.");
    }
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, fine.frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, coarse.frame);
    gl.blitFramebuffer(0, 0, 2 * w, 2 * h, 0, 0, w, h, gl.COLOR_BUFFER_BIT, gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, coarse.frame);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, pack);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, 0);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    await drawing.done();
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, pack);
    gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, tile);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  };

  try {
    return await png(width, height, async (send) => {
      for (let top = 0; top < height; top += h) {
        const rows = Math.min(h, height - top);
        const band = new Uint8Array(4 * width * rows);
        for (let left = 0; left < width; left += w) {
          await draw(left, top);
          const used = Math.min(w, width - left);
          for (let y = 0; y < rows; y++) {
            const line = 4 * w * (h - 1 - y);
            band.set(tile.subarray(line, line + 4 * used), 4 * (width * y + left));
          }
        }
        flatten(band, background);
        await send(band);
      }
    });
  } finally {
    fine.end();
    coarse.end();
    gl.deleteBuffer(pack);
  }
}

/**
 * Lays premultiplied pixels on a background, or divides them by their opacity.
 * @param {Uint8Array} band
 * @param {number[]} [background]
 */
function flatten(band, background) {
  for (let i = 0; i < band.length; i += 4) {
    const a = band[i + 3] / 255;
    if (a === 1) continue;
    for (let k = 0; k < 3; k++) {
      band[i + k] = background ? band[i + k] + (1 - a) * background[k] : band[i + k] / (a || 1);
    }
    if (background) band[i + 3] = 255;
  }
}
