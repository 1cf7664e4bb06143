/**
 * What a request has without a field on the page that shows it: members that came with the address, a file or JSON, and
 * that are submitted. They are listed, and each can be removed.
 */
import { h, replace } from "./dom.js";

/** The longest value that is shown. */
const MOST = 60;

/**
 * The members that no control shows, by their pointers; an object none of whose members is shown is one.
 * @param {any} request
 * @param {string[]} paths of the controls that are shown
 * @returns {[string, any][]}
 */
export function withoutField(request, paths) {
  /** @type {[string, any][]} */
  const found = [];
  const visit = (/** @type {string} */ pointer, /** @type {any} */ value) => {
    if (value === undefined || paths.some((path) => path === pointer)) return;
    const isHolder = typeof value === "object" && value !== null;
    if (isHolder && paths.some((path) => path.startsWith(`${pointer}/`))) {
      for (const [name, member] of Object.entries(value)) {
        visit(`${pointer}/${name.replaceAll("~", "~0").replaceAll("/", "~1")}`, member);
      }
    } else found.push([pointer, value]);
  };
  for (const [name, value] of Object.entries(request)) visit(`/${name}`, value);
  return found;
}

/**
 * Lists the members.
 * @param {HTMLElement} place
 * @param {[string, any][]} members
 * @param {(pointers: string[]) => void} remove
 */
export function showMembers(place, members, remove) {
  const words = (/** @type {any} */ value) => {
    const text = JSON.stringify(value);
    return text.length > MOST ? `${text.slice(0, MOST)}\u2026` : text;
  };
  const button = (/** @type {string} */ label, /** @type {string} */ name, /** @type {string[]} */ pointers) =>
    h("button", { type: "button", class: "quiet", "aria-label": name, onclick: () => remove(pointers) }, label);
  const line = (/** @type {[string, any]} */ [pointer, value]) => {
    const name = pointer.slice(1).replaceAll("/", ".");
    return h("li", {}, h("code", {}, `${name}: ${words(value)}`), button("Remove", `Remove ${name}`, [pointer]));
  };
  place.hidden = members.length === 0;
  replace(
    place,
    h(
      "div",
      { class: "notice", "data-kind": "info" },
      h(
        "div",
        {},
        h("p", {}, "The request also has members that no field above shows. They are submitted."),
        h("ul", { class: "members" }, members.map(line)),
      ),
      members.length > 1 &&
        button(
          "Remove all",
          "Remove all members without a field",
          members.map(([pointer]) => pointer),
        ),
    ),
  );
}
