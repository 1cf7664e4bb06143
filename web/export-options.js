/** The options of exports as fields of a form: their names, units and defaults (docs/models.md). */
import { h, text } from "./dom.js";
import { faultOf, numberOf, parse } from "./numbers.js";

/**
 * @typedef {{label: string, unit?: string, value?: number, choices?: string[], flag?: boolean, json?: boolean,
 *   hint?: string}} Option
 *   `value` is the server's default; `flag`: true or false; `json`: an object. The server knows the bounds.
 * @type {Record<string, Option>}
 */
const OPTIONS = {
  segments: { label: "Segments of a circumference", hint: "16 where no edge length is given, 20 of a cut" },
  size_mm: { label: "Edge length", unit: "mm", hint: "in place of segments" },
  min_size_mm: { label: "Shortest edge", unit: "mm" },
  max_size_mm: { label: "Longest edge", unit: "mm" },
  size_field: { label: "Finer where grains are close", flag: true, value: 1 },
  max_segments: { label: "Most segments where grains are close" },
  volume_correction: { label: "Volume of the polyhedra", choices: ["scaled", "none"] },
  faces: { label: "Faces of polyhedra", choices: ["simplified", "exact"], hint: "exact keeps narrow faces" },
  elements: {
    label: "Elements",
    choices: ["", "tetrahedra", "triangles"],
    hint: "tetrahedra, and triangles of a cut, are made by Gmsh",
  },
  order: { label: "Order of the elements", value: 1, hint: "2 has mid nodes" },
  plane: { label: "Across a cut: no", choices: ["stress", "strain"] },
  tet_size_mm: { label: "Longest edge on a grain", unit: "mm" },
  tet_size_matrix_mm: { label: "Longest edge away from grains", unit: "mm" },
  target_elements: { label: "Tetrahedra to aim at", hint: "in place of segments and lengths" },
  tet_growth: { label: "Growth of edges away from grains", hint: "1.05 to 1.5" },
  max_bytes: { label: "Longest file", unit: "bytes", value: 500000000 },
  cells: { label: "Voxels along the longest edge", hint: "100 where no edge is given, 128 for properties" },
  voxel_mm: { label: "Edge of a voxel", unit: "mm", hint: "in place of a number" },
  materials: {
    label: "Materials",
    json: true,
    hint: 'those of the request when empty; JSON, as {"matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2}}',
  },
  label: { label: "Labels", choices: ["phase", "grain", "aggregate"] },
  fractions: { label: "With shares of aggregate", flag: true, value: 0 },
  samples: { label: "Lines per edge of a voxel", value: 4 },
  kinds: {
    label: "Properties",
    choices: ["", "stiffness", "conductivity", "expansion", "stiffness,conductivity", "stiffness,expansion"],
    hint: "what the materials allow when empty",
  },
  scheme: { label: "Scheme", choices: ["rotated", "hexahedra"] },
  cut_voxels: { label: "Voxels that a surface cuts", choices: ["", "mixed", "labels"], hint: "labels with hexahedra" },
  tolerance: { label: "Error of the solver", value: 0.0001 },
  walls: { label: "A box with walls", choices: ["periodic", "mirrored"] },
  fields: { label: "Fields of all load cases", flag: true, value: 0, hint: "strain and stress of each voxel" },
  solver: { label: "Solver", choices: ["calculix", "abaqus"] },
  load: {
    label: "Load",
    choices: ["uniaxial_z", "uniaxial_x", "uniaxial_y", "shear_xy", "shear_xz", "shear_yz", "temperature"],
  },
  strain: { label: "Strain or shear angle", hint: "1e-4 when empty; none for temperature" },
  temperature_change_k: { label: "Rise of the temperature", unit: "K", hint: "for temperature; 1 when empty" },
  axis: { label: "Axis", choices: ["z", "x", "y"] },
  at_mm: { label: "Position", unit: "mm", hint: "the middle when empty" },
  pixels: { label: "Pixels along the longer edge", hint: "for png; 1000 when empty" },
  spacing: { label: "Spacing of boundary nodes", unit: "d_min", value: 1.5 },
  fictitious_diameter: { label: "Diameter of boundary nodes", unit: "d_min", value: 1.1 },
  boundary_nodes: { label: "Boundary nodes", choices: ["poisson_disk", "random"] },
  seed: { label: "Seed of the boundary nodes", value: 0 },
  surface_radius: { label: "Radius of boundary nodes", unit: "d_min", hint: "half the diameter when empty" },
  closer_than_mm: {
    label: "Pairs and walls closer than",
    unit: "mm",
    hint: "a tenth of the smallest diameter beyond its gap when empty",
  },
};

/**
 * A document that was typed; what is none is sent as its text, for the server to refuse.
 * @param {string} words
 * @returns {{value: any, fault: string}}
 */
function documentOf(words) {
  if (!words.trim()) return { value: undefined, fault: "" };
  try {
    return { value: parse(words), fault: "" };
  } catch (error) {
    return { value: words, fault: /** @type {Error} */ (error).message };
  }
}

/**
 * Fields for some options.
 * @param {string[]} names
 * @param {() => void} changed
 * @returns {{elements: HTMLElement[], values: () => Record<string, any>,
 *   mark: (faults: {name: string, detail: string}[]) => string[]}} `values` has those that differ from the server's
 *   defaults; `mark` shows faults at their fields, and gives back those of no field
 */
export function fields(names, changed) {
  /** @type {[string, Option, HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement][]} */
  const all = [];
  /** @type {(name: string) => HTMLElement[]} */
  const make = (name) => {
    const option = OPTIONS[name] ?? { label: name.replaceAll("_", " ") };
    const id = `option-${name}`;
    const { choices, flag, json, unit, hint } = option;
    const described = `${hint ? `${id}-hint ` : ""}${id}-fault`;
    const field = choices
      ? h(
          "select",
          { id },
          choices.map((c) => h("option", { value: c }, c.replaceAll("_", " "))),
        )
      : flag
        ? h("input", { id, type: "checkbox", checked: option.value === 1 })
        : json
          ? h("textarea", { id, rows: 3, spellcheck: "false", "aria-describedby": described })
          : h("input", {
              id,
              inputmode: "decimal",
              placeholder: option.value ?? "",
              "aria-describedby": described,
            });
    field.addEventListener("input", changed);
    all.push([name, option, field]);
    if (flag) return [h("label", { class: "check" }, field, option.label)];
    return [
      h(
        "div",
        { class: "field" },
        h("label", { for: id }, option.label),
        unit ? h("div", { class: "with-unit" }, field, h("span", { class: "unit" }, unit)) : field,
        hint ? h("p", { class: "hint", id: `${id}-hint` }, hint) : null,
        h("p", { class: "fault", id: `${id}-fault` }),
      ),
    ];
  };
  const elements = names.flatMap(make);
  const values = () => {
    /** @type {Record<string, any>} */
    const out = {};
    for (const [name, option, field] of all) {
      if (option.flag) {
        const { checked } = /** @type {HTMLInputElement} */ (field);
        if (checked !== (option.value === 1)) out[name] = checked;
      } else if (option.choices) {
        if (field.value !== option.choices[0]) out[name] = field.value;
      } else if (field.value.trim() === "") continue;
      else out[name] = option.json ? documentOf(field.value).value : numberOf(field.value, option.unit);
    }
    return out;
  };
  const mark = (/** @type {{name: string, detail: string}[]} */ faults) => {
    const others = faults.filter(({ name }) => !all.some(([known, { flag }]) => known === name && !flag));
    for (const [name, option, field] of all.filter(([, { flag }]) => !flag)) {
      const own = option.choices ? "" : option.json ? documentOf(field.value).fault : faultOf(field.value);
      const words = own || faults.find((fault) => fault.name === name)?.detail;
      const place = field.closest(".field")?.querySelector(".fault");
      if (place) text(place, words ?? "");
      if (words) field.setAttribute("aria-invalid", "true");
      else field.removeAttribute("aria-invalid");
    }
    return others.map(({ detail }) => detail);
  };
  return { elements, values, mark };
}
