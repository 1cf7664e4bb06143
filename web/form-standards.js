/**
 * The gradings of standards in the form: the names of a standard follow it, and a grading that is one curve has no
 * limits to choose between.
 */
import { h, replace } from "./dom.js";

/**
 * A grading of a standard: of each sieve its size in mm, and the least and the most that may pass.
 * @typedef {{standard: string, name: string, limits: [number, number, number][]}} Standard
 */

/** Whether a grading is one curve. @param {Standard | undefined} grading */
const isCurve = (grading) => !grading || grading.limits.every(([, low, high]) => low === high);

/**
 * Offers the gradings of the standards that are chosen, in the fields of every aggregate.
 * @param {HTMLElement} form
 * @param {Standard[]} gradings all of them
 */
export function offerStandards(form, gradings) {
  if (!gradings.length) return;
  for (const element of form.querySelectorAll('select[data-path$="/grading/standard"]')) {
    const standard = /** @type {HTMLSelectElement} */ (element);
    const other = (/** @type {string} */ member) =>
      /** @type {HTMLSelectElement} */ (
        form.querySelector(`select[data-path="${standard.dataset.path?.replace(/standard$/, member)}"]`)
      );
    offer(standard, [...new Set(gradings.map((one) => one.standard))]);
    const here = gradings.filter((one) => one.standard === standard.value);
    const name = other("name");
    offer(
      name,
      here.map((one) => one.name),
    );
    const field = /** @type {HTMLElement} */ (other("curve").closest(".field"));
    if (isCurve(here.find((one) => one.name === name.value))) field.hidden = true;
  }
}

/**
 * Sets the options of a select; a choice that none of them is gives way to the first.
 * @param {HTMLSelectElement} select
 * @param {string[]} names
 */
function offer(select, names) {
  const { value } = select;
  if (Array.from(select.options, (option) => option.value).join("\n") === names.join("\n")) return;
  replace(select, ...names.map((name) => h("option", {}, name)));
  select.value = names.includes(value) ? value : (names[0] ?? "");
}
