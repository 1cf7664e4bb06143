/**
 * The materials of a request: a table of the matrix and of all aggregates, with the properties that most exports need.
 * Its fields are read as those of the page (`form-fields.js`); other phases and properties of a request stay as they
 * are.
 */
import { h } from "./dom.js";

/** @type {[string, string, string][]} Member, name, unit. */
const PROPERTIES = [
  ["youngs_modulus_gpa", "Young's modulus", "GPa"],
  ["poissons_ratio", "Poisson's ratio", ""],
  ["density_kg_m3", "Density", "kg/m\u00b3"],
  ["conductivity_w_m_k", "Conductivity", "W/(m K)"],
  ["expansion_1_k", "Expansion", "1/K"],
];
/** @type {[string, string][]} Phase, name. */
const PHASES = [
  ["matrix", "Matrix"],
  ["aggregate", "Aggregate"],
];

/** @param {string} name @param {string} unit */
const withUnit = (name, unit) => (unit ? `${name}, ${unit}` : name);

/** The table with its fields. */
export function materialFields() {
  const field = (
    /** @type {string} */ phase,
    /** @type {string} */ row,
    /** @type {[string, string, string]} */ of,
  ) => {
    const [member, name, unit] = of;
    const input = h("input", {
      id: `${phase}-${member}`,
      inputmode: "decimal",
      "aria-label": `${row}: ${withUnit(name, unit)}`,
      "data-path": `/materials/${phase}/${member}`,
      "data-kind": "number",
      "data-optional": "",
    });
    return h("td", {}, h("div", { class: "field" }, input));
  };
  return h(
    "div",
    { class: "table", tabindex: "0", role: "region", "aria-label": "Materials of the phases" },
    h(
      "table",
      { class: "inputs" },
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          h("th", { scope: "col" }, "Phase"),
          PROPERTIES.map(([member, name, unit]) =>
            h(
              "th",
              { scope: "col", "data-help": `/materials/${member}` },
              h("span", { class: "label" }, withUnit(name, unit)),
            ),
          ),
        ),
      ),
      h(
        "tbody",
        {},
        PHASES.map(([phase, row]) =>
          h(
            "tr",
            {},
            h("th", { scope: "row" }, row),
            PROPERTIES.map((of) => field(phase, row, of)),
          ),
        ),
      ),
    ),
  );
}
