// Writes PNG (ISO/IEC 15948) band by band, so that a picture may be larger than any canvas.
// @ts-check

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
  out.set(
    [...type].map((c) => c.charCodeAt(0)),
    4,
  );
  out.set(data, 8);
  let crc = -1;
  for (let i = 4; i < out.length - 4; i++) crc = CRC[(crc ^ out[i]) & 255] ^ (crc >>> 8);
  view.setUint32(out.length - 4, ~crc);
  return out;
}

/**
 * @param {number} width
 * @param {number} height
 * @param {(send: (rows: Uint8Array<ArrayBuffer>) => Promise<void>) => Promise<void>} make sends bands of rows from the
 *   top, four bytes a pixel: red, green, blue, opacity
 */
export async function png(width, height, make) {
  const deflate = new CompressionStream("deflate");
  const data = new Response(deflate.readable).arrayBuffer();
  const writer = deflate.writable.getWriter();
  await make(async (rows) => {
    const line = 4 * width;
    const out = new Uint8Array((line + 1) * (rows.length / line));
    for (let from = 0, to = 0; from < rows.length; from += line) {
      out[to++] = 1; // each byte less that of the pixel to its left
      for (let i = 0; i < line; i++) out[to++] = rows[from + i] - (i < 4 ? 0 : rows[from + i - 4]);
    }
    await writer.write(out);
  });
  await writer.close();
  const head = new Uint8Array(13);
  new DataView(head.buffer).setUint32(0, width);
  new DataView(head.buffer).setUint32(4, height);
  head.set([8, 6], 8);
  return new Blob(
    [
      new Uint8Array([137, 80, 78, 71, 13, 10, 26, 10]),
      chunk("IHDR", head),
      chunk("IDAT", new Uint8Array(await data)),
      chunk("IEND", new Uint8Array(0)),
    ],
    { type: "image/png" },
  );
}
