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

/**
 * Events: `change` (camera, cut, sizes or colours), `progress` (grains arrived), `frame` (something was drawn), `rest`
 * (the picture is whole), `lost` and `error` (`event.detail` is the error).
 */
export class Viewer extends EventTarget {
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
    this.pose = home();
    /** @type {number[]} */
    this.cut = [FAR, FAR, FAR];
    this.show = [0, FAR];
    this.colour = "size";
    /** Lower limits of the size classes, ascending, mm. @type {number[]} */
    this.classes = [];
    this.counts = new Uint32Array(65537);
    this.arrived = 0;
    this.sorted = true;
    this.last = 65535;
    this.drawn = -1;
    /** The last frame: its time in ms, its grains, and its resolution as a share. */
    this.frame = { ms: 0, grains: 0, scale: 1, moving: false };
    this.governor = { scale: 1 / 3, grains: 20_000 };
    this.slice = 0;
    this.run = 0;
    /** @type {(() => Promise<ReadableStream<Uint8Array>>) | undefined} */
    this.open = undefined;
    this.limit = Infinity;
    this.total = 0;
    /** @type {Drawing | undefined} */
    this.drawing = undefined;
    /** @type {import("./read.js").Head | undefined} */
    this.head = undefined;
    /** @type {Uint32Array | undefined} */
    this.above = undefined;
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
    const stream = await open();
    if (run !== this.run) return;
    await read(
      stream,
      (head) => {
        if (run !== this.run) return;
        this.drawing?.end();
        this.head = head;
        this.total = Math.min(head.count, limit);
        this.drawing = new Drawing(this.gl, head, this.total, this.pointLimit);
        this.counts.fill(0);
        Object.assign(this, { arrived: 0, sorted: true, last: 65535, drawn: -1, above: undefined });
        this.request(false);
      },
      (records) => {
        if (run === this.run) this.add(records);
      },
      limit,
    );
  }

  /** @param {Uint8Array} records */
  add(records) {
    const { head, drawing } = this;
    if (!head || !drawing) return;
    const view = new DataView(records.buffer, records.byteOffset, records.byteLength);
    let { last, sorted } = this;
    for (let at = 6; at < records.length; at += head.stride) {
      const value = view.getUint16(at, true);
      this.counts[value]++;
      if (value > last) sorted = false;
      last = value;
    }
    Object.assign(this, { last, sorted, above: undefined });
    drawing.add(records);
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
    if (!this.above) {
      this.above = new Uint32Array(65538);
      for (let v = 65535; v >= 0; v--) this.above[v] = this.above[v + 1] + this.counts[v];
    }
    const value = (size / (this.head?.dmax ?? 1)) * 65535;
    const from = also ? Math.ceil(value - 1e-3) : Math.floor(value + 1e-3) + 1;
    return this.above[Math.max(0, Math.min(65536, from))];
  }

  /** Indices of the first grain shown and of the one after the last, by size. */
  range() {
    return [this.larger(this.show[1]), this.larger(this.show[0], true)];
  }

  /** Indices of the first grain to draw and of the one after the last. */
  ends() {
    return this.sorted ? this.range() : [0, this.arrived];
  }

  /** What is drawn as a sprite larger than the limit comes first; the number of these. */
  large(/** @type {import("./camera.js").Camera} */ view, /** @type {number} */ height) {
    const limit = this.drawing?.limit ?? 1;
    const size = ((limit - 2) * view.zk[1]) / view.zk[0] / (0.6 * height * view.f[1]);
    const large = this.larger(size);
    return this.sorted ? large : large && this.arrived;
  }

  /** @returns {import("./draw.js").Style} */
  style(lod = 6) {
    const { dmin, dmax, size } = /** @type {import("./read.js").Head} */ (this.head);
    const mode = ["size", "class", "aggregate"].indexOf(this.colour);
    const steps = this.classes.slice(1, 16);
    const edges =
      mode === 1
        ? [...steps, ...Array(16 - steps.length).fill(FAR)]
        : [dmin, Math.max(dmax, 1.0001 * dmin), ...Array(14).fill(FAR)];
    const ink = getComputedStyle(this.canvas)
      .color.match(/[\d.]+/g)
      ?.map(Number) ?? [128, 128, 128];
    return {
      mode,
      edges,
      lod,
      palette: [viridis, classes(this.classes.length), aggregates][mode],
      cut: this.cut.map((c, i) => (c < size[i] ? c : FAR)),
      show: this.sorted ? [0, FAR] : this.show,
      ink: [...ink.slice(0, 3).map((c) => c / 255), ink[3] ?? 1],
    };
  }

  /**
   * Draws grains `from` to `to`; resolves with the time in ms until the graphics processor was done.
   * @param {number[]} pixels
   * @param {number} from
   * @param {number} to
   * @param {boolean} first whether the picture starts here
   * @param {number} [lod] see Style
   */
  async #draw(pixels, from, to, first, lod) {
    const { drawing, head, pose } = this;
    if (!drawing || !head) return 0;
    const start = performance.now();
    const view = camera(pose, head.size, head.dmax / 2, pixels, [0, 0, ...pixels]);
    const style = this.style(lod);
    if (first) drawing.start(view, style, pixels);
    drawing.grains(view, style, pixels, from, to, this.large(view, pixels[1]));
    await drawing.done();
    return performance.now() - start;
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
      if (this.head && this.drawing && !this.gl.isContextLost()) {
        await (this.moving ? this.#move() : this.#rest());
        this.dispatchEvent(new Event("frame"));
      }
      this.asked = false;
      if (this.again) this.ask();
    });
  }

  /** Width and height of the canvas on the screen, in its pixels. @param {number} scale */
  #size(scale) {
    const ratio = Math.min(2, devicePixelRatio) * scale;
    const size = [this.canvas.clientWidth, this.canvas.clientHeight].map((l) => Math.max(1, Math.round(l * ratio)));
    if (this.canvas.width !== size[0]) this.canvas.width = size[0];
    if (this.canvas.height !== size[1]) this.canvas.height = size[1];
    return size;
  }

  async #move() {
    const g = this.governor;
    const [from, end] = this.ends();
    const to = Math.min(end, from + Math.round(g.grains));
    const { scale } = g;
    this.moving = this.again = false;
    const ms = await this.#draw(this.#size(scale), from, to, true, 24);
    this.frame = { ms, grains: to - from, scale, moving: true };
    const k = Math.sqrt(TARGET_MS / ms);
    if (ms > TARGET_MS) {
      if (scale > 0.34) g.scale = Math.max(1 / 3, scale * Math.max(k, 0.6));
      else g.grains = Math.max(500, (to - from) * Math.max(k, 0.6));
    } else if (ms < 0.7 * TARGET_MS) {
      if (to < end && scale <= 0.5) g.grains *= Math.min(k, 1.3);
      else g.scale = Math.min(1, scale * Math.min(k, 1.15));
    }
    if (!this.again) this.timer = setTimeout(() => this.request(false), REST_MS);
  }

  async #rest() {
    const [from, end] = this.ends();
    const first = this.drawn < from;
    const start = first ? from : this.drawn;
    // Spheres are cheap; a pixel of a polyhedron costs as much as its faces, and the largest come first.
    if (first) this.slice = this.head?.stride === 24 ? 24 : SLICE / 4;
    const to = Math.min(end, start + this.slice);
    this.again = false;
    if (!first && to <= start) return;
    this.drawn = to;
    const ms = await this.#draw(this.#size(1), start, to, first);
    this.frame = { ms, grains: to - start, scale: 1, moving: false };
    if (to - start === this.slice)
      this.slice = Math.round(Math.max(50, Math.min(SLICE, this.slice * Math.min(4, (2 * TARGET_MS) / ms))));
    if (this.drawn === to && to < end) this.again = true;
    else if (!this.again && this.arrived === this.total) this.dispatchEvent(new Event("rest"));
  }

  #changed() {
    this.request();
    this.dispatchEvent(new Event("change"));
  }

  /** Turns the camera by angles in rad. @param {number} az @param {number} el */
  turn(az, el) {
    this.pose.az += az;
    this.pose.el = Math.max(-1.57, Math.min(1.57, this.pose.el + el));
    this.#changed();
  }

  /** Moves the picture, in halves of its shorter side. @param {number} x @param {number} y */
  move(x, y) {
    this.pose.pan = [this.pose.pan[0] + x, this.pose.pan[1] + y].map((p) => Math.max(-99, Math.min(99, p)));
    this.#changed();
  }

  /** Magnifies about a place of the picture. @param {number} by @param {number[]} [place] */
  magnify(by, place = [0, 0]) {
    const { zoom, pan } = this.pose;
    this.pose.zoom = Math.max(0.3, Math.min(60, zoom * by));
    this.pose.pan = pan.map((p, i) => place[i] - ((place[i] - p) * this.pose.zoom) / zoom);
    this.#changed();
  }

  /** Back to the first view, without cuts. */
  reset() {
    this.pose = home();
    this.cut = [FAR, FAR, FAR];
    this.#changed();
  }

  /** Cuts in the middle across x, y, z, then not at all. */
  cycleCut() {
    const size = this.head?.size ?? [0, 0, 0];
    const axis = this.cut.findIndex((c, i) => c < size[i]) + 1;
    this.cut = size.map((s, i) => (i === axis ? s / 2 : FAR));
    this.#changed();
  }

  /** @param {{cut?: number[], show?: number[], colour?: string, classes?: number[]}} what cut and sizes in mm */
  set(what) {
    Object.assign(this, what);
    this.#changed();
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
