/** The controls of the viewer: what is shown, where it is cut, and from where it is seen. */
import { h, quantity, text } from "./dom.js";

const AXES = ["x", "y", "z"];
const FAR = 1e9;

/** Two decimals below 10 mm, one above. @param {number} value */
export const mm = (value) => quantity(Number(value.toFixed(value < 10 ? 2 : 1)), "mm");

/** The views along the axes, from the corner and from the first place: names, words and angles in rad. */
export const VIEWS = /** @type {[string, string, number, number][]} */ ([
  ["X", "Look along x", 0, 0],
  ["Y", "Look along y", -Math.PI / 2, 0],
  ["Z", "Look along z", -Math.PI / 2, Math.PI / 2],
  ["Corner", "Look at the corner", Math.PI / 4, Math.atan(Math.SQRT1_2)],
]);

/**
 * @param {string} id
 * @param {string} label
 * @param {number} max
 * @param {(at: number) => void} set
 * @param {number} [min]
 */
export function slider(id, label, max, set, min = 0) {
  const input = h("input", { id, type: "range", min, max, step: "any", value: max });
  const output = h("output", { for: id });
  input.addEventListener("input", () => set(Number(input.value)));
  input.addEventListener("keydown", (event) => {
    // one of 100 steps a key
    const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
    if (!step) return;
    event.preventDefault();
    input.value = String(Number(input.value) + (step * (max - min)) / 100);
    set(Number(input.value));
  });
  return { row: h("div", { class: "slider" }, h("label", { for: id }, label), input, output), input, output };
}

/**
 * One of a few.
 * @param {string} name
 * @param {string} label
 * @param {[string, string][]} list values and words
 * @param {string} value
 * @param {(value: string) => void} set
 */
export const radios = (name, label, list, value, set) =>
  h(
    "span",
    { class: "choices", role: "radiogroup", "aria-label": label },
    list.map(([one, words]) =>
      h(
        "label",
        {},
        h("input", { type: "radio", name, value: one, checked: one === value, onchange: () => set(one) }),
        words,
      ),
    ),
  );

/** Where the packing is cut: an octant, planes across the axes, or an oblique plane. */
export class Cuts {
  /**
   * @param {import("./viewer/viewer.js").Viewer} viewer
   * @param {import("./viewer/read.js").Head} head
   */
  constructor(viewer, head) {
    this.viewer = viewer;
    this.size = head.size;
    this.sliders = head.size.map((length, i) =>
      slider(`cut-${AXES[i]}`, AXES[i] ?? "", length, (at) => {
        const cut = viewer.cut.map((c, k) => (k === i ? (at >= length ? FAR : at) : c));
        viewer.set({ cut });
      }),
    );
    this.kind = radios(
      "cut-kind",
      "What is removed",
      [
        ["octant", "octant"],
        ["planes", "slabs"],
        ["none", "nothing"],
      ],
      "",
      (kind) => this.#choose(kind),
    );
    // The normal of the oblique plane by its angles, in degrees, and its distance from the middle.
    const reach = Math.hypot(...head.size) / 2;
    this.oblique = [
      slider("plane-az", "about z", 180, () => this.#plane(), -180),
      slider("plane-el", "above", 90, () => this.#plane(), -90),
      slider("plane-at", "from middle", reach, () => this.#plane(), -reach),
    ];
    [45, 20, 0].forEach((value, i) => {
      const one = this.oblique[i];
      if (one) one.input.value = String(value);
    });
    this.isOblique = h("input", { type: "checkbox", id: "plane-on", onchange: () => this.#plane() });
    this.element = h(
      "fieldset",
      {},
      h("legend", {}, "Removed"),
      this.kind,
      this.sliders.map(({ row }) => row),
      h(
        "details",
        {},
        h("summary", {}, "Oblique plane"),
        h("label", { class: "check" }, this.isOblique, "Cut along it"),
        this.oblique.map(({ row }) => row),
      ),
    );
  }

  /** @param {string} kind */
  #choose(kind) {
    const middle = this.size.map((length) => length / 2);
    const isCut = this.viewer.cut.some((at, i) => at < (this.size[i] ?? 0));
    if (kind === "octant") this.viewer.set({ octant: true, cut: middle });
    else if (kind === "planes")
      this.viewer.set({ octant: false, cut: isCut ? this.viewer.cut : [middle[0], FAR, FAR] });
    else this.viewer.set({ octant: false, cut: [FAR, FAR, FAR] });
  }

  #plane() {
    const [az = 0, el = 0, from = 0] = this.oblique.map(({ input }) => Number(input.value));
    const [a, e] = [az, el].map((angle) => (angle * Math.PI) / 180);
    const n = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const middle = n.reduce((sum, x, i) => sum + (x * (this.size[i] ?? 0)) / 2, 0);
    this.viewer.set({ plane: this.isOblique.checked ? [...n, middle + from] : null });
  }

  /** Shows the state of the viewer; gives it in words. */
  follow() {
    const { viewer, size } = this;
    this.sliders.forEach(({ input, output }, i) => {
      const [at, length] = [viewer.cut[i] ?? FAR, size[i] ?? 1];
      input.value = String(Math.min(at, length));
      text(output, at >= length ? "no cut" : mm(at));
      input.setAttribute("aria-valuetext", output.textContent ?? "");
    });
    this.oblique.forEach(({ input, output }, i) => {
      text(output, i < 2 ? `${Math.round(Number(input.value))}°` : mm(Number(input.value)));
      input.setAttribute("aria-valuetext", output.textContent ?? "");
    });
    if (!viewer.plane) this.isOblique.checked = false;
    const cut = viewer.cut.map((at, i) => at < (size[i] ?? 0));
    const kind =
      viewer.octant && cut.every(Boolean) ? "octant" : cut.some(Boolean) && !viewer.octant ? "planes" : "none";
    const radio = /** @type {HTMLInputElement} */ (this.kind.querySelector(`[value=${kind}]`));
    radio.checked = true;
    const places = viewer.cut.map((at, i) => `${AXES[i]} ${kind === "octant" ? "above" : "below"} ${mm(at)}`);
    const words =
      kind === "octant"
        ? `without the octant of ${places.join(", ")}`
        : kind === "planes"
          ? `cut: ${places.filter((_, i) => cut[i]).join(", ")} is shown`
          : "not cut";
    return viewer.plane ? `${words}, cut along an oblique plane` : words;
  }
}
