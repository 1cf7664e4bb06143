/** Packings side by side: pictures with linked cameras and cuts, and slices at linked places. */
import { absolute } from "./address.js";
import { request as ask } from "./api.js";
import { mark } from "./compare-parts.js";
import { h, quantity, replace, text } from "./dom.js";
import { sizeOfSpecimen, stepOf } from "./job-slices.js";
import { Cuts, radios, VIEWS } from "./view-controls.js";
import { Viewer } from "./viewer/viewer.js";

const FAR = 1e9;
/** Most grains of a picture. */
const MOST = 1_000_000;

/** @typedef {import("./compare-parts.js").Packing} Packing */

/**
 * Pictures whose cameras and cuts are one.
 * @param {Packing[]} packings
 */
export function viewPart(packings) {
  const linked = h("input", { type: "checkbox", checked: true, onchange: () => follow(viewers[0]) });
  const controls = h("div", { class: "tools" });
  const words = h("p", { id: "views-words", class: "hint" });
  /** @type {Viewer[]} */
  const viewers = [];
  /** @type {Cuts | undefined} */
  let cuts;
  let busy = false;

  /** Brings the others to the state of one: places of cuts are shares of the edges. @param {Viewer | undefined} from */
  function follow(from) {
    if (busy || !from?.head) return;
    const { size } = from.head;
    busy = true;
    for (const viewer of linked.checked ? viewers : []) {
      if (viewer === from || !viewer.head) continue;
      const to = viewer.head.size;
      const cut = from.cut.map((at, i) => {
        const edge = size[i] ?? 1;
        return at < edge ? (at / edge) * (to[i] ?? 1) : FAR;
      });
      // The plane keeps its direction and its distance from the middle as a share of the diagonal.
      const middle = (/** @type {number[]} */ n, /** @type {number[]} */ of) =>
        n.reduce((sum, x, i) => sum + (x * (of[i] ?? 0)) / 2, 0);
      const normal = from.plane?.slice(0, 3);
      const share = Math.hypot(...to) / Math.hypot(...size);
      const plane = normal
        ? [...normal, middle(normal, to) + ((from.plane?.[3] ?? 0) - middle(normal, size)) * share]
        : null;
      viewer.set({ pose: from.pose, cut, plane, octant: from.octant, matrix: from.matrix, colour: from.colour });
    }
    busy = false;
    if (cuts) text(words, `All pictures: ${cuts.follow()}.`);
  }

  const start = async () => {
    await Promise.all(
      viewers.map(async (viewer, i) => {
        const { links } = packings[i]?.job ?? {};
        await viewer.load(async () => {
          const answer = await ask("GET", `${links.result}?format=view`);
          return /** @type {ReadableStream<Uint8Array>} */ (answer.body);
        }, MOST);
      }),
    );
    const [first] = viewers;
    if (!first?.head) return;
    cuts = new Cuts(first, first.head);
    const matrix = h("input", {
      id: "show-matrix",
      type: "checkbox",
      checked: true,
      onchange: () => first.set({ matrix: matrix.checked }),
    });
    replace(
      controls,
      h(
        "div",
        { class: "stack" },
        h("label", { class: "check" }, linked, "Cameras and cuts are linked"),
        h("label", { class: "check" }, matrix, "Matrix and faces of the specimens"),
        h(
          "div",
          { class: "actions", role: "group", "aria-label": "Views" },
          VIEWS.map(([name, label, az, el]) =>
            h(
              "button",
              {
                type: "button",
                "aria-label": label,
                title: label,
                onclick: () => first.set({ pose: { az, el, zoom: 1, pan: [0, 0] } }),
              },
              name,
            ),
          ),
        ),
      ),
      cuts.element,
    );
    first.set({ cut: first.head.size.map((length) => length / 2), octant: true, matrix: true });
  };

  const stages = packings.map(({ letter, title, request, report }, i) => {
    const canvas = h("canvas", {
      tabindex: "0",
      role: "img",
      "aria-label": `${letter}: the packing in three dimensions`,
      "aria-describedby": "views-words",
    });
    const viewer = new Viewer(canvas);
    viewer.periodic = request?.specimen?.boundary === "periodic";
    viewer.classes = report.summary.classes.map((/** @type {any} */ c) => c.d_min_mm);
    viewer.addEventListener("change", () => follow(viewer));
    viewer.addEventListener("rest", () => {
      canvas.dataset.drawn = String(viewer.arrived);
    });
    viewers.push(viewer);
    return h("figure", { class: "side" }, h("figcaption", {}, mark(i, letter), " ", h("bdi", {}, title)), canvas);
  });
  const element = h(
    "section",
    { class: "panel stack", "aria-labelledby": "views-title" },
    h("h2", { id: "views-title" }, "Packings"),
    h("div", { class: "sides" }, stages),
    controls,
    words,
  );
  return { element, start };
}

/**
 * Slices at the same share of each edge.
 * @param {Packing[]} packings
 */
export function slicePart(packings) {
  let axis = 2;
  const sizes = packings.map(({ request }) => sizeOfSpecimen(request.specimen));
  const input = h("input", {
    id: "slices-at",
    type: "range",
    min: 0,
    max: 1,
    step: "any",
    value: 0.5,
    oninput: () => show(),
  });
  const output = h("output", { for: "slices-at" });
  const images = packings.map(({ letter, title }, i) => {
    const image = h("img", { alt: "", width: 400, height: 429 });
    const place = h("span", {});
    const figure = h(
      "figure",
      { class: "side" },
      h("figcaption", {}, mark(i, letter), " ", h("bdi", {}, title), " ", place),
      image,
    );
    return { image, place, figure, letter };
  });
  let timer = 0;
  function show() {
    const first = sizes[0]?.[axis] ?? 1;
    input.step = String(stepOf(first) / first);
    const share = Number(input.value);
    text(output, quantity(Number((share * first).toFixed(3)), "mm"));
    input.setAttribute("aria-valuetext", output.textContent ?? "");
    clearTimeout(timer);
    timer = setTimeout(() => {
      images.forEach(({ image, place, letter }, i) => {
        const at = Number((share * (sizes[i]?.[axis] ?? 1)).toPrecision(6));
        const name = "xyz"[axis];
        image.src = absolute(`${packings[i]?.job.links.exports}/slice?format=svg&axis=${name}&at_mm=${at}`);
        image.alt = `${letter}: cross-section at ${name} = ${quantity(at, "mm")}`;
        text(place, `${name} = ${quantity(at, "mm")}`);
      });
    }, 80);
  }
  const choices = radios(
    "slices-axis",
    "Axis of the cut",
    ["x", "y", "z"].map((name) => /** @type {[string, string]} */ ([name, name])),
    "z",
    (name) => {
      axis = "xyz".indexOf(name);
      show();
    },
  );
  show();
  return h(
    "section",
    { class: "panel slice stack", "aria-labelledby": "slices-title" },
    h("h2", { id: "slices-title" }, "Cross-sections"),
    h(
      "div",
      { class: "row" },
      h("div", { class: "field" }, h("span", { class: "label" }, "Across"), choices),
      h(
        "div",
        { class: "field", style: { flex: "3 1 12rem" } },
        h("label", { for: "slices-at" }, "Position ", output),
        input,
      ),
    ),
    h(
      "div",
      { class: "sides" },
      images.map(({ figure }) => figure),
    ),
  );
}
