// The matrix around the grains: the faces of the specimen and of its cuts, as one picture of a box or a cylinder.
// @ts-check

/** Red, green and blue of the matrix, from 0 to 1. */
export const MORTAR = [0.78, 0.76, 0.72];

/** One triangle that covers the picture. */
export const matrixVertex = `
void main() {
  gl_Position = vec4((vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4. - 1.) * margin, 0., 1.);
}`;

/** The ray through a pixel meets the specimen. What is behind a section of a grain by a hair leaves it in sight. */
export const matrixFragment = `
uniform vec3 mortar; uniform float specimen, pick;
out vec4 color;
void main() {
  vec2 k = (gl_FragCoord.xy / view * 2. - 1. - o) / f;
  vec3 dir = normalize(ahead + k.x * right + k.y * up);
  vec3 p = -eye / dir, q = (size - eye) / dir, low = min(p, q), high = max(p, q), n = vec3(0.);
  if (specimen > 0.) {
    vec2 c = eye.xy - .5 * size.xy;
    float g = dot(dir.xy, dir.xy), s = dot(c, dir.xy), h = s * s - g * (dot(c, c) - .25 * size.x * size.x);
    if (h < 0.) discard;
    h = sqrt(h); low.xy = vec2((-s - h) / g); high.xy = vec2((-s + h) / g);
  }
  float a = max(low.x, max(low.y, low.z)), b = min(high.x, min(high.y, high.z));
  if (a > b) discard;
  if (low.z == a) n.z = -sign(dir.z);
  else if (specimen > 0.) n.xy = normalize(eye.xy + a * dir.xy - .5 * size.xy);
  else if (low.x == a) n.x = -sign(dir.x); else n.y = -sign(dir.y);
  vec3 part = kept(dir, a, b);
  if (part.x > part.y) discard;
  float light = part.x > a ? part.z : .5 + .34 * max(dot(n, normalize(-ahead + .5 * up - .35 * right)), 0.) + .1 * n.z;
  color = pick > 0. ? vec4(0.) : vec4(mortar * light, 1.);
  gl_FragDepth = zk.x - zk.y / (part.x * dot(dir, ahead)) + 2e-6;
}`;
