// The part of the viewer that talks to WebGL 2: programs, the buffer of grains, and drawing a range of them.
// @ts-check
import { grainFragment, grainVertex, lineFragment, lineVertex } from "./shaders.js";

/** @typedef {import("./read.js").Head} Head */
/** @typedef {import("./camera.js").Camera} Camera */
/**
 * How grains are drawn, beside the camera.
 * @typedef {object} Style
 * @property {number[]} cut in x, y, z, mm: what lies beyond is not drawn
 * @property {number[]} show smallest and largest size drawn, mm
 * @property {number} lod polyhedra smaller than this are drawn as spheres of about their volume, pixels
 * @property {number} mode 0: by size, edges[0] to edges[1]; 1: by class, whose lower edges are `edges`
 *   for spheres; 2: by aggregate
 * @property {number[]} edges mm
 * @property {number[][]} palette 16 colours, red, green, blue from 0 to 1
 * @property {number[]} ink colour of the outline, with its opacity
 */

/**
 * @param {WebGL2RenderingContext} gl
 * @param {string} vertex
 * @param {string} fragment
 */
function link(gl, vertex, fragment) {
  const program = /** @type {WebGLProgram} */ (gl.createProgram());
  for (const [type, text] of /** @type {[number, string][]} */ ([
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(type));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getShaderInfoLog(shader) ?? "shader");
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  /** @type {Record<string, WebGLUniformLocation | null>} */
  const known = {};
  const at = (/** @type {string} */ name) => (known[name] ??= gl.getUniformLocation(program, name));
  return { program, at };
}

export class Drawing {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Head} head
   * @param {number} room number of grains that the buffer holds
   * @param {number} limit largest sprite drawn as a point, pixels
   */
  constructor(gl, head, room, limit) {
    this.gl = gl;
    this.head = head;
    this.filled = 0;
    this.limit = Math.min(limit, gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE)[1]);
    /** Programs by what they draw, made when they are needed. @type {Record<string, ReturnType<typeof link>>} */
    this.programs = {};
    this.buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, Math.max(1, room) * head.stride, gl.STATIC_DRAW);
    this.outline = gl.createBuffer();
    this.texture = gl.createTexture();
    const width = 1 + Math.max(0, ...head.templates.map((t) => t.length / 4));
    const texels = new Float32Array(4 * width * Math.max(1, head.templates.length)).fill(-1);
    head.templates.forEach((t, i) => texels.set(t, 4 * width * i));
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, texels.length / 4 / width, 0, gl.RGBA, gl.FLOAT, texels);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }

  /** @param {Uint8Array} records */
  add(records) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, this.filled, records);
    this.filled += records.length;
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
    for (const b of [this.buffer, this.outline]) gl.deleteBuffer(b);
    for (const { program } of Object.values(this.programs)) gl.deleteProgram(program);
    gl.deleteTexture(this.texture);
  }

  /**
   * @param {"points" | "quads" | "lines"} kind
   * @param {Camera} camera
   * @param {number[]} pixels
   * @param {number} margin pixels by which the viewport is larger on each side
   */
  use(kind, camera, pixels, margin) {
    const { gl } = this;
    const body = this.head.stride === 24;
    const { program, at } = (this.programs[kind] ??=
      kind === "lines"
        ? link(gl, lineVertex, lineFragment)
        : link(gl, grainVertex(kind === "quads", body), grainFragment(body)));
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(program);
    gl.viewport(-margin, -margin, pixels[0] + 2 * margin, pixels[1] + 2 * margin);
    for (const k of /** @type {(keyof Camera)[]} */ (["eye", "right", "up", "ahead"])) gl.uniform3fv(at(k), camera[k]);
    for (const k of /** @type {(keyof Camera)[]} */ (["f", "o", "zk"])) gl.uniform2fv(at(k), camera[k]);
    gl.uniform2fv(
      at("margin"),
      pixels.map((p) => p / (p + 2 * margin)),
    );
    return at;
  }

  /**
   * Draws the grains `from` to `to`. Those before index `large` of the order are sprites above the limit: a point whose
   * size is above the limit of the device would be cut short, so they are drawn as quads. A point whose centre is off
   * the viewport is not drawn at all, so the viewport is larger than the target by half of the largest point.
   * @param {Camera} camera
   * @param {Style} style
   * @param {number[]} pixels
   * @param {number} from
   * @param {number} to
   * @param {number} large
   */
  grains(camera, style, pixels, from, to, large) {
    const { gl, head } = this;
    const split = Math.min(to, Math.max(from, large));
    for (const [kind, a, b] of /** @type {["quads" | "points", number, number][]} */ ([
      ["quads", from, split],
      ["points", split, to],
    ])) {
      if (a >= b) continue;
      const quads = kind === "quads";
      const at = this.use(kind, camera, pixels, Math.ceil(this.limit / 2));
      gl.uniform2fv(at("view"), pixels);
      gl.uniform3fv(at("size"), head.size);
      gl.uniform3fv(at("cut"), style.cut);
      gl.uniform2fv(at("show"), style.show);
      gl.uniform1f(at("dmax"), head.dmax);
      gl.uniform1f(at("lod"), style.lod);
      gl.uniform1fv(at("edges"), style.edges);
      gl.uniform3fv(at("palette"), style.palette.flat());
      gl.uniform1i(at("mode"), style.mode);
      gl.bindTexture(gl.TEXTURE_2D, this.texture);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
      const first = quads ? a * head.stride : 0;
      const attribute = (
        /** @type {number} */ i,
        /** @type {number} */ n,
        /** @type {number} */ type,
        /** @type {number} */ offset,
      ) => {
        gl.enableVertexAttribArray(i);
        if (i < 3) gl.vertexAttribPointer(i, n, type, true, head.stride, first + offset);
        else gl.vertexAttribIPointer(i, n, type, head.stride, first + offset);
        gl.vertexAttribDivisor(i, quads ? 1 : 0);
      };
      attribute(0, 4, gl.UNSIGNED_SHORT, 0);
      if (head.stride === 24) {
        attribute(1, 4, gl.SHORT, 8);
        attribute(2, 2, gl.UNSIGNED_SHORT, 16);
        attribute(3, 2, gl.UNSIGNED_SHORT, 20);
      }
      if (quads) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, b - a);
      else gl.drawArrays(gl.POINTS, a, b - a);
      for (let i = 0; i < 4; i++) gl.disableVertexAttribArray(i);
    }
  }

  /**
   * Starts a picture: the ground, the edges of the specimen, and of the section at each cut.
   * @param {Camera} camera
   * @param {Style} style
   * @param {number[]} pixels
   */
  start(camera, style, pixels) {
    const { gl, head } = this;
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!style.ink[3]) return;
    const lines = edges(head, style.cut);
    const at = this.use("lines", camera, pixels, 0);
    gl.uniform4fv(at("ink"), style.ink);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.outline);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(lines), gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.vertexAttribDivisor(0, 0);
    gl.drawArrays(gl.LINES, 0, lines.length / 3);
    gl.disableVertexAttribArray(0);
  }
}

/**
 * Ends of the lines that outline the specimen, and the plane of each cut within its box.
 * @param {Head} head
 * @param {number[]} cut
 */
function edges({ size, specimen }, cut) {
  /** @type {number[]} */
  const out = [];
  const square = (/** @type {number} */ axis, /** @type {number} */ at) => {
    const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    const corners = [
      [0, 0],
      [1, 0],
      [1, 1],
      [0, 1],
    ].map(([a, b]) => {
      const p = [0, 0, 0];
      [p[axis], p[u], p[v]] = [at, a * size[u], b * size[v]];
      return p;
    });
    corners.forEach((p, i) => out.push(...p, ...corners[(i + 1) % 4]));
    return corners;
  };
  const circle = (/** @type {number} */ z) => {
    const p = (/** @type {number} */ i) =>
      [0, 1].map((k) => (size[k] / 2) * (1 + (k ? Math.sin : Math.cos)((i * Math.PI) / 48))).concat(z);
    for (let i = 0; i < 96; i++) out.push(...p(i), ...p(i + 1));
    return [0, 24, 48, 72].map(p);
  };
  const ring = specimen === 1 ? circle : (/** @type {number} */ z) => square(2, z);
  const top = ring(size[2]);
  ring(0).forEach((p, i) => out.push(...p, ...top[i]));
  for (let axis = 0; axis < 3; axis++) {
    if (cut[axis] >= size[axis]) continue;
    if (axis === 2) ring(cut[2]);
    else square(axis, cut[axis]);
  }
  return out;
}
