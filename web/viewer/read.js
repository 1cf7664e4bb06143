// Reads the view format (`result?format=view`) from a stream: a head of 64 bytes, a table of templates, then records of
// equal length, largest grain first.
// @ts-check

/**
 * @typedef {object} Head what the first bytes of a view say
 * @property {number} count number of grains
 * @property {number[]} size lengths of the specimen's bounding box, mm
 * @property {number} dmin smallest size of a grain, mm
 * @property {number} dmax largest size of a grain, mm
 * @property {number} specimen 0 box, 1 cylinder, 2 any other
 * @property {number} stride bytes of a record
 */

/**
 * Gives whole records of a stream, in their order, to its end or to `limit` grains. Throws on what is no view, and on a
 * stream that ends early.
 * @param {ReadableStream<Uint8Array>} stream
 * @param {number} limit
 * @param {(head: Head, table: ArrayBuffer) => Promise<void>} begin what happens between head and records; the table
 *   is that of the templates
 */
export async function* read(stream, limit, begin) {
  const reader = stream.getReader();
  /** @type {Uint8Array<ArrayBuffer>} */
  let rest = new Uint8Array(0);
  /** Waits until so many bytes are there. @param {number} least */
  const fill = async (least) => {
    while (rest.length < least) {
      const { done, value } = await reader.read();
      if (done) throw new Error("The view ended early.");
      const bytes = new Uint8Array(rest.length + value.length);
      bytes.set(rest);
      bytes.set(value, rest.length);
      rest = bytes;
    }
  };
  try {
    await fill(64);
    const [counts, lengths] = [new Uint32Array(rest.buffer, 0, 16), new Float32Array(rest.buffer, 16, 5)];
    if (String.fromCharCode(...rest.subarray(0, 8)) !== "PKSTVIEW" || counts[3] !== 1) {
      throw new Error("This is not a view of version 1.");
    }
    const [count, specimen, stride, start] = [counts[2], counts[9], counts[11], 64 + counts[12]];
    const [dmin, dmax] = lengths.subarray(3);
    await fill(start);
    await begin(
      { count, size: [...lengths.subarray(0, 3)], dmin, dmax, specimen, stride },
      rest.buffer.slice(64, start),
    );
    rest = rest.subarray(start);
    for (let left = Math.min(count, limit) * stride; left > 0;) {
      await fill(stride);
      const whole = Math.min(left, rest.length - (rest.length % stride));
      yield rest.subarray(0, whole);
      left -= whole;
      rest = rest.subarray(whole);
    }
  } finally {
    await reader.cancel();
  }
}
