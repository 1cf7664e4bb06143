/** Plane cross-sections of a packing, with a slider that moves the cut of the picture, too. */
import { absolute } from "./address.js";
import { h, quantity, replace, text } from "./dom.js";
import { numberOf } from "./numbers.js";

const MANY = 300_000;

/**
 * The lengths of the box around a specimen, mm.
 * @param {any} specimen of a request
 * @returns {number[]}
 */
export const sizeOfSpecimen = (specimen) =>
  specimen.type === "box" ? specimen.size_mm : [specimen.diameter_mm, specimen.diameter_mm, specimen.height_mm];

/** The step of a slider along an edge: 0.1 mm, or 0.1 % of what is shorter than 20 mm. @param {number} edge */
export const stepOf = (edge) => (edge >= 20 ? 0.1 : Number((edge / 1000).toPrecision(2)));

/**
 * @param {any} job
 * @param {any} request
 * @param {any} report
 * @param {import("./viewer/viewer.js").Viewer} [viewer] whose cut is moved with the slider, and moves it
 */
export function slicePart(job, request, report, viewer) {
  const size = sizeOfSpecimen(request.specimen);
  const format = report.summary.grains > MANY ? "png" : "svg";
  let axis = 2;
  const input = h("input", { id: "slice-at", type: "range", min: 0 });
  const typed = h("input", { id: "slice-mm", inputmode: "decimal", "aria-label": "Position in mm" });
  const linked = h("input", { type: "checkbox", checked: true });
  const turn = (/** @type {number} */ to) => {
    axis = to;
    const edge = size[axis] ?? 1;
    input.max = String(edge);
    input.step = String(stepOf(edge));
    input.value = String(edge / 2);
  };
  turn(axis);
  const image = h("img", { alt: "", width: 800, height: 858 });
  const fault = h("p", { class: "fault", role: "alert" });
  const links = h("div", { class: "links" });
  const address = (/** @type {string} */ kind) => {
    const at = Number(Number(input.value).toPrecision(6));
    return absolute(`${job.links.exports}/slice?format=${kind}&axis=${"xyz"[axis]}&at_mm=${at}`);
  };
  let busy = false;
  const show = () => {
    const at = quantity(Number(input.value), "mm");
    if (document.activeElement !== typed) typed.value = String(Number(Number(input.value).toFixed(4)));
    input.setAttribute("aria-valuetext", at);
    if (busy) return; // the picture that is on its way comes first
    const wanted = address(format);
    if (image.getAttribute("src") === wanted) return;
    busy = true;
    image.dataset.busy = "";
    image.src = wanted;
    image.alt = `Cross-section at ${"xyz"[axis]} = ${at}${report.summary.partial ? ", of a partial packing" : ""}`;
    replace(
      links,
      ["svg", "png", "json", "geo"].map((kind) =>
        h("a", { class: "button", href: address(kind), download: "" }, kind.toUpperCase()),
      ),
    );
  };
  const done = () => {
    busy = false;
    delete image.dataset.busy;
    show();
  };
  image.addEventListener("load", () => {
    text(fault, "");
    done();
  });
  image.addEventListener("error", () => {
    text(fault, "The server did not send this slice.");
    busy = false;
  });
  const move = () => {
    show();
    if (!viewer?.head || !linked.checked) return;
    const cut = size.map((_, i) => (i === axis ? Number(input.value) : 1e9));
    viewer.set({ cut, octant: false });
  };
  input.addEventListener("input", move);
  typed.addEventListener("input", () => {
    const at = numberOf(typed.value, "mm");
    if (typeof at !== "number") return;
    input.value = String(at);
    move();
  });
  // One cut across an axis in the picture moves the slice.
  viewer?.addEventListener("change", () => {
    if (!linked.checked || !linked.isConnected || viewer.octant) return;
    const cuts = size.map((edge, i) => ((viewer.cut[i] ?? 1e9) < edge ? i : -1)).filter((i) => i >= 0);
    const [one] = cuts;
    if (one === undefined || cuts.length !== 1) return;
    const at = viewer.cut[one] ?? 0;
    if (one === axis && Math.abs(at - Number(input.value)) <= stepOf(size[axis] ?? 1)) return;
    if (one !== axis) turn(one);
    for (const radio of /** @type {NodeListOf<HTMLInputElement>} */ (choices.querySelectorAll("input")))
      radio.checked = radio.value === "xyz"[axis];
    input.value = String(at);
    show();
  });
  const choices = h(
    "span",
    { class: "choices", role: "radiogroup", "aria-label": "Axis of the cut" },
    ["x", "y", "z"].map((name, i) =>
      h(
        "label",
        {},
        h("input", {
          type: "radio",
          name: "slice-axis",
          value: name,
          checked: i === axis,
          onchange: () => {
            turn(i);
            move();
          },
        }),
        name,
      ),
    ),
  );
  show();
  return h(
    "section",
    { class: "panel slice stack", "aria-labelledby": "slice-title" },
    h("h2", { id: "slice-title", class: "visually-hidden" }, "Cross-section"),
    h(
      "div",
      { class: "row" },
      h("div", { class: "field" }, h("span", { class: "label" }, "Across"), choices),
      h("div", { class: "field", style: { flex: "3 1 12rem" } }, h("label", { for: "slice-at" }, "Position"), input),
      h(
        "div",
        { class: "field" },
        h("span", { class: "label", "aria-hidden": "true" }, "Position"),
        h("div", { class: "with-unit" }, typed, h("span", { class: "unit" }, "mm")),
      ),
    ),
    viewer && h("label", { class: "check" }, linked, "Cut the picture above at the same place"),
    image,
    fault,
    links,
  );
}
