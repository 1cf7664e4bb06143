// Draws a packing on a canvas from the bytes of the view format, while they arrive and whenever something changes.
// At rest all grains are drawn at full resolution, in slices of about 100 ms between which the page stays answerable.
// While something moves, resolution and number of grains follow the time of the last frame towards 50 ms. Nothing is
// drawn while nothing changes.
// @ts-check
import { camera, home } from "./camera.js";
import { aggregates, classes, viridis } from "./colours.js";
import { controls } from "./controls.js";
import { Drawing } from "./draw.js";
import { read } from "./read.js";

const TARGET_MS = 50;
const SLICE = 250_000;
const REST_MS = 150;
const FAR = 1e9;

const clamp = (/** @type {number} */ low, /** @type {number} */ x, /** @type {number} */ high) =>
  Math.max(low, Math.min(x, high));

/**
 * Events: `change` (camera, cut, sizes or colours), `pick` (`event.detail`: where on the canvas), `progress` (grains
 * arrived), `frame` (something was drawn), `rest` (the picture is whole), `lost` and `error` (`event.detail` is the
 * error).
 */
export class Viewer extends EventTarget {
  pose = home();
  cut = [FAR, FAR, FAR];
  /** Whether what lies beyond all three cuts is removed, and not beyond any of them. */
  octant = false;
  /** Normal and distance of an oblique cut, in mm. @type {number[] | null} */
  plane = null;
  /** Whether the matrix is drawn. */
  matrix = false;
  /** Whether the specimen is a box whose opposite faces are joined. */
  periodic = false;
  /** What it goes back to, beside the first pose. @type {Partial<Pick<Viewer, "cut" | "octant" | "matrix">>} */
  initial = {};
  show = [0, FAR];
  colour = "size";
  /** Lower limits of the size classes, ascending, mm. @type {number[]} */
  classes = [];
  /** Number of the grains that arrived of each size, as a share of the largest times 65535. */
  counts = new Uint32Array(65536);
  arrived = 0;
  total = 0;
  drawn = -1;
  /** The last frame: its time in ms, its grains, and its resolution as a share. */
  frame = { ms: 0, grains: 0, scale: 1, moving: false };
  governor = { scale: 1 / 3, grains: 20_000 };
  slice = 0;
  run = 0;
  /** @type {(() => Promise<ReadableStream<Uint8Array>>) | undefined} */
  open;
  limit = Infinity;
  /** @type {Drawing | undefined} */
  drawing;
  /** @type {import("./read.js").Head | undefined} */
  head;

  /**
   * Throws where the browser has no WebGL 2.
   * @param {HTMLCanvasElement} canvas
   * @param {{pointLimit?: number}} [options] pointLimit: largest sprite drawn as a point, pixels
   */
  constructor(canvas, { pointLimit = 512 } = {}) {
    super();
    const gl = canvas.getContext("webgl2", {
      antialias: false,
      preserveDrawingBuffer: true,
      powerPreference: "high-performance",
    });
    if (!gl) throw new Error("This browser has no WebGL 2.");
    this.canvas = canvas;
    this.gl = gl;
    this.pointLimit = pointLimit;
    canvas.addEventListener("webglcontextlost", (e) => {
      e.preventDefault();
      this.run++;
      this.drawing = undefined;
      this.dispatchEvent(new Event("lost"));
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.load().catch((error) => this.dispatchEvent(new CustomEvent("error", { detail: error })));
    });
    new ResizeObserver(() => this.request(false)).observe(canvas);
    controls(this);
  }

  /**
   * Loads a packing. `open` gives a stream of its bytes; it is called again after a lost context. Resolves when all
   * grains arrived, rejects when they do not.
   * @param {() => Promise<ReadableStream<Uint8Array>>} [open]
   * @param {number} [limit] most grains to load: the largest
   */
  async load(open = this.open, limit = this.limit) {
    if (!open) return;
    this.open = open;
    this.limit = limit;
    const run = ++this.run;
    const records = read(await open(), limit, async (head, table) => {
      const solid = head.stride === 24 ? await import("./bodies.js") : undefined;
      if (run !== this.run) return;
      this.drawing?.end();
      this.head = head;
      this.total = Math.min(head.count, limit);
      this.drawing = new Drawing(this.gl, head, this.total, this.pointLimit, solid?.bodies(this.gl, table));
      this.counts.fill(0);
      this.arrived = 0;
      this.request(false);
    });
    for await (const part of records) {
      if (run !== this.run) return;
      this.add(part);
    }
  }

  /** @param {Uint8Array<ArrayBuffer>} records */
  add(records) {
    const { head, drawing } = this;
    if (!head || !drawing) return;
    const numbers = new Uint16Array(records.buffer, records.byteOffset, records.length / 2);
    for (let i = 3; i < numbers.length; i += head.stride / 2) this.counts[numbers[i]]++;
    drawing.add(this.arrived, records);
    this.arrived += records.length / head.stride;
    this.dispatchEvent(new Event("progress"));
    this.ask();
  }

  /**
   * Number of grains that arrived and are larger than a size in mm, or as large where `also`.
   * @param {number} size
   * @param {boolean} [also]
   */
  larger(size, also = false) {
    const value = (size / (this.head?.dmax ?? 1)) * 65535;
    const first = also ? Math.ceil(value - 1e-3) : Math.floor(value + 1e-3) + 1;
    let number = 0;
    for (let v = first; v < 65536; v++) number += this.counts[v];
    return number;
  }

  /** Indices of the first grain shown and of the one after the last, by size. */
  range() {
    return [this.larger(this.show[1]), this.larger(this.show[0], true)];
  }

  /** @returns {import("./draw.js").Style} */
  style(lod = 6) {
    const mode = ["size", "class", "aggregate"].indexOf(this.colour);
    const palette = [viridis, classes(this.classes.length), aggregates][mode];
    const numbers = getComputedStyle(this.canvas).color.match(/[\d.]+/g) ?? [128, 128, 128];
    const [red, green, blue, opacity = 1] = numbers.map(Number);
    return {
      mode: [mode],
      lod: [lod],
      steps: palette.flatMap((colour, i) => [...colour, this.classes[i + 1] ?? FAR]),
      cut: this.cut.map((c, i) => (c < (this.head?.size[i] ?? 0) ? c : FAR)),
      octant: [Number(this.octant)],
      plane: this.plane ?? [0, 0, 0, FAR],
      matrix: [Number(this.matrix)],
      periodic: [Number(this.periodic)],
      ink: [red / 255, green / 255, blue / 255, opacity],
    };
  }

  /** What is drawn as a sprite larger than the limit comes first; the number of these. */
  large(/** @type {import("./camera.js").Camera} */ { f, view, zk }) {
    const limit = this.drawing?.limit ?? 1;
    return this.larger(((limit - 2) * zk[1]) / zk[0] / (0.6 * view[1] * f[1]));
  }

  /**
   * Draws grains `from` to `to`; resolves with the time in ms until the graphics processor was done.
   * @param {number} from
   * @param {number} to
   * @param {boolean} first whether the picture starts here
   * @param {number} scale resolution as a share
   * @param {boolean} moving
   */
  async #draw(from, to, first, scale, moving) {
    const { canvas, drawing, head } = this;
    if (!drawing || !head) return 0;
    const ratio = Math.min(2, devicePixelRatio) * scale;
    const pixels = [canvas.clientWidth, canvas.clientHeight].map((l) => Math.max(1, Math.round(l * ratio)));
    const [width, height] = pixels;
    // A canvas that is set to the size that it has is cleared.
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const start = performance.now();
    const view = camera(this.pose, head, pixels);
    drawing.draw(view, this.style(moving ? 24 : 6), from, to, this.large(view), first);
    await drawing.done();
    const ms = performance.now() - start;
    this.frame = { ms, grains: to - from, scale, moving };
    return ms;
  }

  /**
   * Something changed: draws it soon.
   * @param {boolean} [moving] whether more of the like will follow at once
   */
  request(moving = true) {
    this.drawn = -1;
    this.moving = moving;
    clearTimeout(this.timer);
    this.ask();
  }

  /** Draws at the next frame, or at the one after where one is being drawn. */
  ask() {
    this.again = true;
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(async () => {
      if (this.drawing && !this.gl.isContextLost()) {
        this.again = false;
        await (this.moving ? this.#move() : this.#rest());
        this.dispatchEvent(new Event("frame"));
      }
      this.asked = false;
      if (this.again) this.ask();
    });
  }

  async #move() {
    const g = this.governor;
    const { scale } = g;
    const [from, end] = this.range();
    const to = Math.min(end, from + Math.round(g.grains));
    this.moving = false;
    const ms = await this.#draw(from, to, true, scale, true);
    const k = clamp(0.6, Math.sqrt(TARGET_MS / ms), 1.3);
    if (ms > TARGET_MS) {
      if (scale > 0.34) g.scale = Math.max(1 / 3, scale * k);
      else g.grains = Math.max(500, (to - from) * k);
    } else if (ms < 0.7 * TARGET_MS) {
      if (to < end && scale <= 0.5) g.grains *= k;
      else g.scale = Math.min(1, scale * 1.15);
    }
    if (!this.again) this.timer = setTimeout(() => this.request(false), REST_MS);
  }

  async #rest() {
    const [from, end] = this.range();
    const first = this.drawn < from;
    const start = first ? from : this.drawn;
    // Spheres are cheap; a pixel of a polyhedron costs as much as its faces, and the largest come first.
    if (first) this.slice = this.head?.stride === 24 ? 24 : SLICE / 4;
    const to = Math.min(end, start + this.slice);
    if (!first && to <= start) return;
    this.drawn = to;
    const ms = await this.#draw(start, to, first, 1, false);
    if (to - start === this.slice)
      this.slice = Math.round(clamp(50, this.slice * Math.min(4, (2 * TARGET_MS) / ms), SLICE));
    if (this.drawn === to && to < end) this.again = true;
    else if (!this.again && this.arrived === this.total) this.dispatchEvent(new Event("rest"));
  }

  /**
   * Changes what is shown, and draws it.
   * @param {Partial<Pick<Viewer, "pose" | "cut" | "octant" | "plane" | "matrix" | "show" | "colour" |
   *   "classes">>} what cut and sizes in mm
   */
  set(what) {
    Object.assign(this, what);
    this.request();
    this.dispatchEvent(new Event("change"));
  }

  /** Turns the camera by angles in rad. @param {number} az @param {number} el */
  turn(az, el) {
    const { pose } = this;
    this.set({ pose: { ...pose, az: pose.az + az, el: clamp(-1.57, pose.el + el, 1.57) } });
  }

  /** Moves the picture, in halves of its shorter side. @param {number} x @param {number} y */
  move(x, y) {
    const { pan } = this.pose;
    this.set({ pose: { ...this.pose, pan: [pan[0] + x, pan[1] + y].map((p) => clamp(-99, p, 99)) } });
  }

  /** Magnifies about a place of the picture. @param {number} by @param {number[]} [place] */
  magnify(by, place = [0, 0]) {
    const { pose } = this;
    const zoom = clamp(0.3, pose.zoom * by, 60);
    this.set({ pose: { ...pose, zoom, pan: place.map((at, i) => at - ((at - pose.pan[i]) * zoom) / pose.zoom) } });
  }

  /** Back to the first view, with the first cuts. */
  reset() {
    this.set({ pose: home(), cut: [FAR, FAR, FAR], octant: false, plane: null, ...this.initial });
  }

  /** Cuts in the middle across x, y, z, then not at all. */
  cycleCut() {
    const size = this.head?.size ?? [0, 0, 0];
    const axis = this.octant ? 0 : this.cut.findIndex((c, i) => c < size[i]) + 1;
    this.set({ cut: size.map((s, i) => (i === axis ? s / 2 : FAR)), octant: false });
  }

  /**
   * The grain that is seen at a place of the canvas, CSS pixels from its left and top.
   * @param {number} x
   * @param {number} y
   */
  async grainAt(x, y) {
    return (await import("./pick.js")).pick(this, x, y);
  }

  /**
   * The picture as PNG, smoothed by four rays a pixel, with the view of the canvas.
   * @param {number} width pixels
   * @param {number} height pixels
   * @param {number[]} [background] red, green, blue from 0 to 255; transparent when absent
   * @returns {Promise<Blob>}
   */
  async png(width, height, background) {
    return (await import("./picture.js")).picture(this, width, height, background);
  }
}
