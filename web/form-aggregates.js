/**
 * The aggregates of a mix that has several. Each has its name and share, and the fields with `data-each` of the page,
 * which are those of a mix of one aggregate.
 */
import { h } from "./dom.js";

/** The fields that each aggregate has, as the page came. */
const EACH = Array.from(document.querySelectorAll("[data-each]"), (part) => part.cloneNode(true));

/** A share of the volume; 0 for what is no number. @param {number} value */
const rounded = (value) => Number((value || 0).toPrecision(12));

/** Whether the aggregates of a mix are stated by their masses in a cubic metre. @param {any} aggregates */
export const areMasses = (aggregates) =>
  Array.isArray(aggregates) && aggregates.some((one) => one?.mass_kg_m3 !== undefined);

/**
 * The fields for the aggregate of this number; `Fields` reads them by their pointers.
 * @param {number} i
 * @param {boolean} byMass
 */
function part(i, byMass) {
  /** @param {string} id @param {string} label @param {object} attributes */
  const field = (id, label, attributes) =>
    h(
      "div",
      { class: "field" },
      h("label", { for: id }, label),
      h("input", { id, "data-path": `/mix/${id}`, ...attributes }),
    );
  /** @param {string} id @param {string} label */
  const quantity = (id, label) =>
    h(
      "div",
      { class: "field" },
      h("label", { for: id }, label),
      h(
        "span",
        { class: "with-unit" },
        h("input", { id, inputmode: "decimal", "data-path": `/mix/${id}_kg_m3`, "data-kind": "number" }),
        h("span", { class: "unit" }, "kg/m³"),
      ),
    );
  const body = h(
    "div",
    { class: "stack" },
    h(
      "div",
      { class: "row" },
      // First: what is wrong with all shares together is said here.
      ...(byMass
        ? [quantity("mass", "Mass"), quantity("density", "Density")]
        : [field("share", "Volume share", { inputmode: "decimal", "data-kind": "number" })]),
      field("name", "Name", { type: "text", dir: "auto", maxlength: 64, "data-kind": "text", "data-optional": "" }),
      h(
        "button",
        { type: "button", class: "quiet", "data-remove": i, "aria-label": `Remove aggregate ${i + 1}` },
        "Remove",
      ),
    ),
    ...EACH.map((one) => one.cloneNode(true)),
  );
  for (const element of body.querySelectorAll("*")) {
    for (const { name, value } of element.attributes) {
      if (["id", "for"].includes(name)) element.setAttribute(name, `aggregate-${i}-${value}`);
      else if (name.startsWith("data-")) element.setAttribute(name, value.replace("/mix/", `/mix/aggregates/${i}/`));
    }
  }
  body.querySelector(`#aggregate-${i}-d_min`)?.setAttribute("placeholder", "of the mix");
  return body;
}

/**
 * @param {any} aggregates as in a request
 * @returns {HTMLElement[]} for each its fields
 */
export function aggregateFields(aggregates) {
  if (!Array.isArray(aggregates)) return [];
  return aggregates.map((_, i) =>
    h("fieldset", { class: "aggregate" }, h("legend", {}, `Aggregate ${i + 1}`), part(i, areMasses(aggregates))),
  );
}

/**
 * Adds an aggregate that is as the last one, whose share or mass the two divide. That of a mix of one aggregate is the
 * first.
 * @param {any} mix as in a request
 */
export function addAggregate(mix) {
  const { grading, shape, shapes, aggregates = [{ share: 1, grading, shape, shapes }], ...others } = mix;
  const { name: _, ...last } = aggregates.at(-1);
  const part_ = areMasses(aggregates) ? "mass_kg_m3" : "share";
  const half = rounded(last[part_] / 2);
  const added = { ...structuredClone(last), [part_]: rounded(last[part_] - half) };
  return { ...others, aggregates: [...aggregates.slice(0, -1), { ...aggregates.at(-1), [part_]: half }, added] };
}

/**
 * Removes an aggregate, and gives its share or mass to the one before it. The last but one leaves a mix of one
 * aggregate; its volume fraction is that of its mass.
 * @param {any} mix as in a request
 * @param {number} i
 */
export function removeAggregate(mix, i) {
  const { aggregates, ...others } = mix;
  const left = aggregates.toSpliced(i, 1);
  const heir = left[Math.max(0, i - 1)];
  const byMass = areMasses(aggregates);
  const part_ = byMass ? "mass_kg_m3" : "share";
  heir[part_] = rounded(Number(heir[part_]) + Number(aggregates[i][part_]));
  if (left.length > 1) return { ...others, aggregates: left };
  const { name: _, share: __, mass_kg_m3, density_kg_m3, ...only } = left[0];
  const fraction = Number((mass_kg_m3 / density_kg_m3).toPrecision(6));
  const volume = byMass && !others.proportions ? { volume_fraction: fraction } : {};
  return { ...others, ...volume, ...only };
}
