/** The fields of the aggregates of a mix that has several: name, share, cut-off and sieves of each, the rest in words. */
import { h, number } from "./dom.js";

/** What the form says of the variants of a grading and of a shape. @type {Record<string, (of: any) => string>} */
const WORDS = {
  standard: (of) => `Standard curve ${of.name}`,
  fuller: (of) => `Fuller curve up to ${number(of.d_max_mm)} mm`,
  monodisperse: (of) => `One size, ${number(of.diameter_mm)} mm`,
  classes: () => "Size classes",
  sphere: () => "Spheres",
  ellipsoid: () => "Ellipsoids",
  polyhedron: () => "Angular grains",
  preset: (of) => `Shape ${of.name}`,
  mixture: () => "Mixture of shapes",
};

/** @param {any} of an object with a member `type` */
const words = (of) => WORDS[of?.type]?.(of) ?? "";

/**
 * @param {any} aggregates as in a request
 * @returns {HTMLElement[]} for each its fields; `Fields` reads them by their pointers
 */
export function aggregateFields(aggregates) {
  if (!Array.isArray(aggregates)) return [];
  return aggregates.map((aggregate, i) => {
    /**
     * @param {string} member
     * @param {string} label
     * @param {object} attributes
     * @param {string} [unit]
     */
    const field = (member, label, attributes, unit) => {
      const id = `aggregate-${i}-${member}`;
      const input = h("input", { id, "data-path": `/mix/aggregates/${i}/${member}`, ...attributes });
      return h(
        "div",
        { class: "field" },
        h("label", { for: id }, label),
        unit ? h("span", { class: "with-unit" }, input, h("span", { class: "unit" }, unit)) : input,
      );
    };
    const numeric = { inputmode: "decimal", "data-kind": "number" };
    const rows = aggregate?.grading?.points;
    const id = `aggregate-${i}-points`;
    const shapes = aggregate?.shapes?.length ? "Shapes by size" : words(aggregate?.shape ?? { type: "sphere" });
    return h(
      "fieldset",
      { class: "aggregate stack" },
      h("legend", {}, `Aggregate ${i + 1}`),
      h(
        "div",
        { class: "row" },
        field("name", "Name", { type: "text", dir: "auto", maxlength: 64, "data-kind": "text", "data-optional": "" }),
        field("share", "Share of the volume", numeric),
        field("d_min_mm", "Cut-off", { ...numeric, "data-optional": "", placeholder: "of the mix" }, "mm"),
      ),
      Array.isArray(rows)
        ? h(
            "div",
            { class: "field" },
            h("label", { for: id }, "Sieves, mm, and mass passing, %"),
            h("textarea", {
              id,
              rows: rows.length + 1,
              spellcheck: "false",
              "data-path": `/mix/aggregates/${i}/grading/points`,
              "data-kind": "sieves",
            }),
          )
        : null,
      h(
        "p",
        { class: "hint" },
        [Array.isArray(rows) ? "" : words(aggregate?.grading), shapes].filter(Boolean).join(", "),
      ),
    );
  });
}
