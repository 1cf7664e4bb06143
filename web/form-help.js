/**
 * A button beside the label of each field that shows what the field means, with a link into the documents. The words
 * are loaded at the first click (`help.js`).
 */
import { absolute } from "./address.js";
import { h, replace } from "./dom.js";

/** How many texts there are: each has its id. */
let texts = 0;

/**
 * Adds the buttons to all fields that have none.
 * @param {ParentNode} form
 */
export function offerHelp(form) {
  for (const field of /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll(".field, [data-help]"))) {
    const label = field.querySelector(":scope > label, :scope > .label");
    const control = /** @type {HTMLInputElement | null} */ (field.querySelector("input, select, textarea"));
    if (!label) continue;
    const ofControl = control?.type === "radio" ? control.name : (control?.dataset.path ?? control?.id);
    const path = field.dataset.help ?? ofControl ?? "";
    const key = path.replace(/^\/mix\/aggregates\/\d+\//, "/mix/");
    const place = h("p", { class: "hint", id: `help-${(texts += 1)}`, "aria-live": "polite", hidden: true });
    const name = label.textContent ?? "";
    const button = h(
      "button",
      {
        type: "button",
        class: "help",
        "aria-label": `Help: ${name}`,
        "aria-expanded": "false",
        "aria-controls": place.id,
        onclick: () => toggle(button, place, name, key),
        onkeydown: (/** @type {KeyboardEvent} */ event) => {
          if (event.key === "Escape" && !place.hidden) toggle(button, place, name, key);
        },
      },
      "?",
    );
    const row = h("span", { class: "labelled" });
    label.replaceWith(row);
    row.append(label, button);
    // Below all fields of a row, which has more room; where the field is hidden, so is its help.
    const part = h("div", { class: "help-text", "data-when": field.dataset.when }, place);
    const [fields, table] = [field.closest(".row"), field.closest(".table")];
    if (table) table.after(part);
    else if (fields) fields.append(part);
    else row.after(part);
  }
}

/** @param {HTMLElement} button @param {HTMLElement} place @param {string} name @param {string} key */
async function toggle(button, place, name, key) {
  place.hidden = !place.hidden;
  button.setAttribute("aria-expanded", String(!place.hidden));
  if (place.hidden || place.firstChild) return;
  const { HELP } = await import("./help.js");
  const [words, page] = HELP[key] ?? ["", "page"];
  replace(
    place,
    h("strong", {}, `${name}: `),
    `${words} `,
    h("a", { href: absolute(`/docs/${page}`), target: "_blank" }, "More in the documents"),
  );
}
