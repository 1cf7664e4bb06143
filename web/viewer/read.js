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
 * @property {number} periodic bits 0, 1, 2: periodic in x, y, z
 * @property {number} stride bytes of a record
 * @property {number} aggregates types of aggregate in the mix
 * @property {Float32Array[]} templates planes of each polyhedron: normal and distance, radius 1
 */

/**
 * Reads a stream to its end, or to `limit` grains. Throws on what is no view, and on a stream that ends early.
 * @param {ReadableStream<Uint8Array>} stream
 * @param {(head: Head) => void} onhead
 * @param {(records: Uint8Array<ArrayBuffer>) => void} onrecords whole records, in their order
 * @param {number} limit
 */
export async function read(stream, onhead, onrecords, limit) {
  const reader = stream.getReader();
  /** @type {Uint8Array<ArrayBuffer>} */
  let rest = new Uint8Array(0);
  /** @type {Head | undefined} */
  let head;
  let left = Infinity;
  while (left > 0) {
    const { done, value } = await reader.read();
    if (done) break;
    const bytes = new Uint8Array(rest.length + value.length);
    bytes.set(rest);
    bytes.set(value, rest.length);
    rest = bytes;
    if (!head) {
      if (rest.length < 64) continue;
      const view = new DataView(rest.buffer);
      if (String.fromCharCode(...rest.subarray(0, 8)) !== "PKSTVIEW" || view.getUint32(12, true) !== 1) {
        throw new Error("This is not a view of version 1.");
      }
      const start = 64 + view.getUint32(48, true);
      if (rest.length < start) continue;
      const f = (/** @type {number} */ at) => view.getFloat32(at, true);
      const u = (/** @type {number} */ at) => view.getUint32(at, true);
      head = {
        count: u(8),
        size: [f(16), f(20), f(24)],
        dmin: f(28),
        dmax: f(32),
        specimen: u(36),
        periodic: u(40),
        stride: u(44),
        aggregates: u(52),
        templates: templates(view, start),
      };
      left = Math.min(head.count, limit) * head.stride;
      onhead(head);
      rest = rest.subarray(start);
    }
    const whole = Math.min(left, rest.length - (rest.length % head.stride));
    if (whole) onrecords(rest.subarray(0, whole));
    left -= whole;
    rest = rest.subarray(whole);
  }
  await reader.cancel();
  if (left > 0) throw new Error("The view ended early.");
}

/**
 * The planes of the convex polyhedra between byte 64 and `end`. Triangles within 6 degrees and a hundredth of the
 * radius share one.
 * @param {DataView} view
 * @param {number} end
 */
function templates(view, end) {
  const list = [];
  let at = 64;
  for (let left = end > at ? view.getUint32(at, true) : 0, base = at + 4; left > 0; left--, base = at) {
    const points = base + 8;
    const triangles = points + 12 * view.getUint32(base, true);
    at = triangles + 6 * view.getUint32(base + 4, true);
    /** @type {number[]} */
    const planes = [];
    for (let t = triangles; t < at; t += 6) {
      const [a, b, c] = [0, 2, 4].map((k) => {
        const p = points + 12 * view.getUint16(t + k, true);
        return [0, 4, 8].map((j) => view.getFloat32(p + j, true));
      });
      const [u, v] = [b, c].map((p) => p.map((x, i) => x - a[i]));
      let n = [0, 1, 2].map((i) => u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]);
      const length = Math.hypot(...n);
      if (length < 1e-9) continue;
      n = n.map((x) => x / length);
      let h = n[0] * a[0] + n[1] * a[1] + n[2] * a[2];
      if (h < 0) [n, h] = [n.map((x) => -x), -h];
      const known = [...planes.keys()].some(
        (i) =>
          i % 4 === 0 &&
          n[0] * planes[i] + n[1] * planes[i + 1] + n[2] * planes[i + 2] > 0.995 &&
          Math.abs(h - planes[i + 3]) < 0.01,
      );
      if (!known) planes.push(...n, h);
    }
    list.push(new Float32Array(planes));
    at += (4 - (at % 4)) % 4;
  }
  return list;
}
