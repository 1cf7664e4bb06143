/** The packing in three dimensions: the canvas, its controls, its legend, and what it shows in words and as a table. */
import { h, number, replace, text } from "./dom.js";
import { sizeOf } from "./job-facts.js";
import { classTable, legend } from "./job-legend.js";
import { picturePart } from "./job-picture.js";
import { Cuts, mm, radios, slider, VIEWS } from "./view-controls.js";
import { factsOf, Overlay } from "./view-overlay.js";
import { Viewer } from "./viewer/viewer.js";

/** Most grains that are loaded: 32 MB on a large screen, 8 MB on a small one. */
const MOST = matchMedia("(max-width: 40rem)").matches ? 1_000_000 : 4_000_000;

/**
 * @typedef {object} Source the grains of a result
 * @property {string} name the pictures' file names hold it
 * @property {() => Promise<ReadableStream<Uint8Array>>} open gives their view format from its start
 * @property {number} [limit] most grains that it has: the largest
 */

export class ViewPart {
  /**
   * @param {Source} source
   * @param {any} report the result without its grains
   * @param {any} request
   */
  constructor(source, report, request) {
    this.source = source;
    this.summary = report.summary;
    this.spheres = !report.shapes;
    this.periodic = request?.specimen?.boundary === "periodic";
    const classesBy = this.spheres ? "diameter" : sizeOf(request);
    this.aggregates = report.summary.aggregates ?? [];
    /** How the legend's grains are coloured. @type {string | undefined} */
    this.legendOf = undefined;
    this.said = h("p", { class: "said" }, "Loading the grains");
    this.legend = h("div", { class: "legend", "aria-hidden": "true" });
    this.words = h("p", { id: "view-words", "aria-live": "off" });
    this.canvas = h("canvas", {
      id: "view",
      tabindex: "0",
      role: "img",
      "aria-label": "The packing in three dimensions",
      "aria-describedby": "view-words view-keys",
    });
    this.tools = h("div", { class: "tools" });
    this.stage = h("div", { class: "stage" }, this.canvas, this.said, this.legend);
    this.shown = h(
      "div",
      { class: "shown" },
      this.words,
      h(
        "p",
        { id: "view-keys", class: "hint" },
        "Drag or arrow keys turn, wheel or ",
        h("kbd", {}, "+"),
        " ",
        h("kbd", {}, "−"),
        " magnify, right button or ",
        h("kbd", {}, "Shift"),
        " moves, ",
        h("kbd", {}, "C"),
        " cuts along x, y, z, ",
        h("kbd", {}, "Home"),
        " starts again. A click tells of a grain, ",
        h("kbd", {}, "Enter"),
        " of the one in the middle. On a touch screen one finger turns, two magnify and move.",
      ),
      this.periodic &&
        h("p", { class: "hint" }, "Opposite faces are joined: a grain that crosses one enters at the other."),
      !this.spheres &&
        h(
          "p",
          { class: "hint" },
          `Sizes in the picture are diameters of the enclosing spheres; size classes are by ${classesBy}.`,
        ),
      classTable(this.summary, classesBy),
    );
    this.element = h(
      "section",
      { class: "panel viewer", "aria-labelledby": "view-title" },
      h("h2", { id: "view-title", class: "visually-hidden" }, "Packing"),
      this.stage,
      this.tools,
      this.shown,
    );
  }

  /** Loads and draws. Call it when the element is on the page. */
  async start() {
    try {
      this.viewer = new Viewer(this.canvas);
    } catch (error) {
      return this.#failed(error);
    }
    const { viewer } = this;
    viewer.periodic = this.periodic;
    viewer.classes = this.summary.classes.map((/** @type {any} */ c) => c.d_min_mm);
    viewer.addEventListener("change", () => this.#follow());
    viewer.addEventListener("progress", () => this.#arrived());
    viewer.addEventListener("pick", (event) => this.#pick(/** @type {CustomEvent} */ (event).detail));
    this.overlay = new Overlay(viewer);
    this.stage.append(this.overlay.drawing, this.overlay.card, this.#views());
    viewer.addEventListener("rest", () => {
      this.canvas.dataset.drawn = String(viewer.arrived);
    });
    viewer.addEventListener("frame", () => {
      if (viewer.frame.moving) delete this.canvas.dataset.drawn;
    });
    viewer.addEventListener("lost", () =>
      text(this.said, "The graphics context was lost; the grains are loaded again."),
    );
    viewer.addEventListener("error", (event) => this.#failed(/** @type {CustomEvent} */ (event).detail));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => viewer.request(false));
    await this.#load();
  }

  /** Tells of the grain at a place of the canvas. @param {number[]} place */
  async #pick([x = 0, y = 0]) {
    const { viewer, overlay, summary } = this;
    if (!viewer?.head || !overlay) return;
    const picked = await viewer.grainAt(x, y);
    overlay.show(picked ? { picked, facts: factsOf(picked, viewer.head.count, summary) } : null);
  }

  /** The buttons of the standard views and of the full screen. */
  #views() {
    const view = (/** @type {[string, string, number, number]} */ [name, words, az, el]) =>
      h(
        "button",
        {
          type: "button",
          title: words,
          "aria-label": words,
          onclick: () => this.viewer?.set({ pose: { az, el, zoom: 1, pan: [0, 0.06] } }),
        },
        name,
      );
    const full = h(
      "button",
      {
        type: "button",
        onclick: () =>
          document.fullscreenElement
            ? document.exitFullscreen()
            : this.element.requestFullscreen().catch((error) => text(this.said, error.message)),
      },
      "Full screen",
    );
    document.addEventListener("fullscreenchange", () =>
      text(full, document.fullscreenElement === this.element ? "Leave full screen" : "Full screen"),
    );
    return h("div", { class: "views", role: "group", "aria-label": "Views" }, VIEWS.map(view), full);
  }

  async #load() {
    try {
      await this.viewer?.load(this.source.open, Math.min(MOST, this.source.limit ?? MOST));
      this.#arrived();
    } catch (error) {
      this.#failed(error);
    }
  }

  /** @param {unknown} error */
  #failed(error) {
    const again = h(
      "button",
      {
        type: "button",
        onclick: () => {
          text(this.said, "Loading the grains");
          this.#load();
        },
      },
      "Load again",
    );
    replace(this.said, `${/** @type {Error} */ (error).message} `, this.viewer ? again : null);
    this.said.setAttribute("role", "alert");
    again.style.setProperty("pointer-events", "auto");
  }

  /** Grains arrived. */
  #arrived() {
    const { viewer } = this;
    if (!viewer?.head) return;
    if (!this.made) this.#controls();
    const { head, arrived, total } = viewer;
    const of =
      total < head.count ? `the ${number(total)} largest of ${number(head.count)} grains` : `${number(total)} grains`;
    text(this.said, arrived < total ? `${number(arrived)} of ${of}` : total < head.count ? `Drawn: ${of}` : "");
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.#follow(), 100);
  }

  /** Makes the controls; the head of the view has the specimen's size and the grains'. */
  #controls() {
    const viewer = /** @type {Viewer} */ (this.viewer);
    const head = /** @type {import("./viewer/read.js").Head} */ (viewer.head);
    const { size, dmin, dmax } = head;
    this.made = true;
    // As `--picture` shows it: the matrix, without the octant next to the eye.
    viewer.initial = { cut: size.map((length) => length / 2), octant: true, matrix: head.specimen < 2 };
    viewer.set(viewer.initial);
    this.cuts = new Cuts(viewer, head);
    this.matrix = h("input", {
      id: "show-matrix",
      type: "checkbox",
      onchange: () => viewer.set({ matrix: this.matrix?.checked }),
    });
    const scale = Math.log(dmax / dmin) || 1;
    this.sizes = ["from", "to"].map((label, i) =>
      slider(`size-${label}`, label, 100, (at) => {
        const d = at >= 100 ? 1e9 : at <= 0 ? 0 : dmin * Math.exp((scale * at) / 100);
        viewer.set({
          show: viewer.show.map((old, k) => (k === i ? d : i === 0 ? Math.max(old, d) : Math.min(old, d))),
        });
      }),
    );
    /** @type {[string, string][]} */
    const kinds = [
      ["size", "size"],
      ["class", "size class"],
    ];
    if (this.aggregates.length > 1 && viewer.head?.stride === 24) kinds.push(["aggregate", "aggregate"]);
    const colour = radios("colour", "Colour of the grains", kinds, viewer.colour, (value) =>
      viewer.set({ colour: value }),
    );
    const back = h("button", { type: "button", onclick: () => viewer.reset() }, "Reset view");
    replace(
      this.tools,
      head.specimen < 2 && h("label", { class: "check" }, this.matrix, "Matrix and faces of the specimen"),
      this.cuts.element,
      h(
        "fieldset",
        {},
        h("legend", {}, this.spheres ? "Diameters shown" : "Enclosing spheres shown"),
        this.sizes.map((c) => c.row),
      ),
      h("div", {}, h("p", { class: "label" }, "Colour by"), colour),
      h("div", { class: "actions" }, back),
      h(
        "details",
        {},
        h("summary", { id: "picture" }, "Picture as PNG"),
        picturePart(viewer, `packing-${this.source.name}`),
      ),
    );
    this.#follow();
  }

  /** Shows the state of the viewer in the controls, the legend and in words. */
  #follow() {
    const { viewer, cuts, sizes } = this;
    if (!viewer?.head || !cuts || !sizes) return;
    const { dmin, dmax, count } = viewer.head;
    const scale = Math.log(dmax / dmin) || 1;
    const cutWords = cuts.follow();
    if (this.matrix) this.matrix.checked = viewer.matrix;
    this.overlay?.draw();
    sizes.forEach(({ input, output }, i) => {
      const d = Math.min(dmax, Math.max(dmin, viewer.show[i] ?? 0));
      const at = (viewer.show[i] ?? 0) > dmax ? 100 : (100 * Math.log(d / dmin)) / scale;
      if (Math.abs(Number(input.value) - at) > 0.01) input.value = String(at);
      text(output, mm(d));
      input.setAttribute("aria-valuetext", output.textContent ?? "");
    });
    if (viewer.colour !== this.legendOf) {
      this.legendOf = viewer.colour;
      replace(
        this.legend,
        legend(this.summary, viewer.colour, viewer.head, this.spheres ? "diameter" : "enclosing sphere"),
      );
      for (const cell of this.shown.querySelectorAll(".swatch"))
        cell.toggleAttribute("hidden", viewer.colour !== "class");
    }
    const [from, end] = viewer.range();
    const degrees = (/** @type {number} */ a) => `${Math.round((a * 180) / Math.PI)}°`;
    text(
      this.words,
      `${end - from === count ? `All ${number(count)}` : `${number(end - from)} of ${number(count)}`} grains` +
        ` of ${mm(Math.max(dmin, viewer.show[0] ?? 0))} to ${mm(Math.min(dmax, viewer.show[1] ?? 0))}` +
        `${this.spheres ? "" : " (enclosing spheres)"}${viewer.matrix ? " in the matrix" : ""}, ${cutWords}` +
        `, seen from ${degrees(((viewer.pose.az % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI))} about z` +
        ` and ${degrees(viewer.pose.el)} above, magnified ${number(viewer.pose.zoom, 2)} times.`,
    );
    this.canvas.setAttribute("aria-label", `The packing in three dimensions, ${number(end - from)} grains`);
  }
}
