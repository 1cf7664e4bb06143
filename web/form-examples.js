/** The examples of the gallery with their pictures, from which the form starts. */
import { absolute } from "./address.js";
import { get } from "./api.js";
import { h } from "./dom.js";

/** Topics that come first. */
const FIRST = ["gradings", "shapes", "mixes", "specimens"];

/** @typedef {{name: string, title: string, topic: string, about: string, request: any}} Example */

/** @returns {Promise<Example[]>} */
const gallery = () => get("/assets/gallery.json");

/**
 * The request of an example.
 * @param {string} name
 */
export async function exampleOf(name) {
  const found = (await gallery()).find((example) => example.name === name);
  if (!found) throw new Error(`There is no example ${name}.`);
  return found.request;
}

/**
 * Shows the examples in a dialog.
 * @param {(request: any) => void} take takes the request of the one that is chosen
 */
export async function chooseExample(take) {
  const examples = await gallery();
  const choose = (/** @type {Example} */ example) => {
    dialog.close();
    take(example.request);
  };
  const card = (/** @type {Example} */ example) =>
    h(
      "button",
      { type: "button", class: "example", "data-example": example.name, onclick: () => choose(example) },
      h("img", {
        src: absolute(`/assets/gallery/${example.name}.png`),
        alt: "",
        loading: "lazy",
        width: 240,
        height: 240,
      }),
      h("strong", {}, example.title),
      h("span", { class: "hint" }, example.about),
    );
  const known = examples.map((example) => example.topic);
  const topics = [...new Set([...FIRST.filter((topic) => known.includes(topic)), ...known])];
  const filter = h("input", { type: "search", "aria-label": "Search the examples", placeholder: "Search" });
  const sections = topics.map((topic) =>
    h(
      "section",
      { class: "stack tight" },
      h("h3", {}, topic.charAt(0).toUpperCase() + topic.slice(1)),
      h("div", { class: "cards" }, examples.filter((example) => example.topic === topic).map(card)),
    ),
  );
  filter.addEventListener("input", () => {
    const words = filter.value.trim().toLowerCase();
    for (const section of sections) {
      const cards = /** @type {HTMLElement[]} */ ([...section.querySelectorAll(".example")]);
      for (const one of cards) one.hidden = !one.textContent?.toLowerCase().includes(words);
      section.hidden = cards.every((one) => one.hidden);
    }
  });
  const dialog = h(
    "dialog",
    { class: "gallery", "aria-labelledby": "gallery-title" },
    h(
      "div",
      { class: "actions" },
      h("h2", { id: "gallery-title" }, "Start from an example"),
      filter,
      h("button", { type: "button", class: "quiet", onclick: () => dialog.close() }, "Close"),
    ),
    h("p", { class: "hint" }, "An example fills the form; what stands there now is replaced."),
    sections,
  );
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
}
