/** The figures of the aggregate of a plan that laboratories compute by hand. */
import { h, number, percent, quantity } from "./dom.js";

/** @param {any} figures as a plan has them */
export function figuresOf(figures) {
  const { packing_model: model, paste } = figures;
  const row = (/** @type {string} */ what, /** @type {string} */ figure) =>
    h("tr", {}, h("th", { scope: "row" }, what), h("td", { class: "number" }, figure));
  return h(
    "div",
    {},
    h(
      "table",
      {},
      h(
        "tbody",
        {},
        row("Fineness modulus, ASTM C125", number(figures.fineness_modulus, 3)),
        row("k-value, DIN 1045-2", number(figures.k_value, 3)),
        row("Specific surface, as spheres", `${number(figures.specific_surface_m2_m3, 4)}\u202fm²/m³`),
        figures.fines > 0 && row("Finer than 0.063\u202fmm", percent(figures.fines, 1)),
        row("Packing density, all aggregate", number(figures.packing_density, 3)),
        figures.packing_density_placed !== undefined &&
          row("Packing density, grains placed", number(figures.packing_density_placed, 3)),
        paste && row("Paste", `${percent(paste.volume_fraction, 1)} of the volume`),
        paste && row("Paste film on the grains", quantity(paste.film_thickness_mm, "mm")),
        paste && row("Paste between the largest grains", quantity(paste.maximum_thickness_mm, "mm")),
      ),
    ),
    h(
      "p",
      { class: "hint" },
      `Packing densities are those of compacted aggregate by de Larrard's model, compaction index ` +
        `${number(model.compaction_index)}, residual packing density ${number(model.residual_packing_density)}; ` +
        "`mix.packing_model` of the request sets others.",
    ),
  );
}
