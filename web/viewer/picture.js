// The picture of a viewer at any resolution: drawn in tiles, four rays a pixel, and written as PNG (ISO/IEC 15948) band
// by band, so that it may be larger than any canvas.
// @ts-check
import { camera } from "./camera.js";

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
export function target(gl, width, height, depth) {
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
  const { gl, drawing, head, pose } = viewer;
  if (!drawing || !head) throw new Error("Nothing is loaded.");
  const style = viewer.style();
  if (background && style.ink[3]) {
    const grey = background[0] > 127 ? 0.35 : 0.65;
    style.ink = [grey, grey, grey, 1];
  }
  const [from, end] = viewer.range();
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
    const view = camera(pose, head, [2 * width, 2 * height], pixels, [2 * left, 2 * (height - top - h)]);
    for (let i = from; i < end || i === from; i += SLICE) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, fine.frame);
      drawing.draw(view, style, i, Math.min(end, i + SLICE), viewer.large(view), i === from);
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

  const deflate = new CompressionStream("deflate");
  const data = new Response(deflate.readable).arrayBuffer();
  const writer = deflate.writable.getWriter();
  try {
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
      await writer.write(filtered(band, 4 * width));
    }
    await writer.close();
  } finally {
    fine.end();
    coarse.end();
    gl.deleteBuffer(pack);
  }
  const bytes = new Uint8Array(13);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, width);
  view.setUint32(4, height);
  bytes.set([8, 6], 8);
  const parts = [
    new Uint8Array([137, 80, 78, 71, 13, 10, 26, 10]),
    chunk("IHDR", bytes),
    chunk("IDAT", new Uint8Array(await data)),
    chunk("IEND", new Uint8Array(0)),
  ];
  return new Blob(parts, { type: "image/png" });
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

/**
 * Rows as PNG compresses them: a 1, then each byte less that of the pixel to its left.
 * @param {Uint8Array} band
 * @param {number} line bytes of a row
 */
function filtered(band, line) {
  const out = new Uint8Array(band.length + band.length / line);
  for (let from = 0, to = 0; from < band.length; from += line) {
    out[to++] = 1;
    for (let i = 0; i < line; i++) out[to++] = band[from + i] - (i < 4 ? 0 : band[from + i - 4]);
  }
  return out;
}

const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});

/**
 * @param {string} type
 * @param {Uint8Array} data
 */
function chunk(type, data) {
  const out = new Uint8Array(data.length + 12);
  const view = new DataView(out.buffer);
  view.setUint32(0, data.length);
  new TextEncoder().encodeInto(type, out.subarray(4));
  out.set(data, 8);
  let crc = -1;
  for (let i = 4; i < out.length - 4; i++) crc = CRC[(crc ^ out[i]) & 255] ^ (crc >>> 8);
  view.setUint32(out.length - 4, ~crc);
  return out;
}
