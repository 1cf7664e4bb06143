// Each grain is a square on the screen. The fragment shader meets the ray through its pixel with the body (sphere,
// ellipsoid, or the planes of a convex polyhedron), writes its depth, and draws the section where a cut goes through.
// @ts-check

const COMMON = `precision highp float; precision highp int;
uniform vec3 eye, right, up, ahead, size, cut; uniform vec2 f, o, view, margin, zk;`;

/**
 * @param {boolean} quad whether a square is four vertices, not a point
 * @param {boolean} body whether records have 24 bytes
 */
export const grainVertex = (quad, body) => `#version 300 es
${COMMON}
layout(location=0) in vec4 q;
${
  body
    ? `layout(location=1) in vec4 turn; layout(location=2) in vec2 axes; layout(location=3) in uvec2 kind;
flat out vec4 t; flat out vec3 ax; flat out int shape;`
    : ""
}
uniform float lod, dmax, edges[16]; uniform vec2 show; uniform vec3 palette[16]; uniform int mode;
flat out vec3 c, rgb; flat out float r, z;
void main() {
  float d = q.w * dmax; r = .5 * d; c = q.xyz * size;
  vec3 e = c - eye; z = dot(e, ahead);
  float pixels = view.y * f.y * r / z; // diameter on the screen
  bool dot_ = pixels < 1.;
  if (dot_) r = 0.;
  if (d < show.x || d > show.y || any(greaterThan(c - r, cut))) {
    gl_Position = vec4(2., 2., 2., 1.); gl_PointSize = 1.; return;
  }
  float i = 0.;
  if (mode == 0) i = 15. * clamp(log(d / edges[0]) / log(edges[1] / edges[0]), 0., 1.);
  ${
    body
      ? `else i = float(mode == 1 ? min(kind.y >> 8, 15u) : kind.y & 7u);
  t = turn; ax = vec3(1., axes); shape = int(kind.x);
  if (shape > 0 && pixels < lod) { shape = 0; r *= .78; }`
      : `else for (int k = 0; k < 15; k++) i += step(edges[k], d);`
  }
  rgb = mix(palette[int(i)], palette[min(15, int(i) + 1)], fract(i));
  float s = dot_ ? 1. : 1.1 * pixels * inversesqrt(1. - r * r / dot(e, e)) + 1.;
  vec2 at = f * vec2(dot(e, right), dot(e, up)) / z + o;
  ${quad ? `at += s / view * (vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2. - 1.);` : `gl_PointSize = s;`}
  gl_Position = vec4(at * margin, 0., 1.);
}`;

/** @param {boolean} body */
export const grainFragment = (body) => `#version 300 es
${COMMON}
${
  body
    ? `flat in vec4 t; flat in vec3 ax; flat in int shape; uniform sampler2D planes;
vec3 rotate(vec4 k, vec3 v) { return v + 2. * cross(k.xyz, cross(k.xyz, v) + k.w * v); }`
    : ""
}
flat in vec3 c, rgb; flat in float r, z; out vec4 color;
void main() {
  if (r == 0.) { color = vec4(rgb * .68, 1.); gl_FragDepth = zk.x - zk.y / z; return; }
  vec2 k = (gl_FragCoord.xy / view * 2. - 1. - o) / f;
  vec3 dir = normalize(ahead + k.x * right + k.y * up), m = eye - c, n;
  float a, b;
  ${
    body
      ? `vec4 back = vec4(-t.xyz, t.w);
  if (dot(m, m) - pow(dot(m, dir), 2.) > r * r) discard;
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
  n = normalize(rotate(t, n));`
      : `float s = dot(m, dir); vec3 across = m - s * dir;
  float h = r * r - dot(across, across);
  if (h < 0.) discard;
  h = sqrt(h); a = -s - h; b = -s + h; n = (m + a * dir) / r;`
  }
  vec3 meet = (cut - eye) / dir, enter = mix(vec3(-1e9), meet, lessThan(dir, vec3(0.)));
  vec3 leave = mix(meet, vec3(1e9), lessThan(dir, vec3(0.)));
  float first = max(enter.x, max(enter.y, enter.z));
  if (first > b || max(first, a) > min(leave.x, min(leave.y, leave.z))) discard;
  float l = 1.;
  if (first > a) a = first;
  else l = .34 + .56 * max(dot(n, normalize(-ahead + .5 * up - .35 * right)), 0.) + .1 * n.z;
  color = vec4(rgb * l, 1.);
  gl_FragDepth = zk.x - zk.y / (a * dot(dir, ahead));
}`;

/** Lines of the outline: points in mm. */
export const lineVertex = `#version 300 es
${COMMON}
layout(location=0) in vec3 p;
void main() {
  vec3 e = p - eye; float z = dot(e, ahead);
  gl_Position = vec4((f * vec2(dot(e, right), dot(e, up)) + o * z) * margin, z * (2. * zk.x - 1.) - 2. * zk.y, z);
}`;

export const lineFragment = `#version 300 es
precision highp float;
uniform vec4 ink; out vec4 color;
void main() { color = ink; }`;
