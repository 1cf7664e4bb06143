/** Plane cross-sections of a packing, with a slider, and the plots that the server draws. */
import { absolute } from "./address.js";
import { h, quantity, replace, text } from "./dom.js";

const MANY = 300_000;

/**
 * @param {any} job
 * @param {any} request
 * @param {any} report
 */
export function slicePart(job, request, report) {
  const { specimen } = request;
  const size =
    specimen.type === "box" ? specimen.size_mm : [specimen.diameter_mm, specimen.diameter_mm, specimen.height_mm];
  const format = report.summary.grains > MANY ? "png" : "svg";
  let axis = 2;
  const input = h("input", { id: "slice-at", type: "range", min: 0, max: 100, step: 1, value: 50 });
  const output = h("output", { for: "slice-at" });
  const image = h("img", { alt: "", width: 800, height: 858 });
  const fault = h("p", { class: "fault", role: "alert" });
  const links = h("div", { class: "links" });
  const address = (/** @type {string} */ kind) => {
    const at = Number(((size[axis] * Number(input.value)) / 100).toPrecision(6));
    return absolute(`${job.links.exports}/slice?format=${kind}&axis=${"xyz"[axis]}&at_mm=${at}`);
  };
  let busy = false;
  const show = () => {
    const at = quantity((size[axis] * Number(input.value)) / 100, "mm");
    text(output, at);
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
  input.addEventListener("input", show);
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
            axis = i;
            show();
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
    h("h2", { id: "slice-title" }, "Cross-section"),
    h(
      "div",
      { class: "row" },
      h("div", { class: "field" }, h("span", { class: "label" }, "Across"), choices),
      h(
        "div",
        { class: "field", style: { flex: "3 1 12rem" } },
        h("label", { for: "slice-at" }, "Position ", output),
        input,
      ),
    ),
    image,
    fault,
    links,
  );
}

/** Grains times volume fraction below which too few pairs may be close for a pair correlation. */
const PAIRS = 200;

/** @type {Record<string, string>} */
const PLOTS = {
  grading: "Grading curve: mass passing, requested and packed",
  radial: "Pair correlation by class of the reference grain",
  profile: "Volume fraction against depth from the walls",
  distance: "Distance between grains against packing time",
  zingg: "Zingg's diagram: elongation against flatness",
  flakiness: "Share of flaky mass by particle size fraction",
  quality: "Quality: volumes near the walls, near pairs and bond order against chance",
};

/**
 * The plots for which the packing has data (docs/plots.md).
 * @param {any} job
 * @param {any} request
 * @param {any} report
 */
export function plotPart(job, request, report) {
  const grown = (report.growth_curve ?? []).some((/** @type {any} */ p) => typeof p.distance_mm === "number");
  /** @type {Record<string, boolean>} */
  const has = {
    grading: true,
    radial: report.summary.grains * report.summary.volume_fraction_effective > PAIRS,
    profile: request.specimen.boundary !== "periodic",
    distance: grown,
    zingg: Boolean(report.shapes),
    flakiness: Boolean(report.shapes),
    quality: report.summary.grains * report.summary.volume_fraction_effective > PAIRS,
  };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const kinds = Object.keys(PLOTS).filter((kind) => has[kind] && job.links.plots[kind]);
  return h(
    "section",
    { class: "panel", "aria-labelledby": "plots-title" },
    h("h2", { id: "plots-title" }, "Plots"),
    h(
      "div",
      { class: "plots" },
      kinds.map((kind) => {
        const image = h("img", {
          class: "plot",
          alt: PLOTS[kind],
          loading: "lazy",
          width: 640,
          height: 452,
        });
        const show = () => {
          const theme = dark.matches ? "&theme=dark" : "";
          image.src = absolute(`${job.links.plots[kind]}?title=false${theme}`);
        };
        show();
        dark.addEventListener("change", show);
        const figure = h(
          "figure",
          {},
          image,
          h(
            "figcaption",
            { class: "hint" },
            PLOTS[kind],
            " · ",
            h("a", { href: absolute(job.links.plots[kind]), download: "" }, "SVG"),
          ),
        );
        image.addEventListener("error", () =>
          replace(figure, h("p", { class: "hint" }, `${PLOTS[kind]}: not available.`)),
        );
        return figure;
      }),
    ),
  );
}
