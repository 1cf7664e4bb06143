// What the viewer needs for grains that are no spheres: ellipsoids, and convex polyhedra by the planes of their faces.
// It is loaded with the first packing that has some.
// @ts-check

/**
 * The planes of the polyhedra of a table of templates: normal and distance from the centre, radius 1. Triangles within
 * 6 degrees and a hundredth of the radius share one.
 * @param {ArrayBuffer} table
 */
function templates(table) {
  let left = table.byteLength && new Uint32Array(table)[0];
  let at = 4;
  /** @type {number[][][]} */
  const list = [];
  while (left--) {
    const [vertices, triangles] = new Uint32Array(table, at, 2);
    const points = new Float32Array(table, at + 8, 3 * vertices);
    const corners = new Uint16Array(table, at + 8 + 12 * vertices, 3 * triangles);
    at += 8 + 12 * vertices + 4 * Math.ceil(1.5 * triangles);
    /** @type {number[][]} */
    const planes = [];
    for (let t = 0; t < corners.length; t += 3) {
      const [a, b, c] = Array.from(corners.subarray(t, t + 3), (p) => [...points.subarray(3 * p, 3 * p + 3)]);
      const [u, v] = [b, c].map((p) => p.map((x, i) => x - a[i]));
      const across = [0, 1, 2].map((i) => u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]);
      const length = Math.hypot(...across);
      if (length < 1e-9) continue;
      const n = across.map((x) => x / length);
      const h = dot(n, a);
      const plane = [...n, h].map((x) => (h < 0 ? -x : x));
      if (!planes.some((p) => dot(p, plane) > 0.995 && Math.abs(p[3] - plane[3]) < 0.01)) planes.push(plane);
    }
    list.push(planes);
  }
  return list;
}

/** @param {number[]} a @param {number[]} b */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/**
 * Makes a texture, and leaves it bound, with a row of planes for each template; the distance -1 ends a row.
 * @param {WebGL2RenderingContext} gl
 * @param {ArrayBuffer} table
 */
function planes(gl, table) {
  const list = templates(table);
  const width = 1 + Math.max(0, ...list.map((planes) => planes.length));
  const height = Math.max(1, list.length);
  const texels = new Float32Array(4 * width * height).fill(-1);
  list.forEach((planes, i) => texels.set(planes.flat(), 4 * width * i));
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, texels);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return texture;
}

/**
 * @param {WebGL2RenderingContext} gl
 * @param {ArrayBuffer} table of templates, as the view format has it; empty where there are no polyhedra
 * @returns {import("./draw.js").Kind}
 */
export const bodies = (gl, table) => ({
  inputs: `layout(location=1) in vec4 turn; layout(location=2) in vec4 form;
flat out vec4 t; flat out vec3 ax; flat out int shape;`,
  read: `int k = int(form.w); i = float(mode == 1. ? min(k >> 8, 15) : k & 7);
  t = turn; ax = vec3(1., form.xy / 65535.); shape = int(form.z);
  if (shape > 0 && pixels < lod) { shape = 0; r *= .78; }`,
  passed: `flat in vec4 t; flat in vec3 ax; flat in int shape; uniform sampler2D planes;
vec3 rotate(vec4 k, vec3 v) { return v + 2. * cross(k.xyz, cross(k.xyz, v) + k.w * v); }`,
  meet: `if (length(cross(m, dir)) > r) discard;
    vec4 back = vec4(-t.xyz, t.w);
    vec3 u = rotate(back, dir), w = rotate(back, m) / r;
    if (shape > 0) {
      a = -1e9; b = 1e9;
      for (int i = 0; i < 512; i++) {
        vec4 p = texelFetch(planes, ivec2(i, shape - 1), 0);
        if (p.w < 0.) break;
        float down = dot(p.xyz, u), hit = (p.w - dot(p.xyz, w)) * r / down;
        if (down < 0.) { if (hit > a) { a = hit; n = p.xyz; } } else b = min(b, hit);
        if (a > b) discard;
      }
    } else {
      vec3 v = u / ax; w = w / ax;
      float g = dot(v, v), s = dot(w, v), h = s * s - g * (dot(w, w) - 1.);
      if (h < 0.) discard;
      h = sqrt(h); a = (-s - h) / g * r; b = (-s + h) / g * r; n = (w * r + a * v) / ax;
    }
    n = normalize(rotate(t, n));`,
  texture: planes(gl, table),
});
