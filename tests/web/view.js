// Makes files of the view format, and the picture that they must give, computed in double precision.

/**
 * A file of spheres.
 * @param {number[]} size lengths of the box, mm
 * @param {Float64Array | number[]} spheres x, y, z, diameter of each in mm, largest first
 * @param {{specimen?: number}} [options]
 */
export function sphereFile(size, spheres, { specimen = 0 } = {}) {
  const count = spheres.length / 4;
  const file = Buffer.alloc(64 + 8 * count);
  file.write("PKSTVIEW");
  file.writeUInt32LE(count, 8);
  file.writeUInt32LE(1, 12);
  size.forEach((length, i) => file.writeFloatLE(length, 16 + 4 * i));
  const largest = spheres[3];
  file.writeFloatLE(spheres[4 * count - 1], 28);
  file.writeFloatLE(largest, 32);
  file.writeUInt32LE(specimen, 36);
  file.writeUInt32LE(8, 44);
  file.writeUInt32LE(1, 52);
  for (let i = 0; i < count; i++) {
    for (let k = 0; k < 3; k++)
      file.writeUInt16LE(Math.round((65535 * spheres[4 * i + k]) / size[k]), 64 + 8 * i + 2 * k);
    file.writeUInt16LE(Math.max(1, Math.round((65535 * spheres[4 * i + 3]) / largest)), 64 + 8 * i + 6);
  }
  return file;
}

/**
 * Spheres at random, without regard to one another, the number of a diameter as in a grading curve by Fuller.
 * @param {number} count
 * @param {number} length edge of the cube, mm
 */
export function manySpheres(count, length) {
  let state = 1;
  const random = () => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) / 4294967296;
  const out = new Float64Array(4 * count);
  for (let i = 0; i < count; i++) {
    const d = 1 / (1 / 16 ** 2.5 + ((i + 0.5) / count) * (1 / 2 ** 2.5 - 1 / 16 ** 2.5)) ** 0.4;
    out.set([0, 1, 2].map(() => d / 2 + random() * (length - d)).concat(d), 4 * i);
  }
  return out;
}

/**
 * @typedef {object} Body a grain that is an ellipsoid or a cube
 * @property {number[]} at centre, mm
 * @property {number} size largest extent: of an ellipsoid its largest axis, of a cube its diagonal, mm
 * @property {number[]} axes semi-axes as shares of the largest; none of a cube
 * @property {number[]} turn quaternion x, y, z, w
 */

/**
 * A file of ellipsoids and cubes, each its own aggregate and size class.
 * @param {number[]} size
 * @param {Body[]} bodies largest first
 */
export function bodyFile(size, bodies) {
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((i) =>
    [i & 1, (i >> 1) & 1, i >> 2].map((b) => (2 * b - 1) / Math.sqrt(3)),
  );
  const faces = [
    [0, 2, 3, 1],
    [4, 5, 7, 6],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 4, 6, 2],
    [1, 3, 7, 5],
  ];
  const triangles = faces.flatMap(([a, b, c, d]) => [
    [a, b, c],
    [a, c, d],
  ]);
  const table = Buffer.alloc(4 + 8 + 12 * 8 + 6 * 12);
  table.writeUInt32LE(1, 0);
  table.writeUInt32LE(8, 4);
  table.writeUInt32LE(12, 8);
  corners.flat().forEach((x, i) => table.writeFloatLE(x, 12 + 4 * i));
  triangles.flat().forEach((x, i) => table.writeUInt16LE(x, 108 + 2 * i));
  const head = sphereFile(
    size,
    bodies.flatMap((b) => [...b.at, b.size]),
  ).subarray(0, 64);
  head.writeUInt32LE(24, 44);
  head.writeUInt32LE(table.length, 48);
  head.writeUInt32LE(bodies.length, 52);
  const records = bodies.map(({ at, size: extent, axes, turn }, i) => {
    const record = Buffer.alloc(24);
    at.forEach((x, k) => record.writeUInt16LE(Math.round((65535 * x) / size[k]), 2 * k));
    record.writeUInt16LE(Math.round((65535 * extent) / bodies[0].size), 6);
    turn.forEach((x, k) => record.writeInt16LE(Math.round(32767 * x), 8 + 2 * k));
    record.writeUInt16LE(Math.round(65535 * (axes[1] ?? 1)), 16);
    record.writeUInt16LE(Math.round(65535 * (axes[2] ?? 1)), 18);
    record.writeUInt16LE(axes.length ? 0 : 1, 20);
    record.writeUInt8(i, 22);
    record.writeUInt8(bodies.length - 1 - i, 23);
    return record;
  });
  return Buffer.concat([head, table, ...records]);
}

/** @typedef {(eye: number[], dir: number[]) => number[] | null} Hit where a ray enters and leaves a body */

/**
 * @param {number[] | Float64Array} spheres x, y, z, diameter of each
 * @returns {Hit[]}
 */
export const hitsOfSpheres = (spheres) =>
  Array.from({ length: spheres.length / 4 }, (_, s) => (eye, dir) => {
    const m = [0, 1, 2].map((i) => eye[i] - spheres[4 * s + i]);
    const b = m[0] * dir[0] + m[1] * dir[1] + m[2] * dir[2];
    const h = b * b - (m[0] ** 2 + m[1] ** 2 + m[2] ** 2) + (spheres[4 * s + 3] / 2) ** 2;
    return h < 0 ? null : [-b - Math.sqrt(h), -b + Math.sqrt(h)];
  });

/**
 * @param {Body[]} bodies
 * @returns {Hit[]}
 */
export const hitsOfBodies = (bodies) =>
  bodies.map(({ at, size, axes, turn: [x, y, z, w] }) => {
    // Rows of the matrix that turns the specimen's directions into those of the grain.
    const rows = [
      [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
      [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
      [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
    ];
    const into = (/** @type {number[]} */ v) => rows.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
    return (eye, dir) => {
      const [p, d] = [into(eye.map((e, i) => e - at[i])), into(dir)];
      if (!axes.length) {
        const half = size / 2 / Math.sqrt(3);
        let [low, high] = [-Infinity, Infinity];
        for (let i = 0; i < 3; i++) {
          const [a, b] = [(-half - p[i]) / d[i], (half - p[i]) / d[i]];
          low = Math.max(low, Math.min(a, b));
          high = Math.min(high, Math.max(a, b));
        }
        return low > high ? null : [low, high];
      }
      const [u, v] = [p, d].map((q) => q.map((c, i) => c / ((axes[i] * size) / 2)));
      const dot = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
      const [a, b, c] = [dot(v, v), dot(u, v), dot(u, u) - 1];
      const h = b * b - a * c;
      return h < 0 ? null : [(-b - Math.sqrt(h)) / a, (-b + Math.sqrt(h)) / a];
    };
  });

/**
 * What each pixel must show: 0 the ground, i + 1 the surface of grain i, 101 + i its section at a cut. The camera is
 * stated here anew: an eye at radius / sin 0.3 from the middle, a picture whose shorter side spans 0.6 rad.
 * @param {number[]} size
 * @param {Hit[]} hits
 * @param {{az: number, el: number, zoom: number, pan: number[]}} pose
 * @param {number[]} cut mm in x, y, z
 * @param {number} width
 * @param {number} height
 * @param {{octant?: boolean, plane?: number[]}} [more] octant: what lies beyond all three cuts is removed;
 *   plane: normal and distance, beyond which all is
 */
export function expected(size, hits, { az, el, zoom, pan }, cut, width, height, { octant = false, plane } = {}) {
  const distance = Math.hypot(...size) / 2 / Math.sin(0.3);
  const away = [Math.cos(el) * Math.cos(az), Math.cos(el) * Math.sin(az), Math.sin(el)];
  const right = [-Math.sin(az), Math.cos(az), 0];
  const up = [-Math.sin(el) * Math.cos(az), -Math.sin(el) * Math.sin(az), Math.cos(el)];
  const eye = size.map((s, i) => s / 2 + away[i] * distance);
  const half = Math.min(width, height) / 2;
  const out = new Uint8Array(width * height);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const u = (((x + 0.5 - width / 2) / half - pan[0]) / zoom) * Math.tan(0.3);
      const v = (((height / 2 - y - 0.5) / half - pan[1]) / zoom) * Math.tan(0.3);
      let dir = [0, 1, 2].map((i) => u * right[i] + v * up[i] - away[i]);
      const norm = Math.hypot(...dir);
      dir = dir.map((d) => d / norm);
      let [low, high] = [0, Infinity];
      // Where the ray is in the octant, of which all three coordinates are beyond the cuts.
      let [inside, outside] = [-Infinity, Infinity];
      for (let i = 0; i < 3; i++) {
        const meets = (cut[i] - eye[i]) / dir[i];
        if (octant && dir[i] < 0) outside = Math.min(outside, meets);
        else if (octant) inside = Math.max(inside, meets);
        else if (dir[i] < 0) low = Math.max(low, meets);
        else high = Math.min(high, meets);
      }
      if (plane) {
        const along = (/** @type {number[]} */ v) => plane[0] * v[0] + plane[1] * v[1] + plane[2] * v[2];
        const meets = (plane[3] - along(eye)) / along(dir);
        if (along(dir) < 0) low = Math.max(low, meets);
        else high = Math.min(high, meets);
      }
      let nearest = Infinity;
      for (const [s, hit] of hits.entries()) {
        const met = hit(eye, dir);
        if (!met) continue;
        const [enter, leave] = met;
        let from = Math.max(enter, low);
        if (octant && from >= inside && from < outside) from = outside;
        if (from > Math.min(leave, high) || from >= nearest) continue;
        nearest = from;
        out[y * width + x] = from > enter ? 101 + s : 1 + s;
      }
    }
  }
  return out;
}
