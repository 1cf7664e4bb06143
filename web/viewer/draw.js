// The part of the viewer that talks to WebGL 2: the buffer of grains, and drawing a range of them.
//
// Each grain is a square on the screen. The fragment shader meets the ray through its pixel with the body, writes its
// depth, and draws the section where a cut goes through. What it knows by itself are spheres; `bodies.js` has the rest.
// @ts-check
import { matrixFragment, matrixVertex, MORTAR } from "./matrix.js";

/** @typedef {import("./read.js").Head} Head */
/** @typedef {import("./camera.js").Camera} Camera */
/**
 * How grains are drawn, beside the camera. The shaders know each by its name.
 * @typedef {object} Style
 * @property {number[]} cut in x, y, z, mm: what lies beyond any of them is not drawn
 * @property {number[]} octant 1: what lies beyond all three is not drawn
 * @property {number[]} plane normal and distance in mm: what lies beyond is not drawn
 * @property {number[]} matrix 1: drawn, with the faces of the specimen
 * @property {number[]} periodic 1: the faces of the box are joined, and the images of grains that cross them are drawn
 * @property {number[]} [pick] 1: colours are the numbers of the grains
 * @property {number[]} lod polyhedra smaller than this are drawn as spheres of about their volume, pixels
 * @property {number[]} mode 0: by size; 1: by class; 2: by aggregate
 * @property {number[]} steps 16 colours: red, green, blue from 0 to 1, and the least size of the next class, mm
 * @property {number[]} ink colour of the outline, with its opacity
 */
/**
 * What is particular to a kind of grains, in GLSL.
 * @typedef {object} Kind
 * @property {string} inputs what the vertex shader has beyond the first 8 bytes of a record, and what it passes on
 * @property {string} read reads these, and sets the step `i` of the colour by class or aggregate
 * @property {string} passed what the fragment shader gets of it, and functions
 * @property {string} meet sets where the ray enters the body, `a`, and leaves it, `b`, and the normal `n`, or discards
 * @property {WebGLTexture} [texture] that `meet` reads, bound
 */

/** @type {Kind} */
const SPHERES = {
  inputs: "",
  read: "if (mode == 1.) for (int k = 0; k < 15; k++) i += step(steps[k].w, d);",
  passed: "",
  meet: `float s = dot(m, dir); vec3 across = m - s * dir;
    float h = r * r - dot(across, across);
    if (h < 0.) discard;
    h = sqrt(h); a = -s - h; b = -s + h; n = (m + a * dir) / r;`,
};

/** What all shaders begin with. */
const HEAD = `#version 300 es
precision highp float; precision highp int;
uniform vec4 ink, steps[16]; uniform vec3 eye, right, up, ahead, size, cut; uniform vec2 f, o, view, margin, zk;
uniform float lod, mode, dmin, dmax, octant, periodic; uniform vec4 plane;
`;

/** The part of a ray, and the light on a cut where it begins, that is kept of an interval. */
const KEPT = `
vec3 kept(vec3 dir, float a, float b) {
  float lit = 1.;
  float down = dot(plane.xyz, dir), on = (plane.w - dot(plane.xyz, eye)) / down;
  if (down < 0.) a = max(a, on); else if (down > 0.) b = min(b, on);
  vec3 meet = (cut - eye) / dir;
  bvec3 inwards = lessThan(dir, vec3(0.));
  if (octant > 0.) {
    vec3 enter = mix(meet, vec3(-1e9), inwards), leave = mix(vec3(1e9), meet, inwards);
    float to = min(leave.x, min(leave.y, leave.z));
    if (a < to && a >= max(enter.x, max(enter.y, enter.z))) {
      a = to;
      lit = to == leave.x ? .93 : to == leave.y ? .85 : 1.;
    }
  } else {
    vec3 enter = mix(vec3(a), meet, inwards), leave = mix(meet, vec3(b), inwards);
    a = max(max(a, enter.x), max(enter.y, enter.z)); b = min(min(b, leave.x), min(leave.y, leave.z));
  } return vec3(a, b, lit);
}
`;

const grainVertex = (/** @type {Kind} */ kind) => `${HEAD}
layout(location=0) in vec4 q; layout(location=3) in float quad;
${kind.inputs}
flat out vec3 c, rgb; flat out float r, number; uniform float start; uniform vec3 image;
void main() {
  float d = q.w * dmax; r = .5 * d; c = q.xyz * size;
  // the image beyond the faces that are nearest along the axes of the image, of a grain that crosses them
  vec3 low = step(c, .5 * size), over = mix(c + r - size, r - c, low);
  bool absent = any(lessThan(over * image, vec3(0.)));
  c += image * size * (2. * low - 1.);
  vec3 e = c - eye; float z = dot(e, ahead), i = 0.;
  // the diameter on the screen, and the side of the square
  float pixels = view.y * f.y * r / z, s = 1.;
  if (pixels < 1.) r = 0.;
  ${kind.read}
  if (mode == 0.) i = 15. * clamp(log(d / dmin) / log(max(dmax / dmin, 1.0001)), 0., 1.);
  rgb = mix(steps[int(i)], steps[min(15, int(i) + 1)], fract(i)).rgb;
  if (r > 0.) s = 1.1 * pixels * inversesqrt(1. - r * r / dot(e, e)) + 1.;
  vec2 at = f * vec2(dot(e, right), dot(e, up)) / z + o;
  at += quad * s / view * (vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1) * 2. - 1.);
  bvec3 beyond = greaterThan(c - r, cut);
  if ((octant > 0. ? all(beyond) : any(beyond)) || dot(plane.xyz, c) - r > plane.w || absent) at = vec2(1e3);
  number = start + float(quad > 0. ? gl_InstanceID : gl_VertexID);
  gl_PointSize = s;
  gl_Position = vec4(at * margin, 0., 1.);
}`;

const grainFragment = (/** @type {Kind} */ kind) => `${HEAD}${KEPT}
${kind.passed}
flat in vec3 c, rgb; flat in float r, number; uniform float pick; out vec4 color;
void main() {
  vec2 k = (gl_FragCoord.xy / view * 2. - 1. - o) / f;
  vec3 dir = normalize(ahead + k.x * right + k.y * up), m = eye - c, n;
  float light = .68, depth = -dot(m, ahead), a, b;
  if (r > 0.) {
    ${kind.meet}
    vec3 sun = normalize(-ahead + .5 * up - .35 * right), p = -eye / dir, q = (size - eye) / dir;
    float shine = .34 + .56 * max(dot(n, sun), 0.) + .1 * n.z;
    if (periodic > 0.) {
      vec3 near = min(p, q), far = max(p, q);
      float on = max(near.x, max(near.y, near.z));
      b = min(b, min(far.x, min(far.y, far.z)));
      if (on > a) { a = on; n = -sign(dir) * step(on, near); shine = .5 + .34 * max(dot(n, sun), 0.) + .1 * n.z; }
    }
    vec3 part = kept(dir, a, b);
    if (part.x > part.y) discard;
    light = part.x > a ? part.z : shine;
    depth = part.x * dot(dir, ahead);
  }
  color = vec4(rgb * light, 1.);
  if (pick > 0.) color = vec4(mod(vec3(number, floor(number / 256.), floor(number / 65536.)), 256.) / 255., 1.);
  gl_FragDepth = zk.x - zk.y / depth;
}`;

/** Lines of the outline: points in mm. */
const lineVertex = `${HEAD}
layout(location=0) in vec3 p;
void main() {
  vec3 e = p - eye; float z = dot(e, ahead);
  gl_Position = vec4((f * vec2(dot(e, right), dot(e, up)) + o * z) * margin, z * (2. * zk.x - 1.) - 2. * zk.y, z);
}`;

const lineFragment = `${HEAD}
out vec4 color;
void main() { color = ink; }`;

/**
 * Makes a program; gives what uses it with values of its uniforms, by their names.
 * @param {WebGL2RenderingContext} gl
 * @param {string[]} texts of the vertex and the fragment shader
 */
function link(gl, ...texts) {
  const program = /** @type {WebGLProgram} */ (gl.createProgram());
  texts.forEach((text, i) => {
    const shader = /** @type {WebGLShader} */ (gl.createShader(i ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getShaderInfoLog(shader) ?? "shader");
    }
    gl.attachShader(program, shader);
  });
  gl.linkProgram(program);
  /** @type {Record<string, WebGLUniformLocation | null>} */
  const places = {};
  const use = (/** @type {Record<string, number[]>} */ uniforms) => {
    gl.useProgram(program);
    for (const [name, value] of Object.entries(uniforms)) {
      const set = /** @type {"uniform4fv"} */ (`uniform${Math.min(4, value.length)}fv`);
      gl[set]((places[name] ??= gl.getUniformLocation(program, name)), value);
    }
  };
  return { program, use };
}

export class Drawing {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Head} head
   * @param {number} room number of grains that the buffer holds
   * @param {number} limit largest sprite drawn as a point, pixels
   * @param {Kind} [kind]
   */
  constructor(gl, head, room, limit, kind = SPHERES) {
    this.gl = gl;
    this.head = head;
    this.texture = kind.texture ?? null;
    this.limit = Math.min(limit, gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE)[1]);
    this.grains = link(gl, grainVertex(kind), grainFragment(kind));
    this.lines = link(gl, lineVertex, lineFragment);
    this.matrix = link(gl, HEAD + matrixVertex, HEAD + KEPT + matrixFragment);
    this.outline = gl.createBuffer();
    this.records = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.records);
    gl.bufferData(gl.ARRAY_BUFFER, Math.max(1, room) * head.stride, gl.STATIC_DRAW);
    gl.enable(gl.DEPTH_TEST);
  }

  /**
   * @param {number} at grains that are there already
   * @param {Uint8Array} records
   */
  add(at, records) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.records);
    gl.bufferSubData(gl.ARRAY_BUFFER, at * this.head.stride, records);
  }

  /** The bytes of a grain. @param {number} index */
  record(index) {
    const { gl } = this;
    const bytes = new Uint8Array(this.head.stride);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.records);
    gl.getBufferSubData(gl.ARRAY_BUFFER, index * bytes.length, bytes);
    return bytes;
  }

  /** Resolves when the graphics processor has done what it was told. */
  async done() {
    const { gl } = this;
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    while (sync && !gl.isContextLost() && gl.getSyncParameter(sync, gl.SYNC_STATUS) === gl.UNSIGNALED) {
      await new Promise((resolve) => setTimeout(resolve, 1));
    }
    gl.deleteSync(sync);
  }

  /** Frees what the graphics processor holds. */
  end() {
    const { gl } = this;
    for (const buffer of [this.outline, this.records]) gl.deleteBuffer(buffer);
    for (const { program } of [this.lines, this.grains, this.matrix]) gl.deleteProgram(program);
    gl.deleteTexture(this.texture);
  }

  /**
   * Draws the grains `from` to `to`. Those before index `large` of the order are sprites above the limit: a point whose
   * size is above the limit of the device would be cut short, so they are drawn as quads. A point whose centre is off
   * the viewport is not drawn at all, so the viewport is larger than the target by half of the largest point.
   * @param {Camera} camera
   * @param {Style} style
   * @param {number} from
   * @param {number} to
   * @param {number} large
   * @param {boolean} first whether the picture starts here: with the ground and the outline
   */
  draw(camera, style, from, to, large, first) {
    const { gl, head } = this;
    const { stride, size } = head;
    const margin = Math.ceil(this.limit / 2);
    const [width, height] = camera.view.map((p) => p + 2 * margin);
    gl.viewport(-margin, -margin, width, height);
    const uniforms = {
      ...camera,
      pick: [0],
      ...style,
      size,
      dmin: [head.dmin],
      dmax: [head.dmax],
      margin: [camera.view[0] / width, camera.view[1] / height],
    };
    if (first) {
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      if (style.ink[3]) {
        const lines = new Float32Array(outline(head, style));
        this.lines.use(uniforms);
        gl.bindBuffer(gl.ARRAY_BUFFER, this.outline);
        gl.bufferData(gl.ARRAY_BUFFER, lines, gl.DYNAMIC_DRAW);
        gl.enableVertexAttribArray(0);
        gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
        gl.vertexAttribDivisor(0, 0);
        gl.drawArrays(gl.LINES, 0, lines.length / 3);
      }
      if (style.matrix[0] && head.specimen < 2) {
        this.matrix.use({ ...uniforms, mortar: MORTAR, specimen: [head.specimen] });
        gl.disableVertexAttribArray(0);
        gl.drawArrays(gl.TRIANGLES, 0, 3);
      }
    }
    this.grains.use(uniforms);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.records);
    const split = Math.min(to, Math.max(from, large));
    for (const [quad, start, end] of [
      [1, from, split],
      [0, split, to],
    ]) {
      if (start >= end) continue;
      // A record is one or three attributes of four numbers of two bytes.
      for (let i = 0; i < stride / 8; i++) {
        gl.enableVertexAttribArray(i);
        gl.vertexAttribPointer(i, 4, i === 1 ? gl.SHORT : gl.UNSIGNED_SHORT, i < 2, stride, start * stride + 8 * i);
        gl.vertexAttribDivisor(i, quad);
      }
      gl.vertexAttrib1f(3, quad);
      for (let axes = 0; axes < (style.periodic[0] ? 8 : 1); axes++) {
        this.grains.use({ start: [start], image: [axes & 1, (axes >> 1) & 1, axes >> 2] });
        if (quad) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, end - start);
        else gl.drawArrays(gl.POINTS, 0, end - start);
      }
    }
    for (let i = 0; i < 3; i++) gl.disableVertexAttribArray(i);
  }
}

/**
 * Ends of the lines that outline the specimen, and the plane of each cut within its box, or what is removed of a box.
 * @param {Head} head
 * @param {Style} style
 */
function outline({ size, specimen }, { cut, octant }) {
  /** @type {number[]} */
  const lines = [];
  /** Draws what a plane has of the specimen; gives four of its points. @param {number} axis @param {number} at */
  const ring = (axis, at) => {
    const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    const round = specimen === 1 && axis === 2;
    const points = Array.from({ length: round ? 96 : 4 }, (_, i) => {
      const angle = ((round ? i : 12 + 24 * i) * Math.PI) / 48;
      const reach = round ? 1 : Math.SQRT2;
      const p = [at, at, at];
      p[u] = (size[u] / 2) * (1 + reach * Math.cos(angle));
      p[v] = (size[v] / 2) * (1 + reach * Math.sin(angle));
      return p;
    });
    points.forEach((p, i) => lines.push(...p, ...points[(i + 1) % points.length]));
    return points.filter((_, i) => i % (points.length / 4) === 0);
  };
  const top = ring(2, size[2]);
  ring(2, 0).forEach((p, i) => lines.push(...p, ...top[i]));
  if (!octant[0]) cut.forEach((at, axis) => at < size[axis] && ring(axis, at));
  else if (specimen === 0 && cut.every((at, axis) => at < size[axis]))
    for (let axis = 0; axis < 3; axis++)
      for (const corner of [0, 1, 2, 3]) {
        // An edge of the part that is removed, where it lies at a cut.
        const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        const p = [...cut];
        if (corner & 1) p[u] = size[u];
        if (corner & 2) p[v] = size[v];
        if (corner === 3) continue;
        lines.push(...p);
        p[axis] = size[axis];
        lines.push(...p);
      }
  return lines;
}
