/** Tabs: one panel of several is shown. A panel is made when it is shown first, and the address names it. */
import { h } from "./dom.js";
import { report } from "./shell.js";

/** @typedef {{id: string, name: string, make: () => Promise<Node> | Node}} Tab */

/**
 * @param {Tab[]} list
 * @param {string} label of the row of tabs
 * @returns {{element: HTMLElement, open: (id: string) => void}}
 */
export function tabs(list, label) {
  /** @type {Set<string>} */
  const made = new Set();
  const buttons = list.map(({ id, name }) =>
    h(
      "button",
      { type: "button", role: "tab", id: `tab-${id}`, "aria-controls": `panel-${id}`, onclick: () => open(id, true) },
      name,
    ),
  );
  const panels = list.map(({ id }) =>
    h("div", { id: `panel-${id}`, role: "tabpanel", "aria-labelledby": `tab-${id}`, class: "stack" }),
  );
  const row = h("div", { class: "tabs", role: "tablist", "aria-label": label }, buttons);
  row.addEventListener("keydown", (event) => {
    const at = buttons.indexOf(/** @type {HTMLButtonElement} */ (document.activeElement));
    const step = { ArrowRight: 1, ArrowLeft: -1, Home: -at, End: -at - 1 }[event.key];
    if (step === undefined || at < 0) return;
    event.preventDefault();
    const next = (at + step + list.length) % list.length;
    open(list[next]?.id ?? "", true);
    buttons[next]?.focus();
  });

  /** @param {string} id @param {boolean} [byHand] the address is to name it */
  function open(id, byHand = false) {
    list.forEach((tab, i) => {
      const here = tab.id === id;
      buttons[i]?.setAttribute("aria-selected", String(here));
      buttons[i]?.setAttribute("tabindex", here ? "0" : "-1");
      panels[i]?.toggleAttribute("hidden", !here);
      if (!here || made.has(id)) return;
      made.add(id);
      Promise.resolve(tab.make()).then((content) => panels[i]?.append(content), report);
    });
    if (byHand) history.replaceState(history.state, "", `#${id}`);
  }
  const named = location.hash.slice(1);
  open(list.some(({ id }) => id === named) ? named : (list[0]?.id ?? ""));
  return { element: h("div", { class: "stack" }, row, panels), open };
}
