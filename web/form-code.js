/**
 * The request as JSON, which can be changed and pasted, as a command with curl, and as a script for Python, PowerShell
 * and MATLAB.
 */
import { curl, json, python } from "./code.js";
import { copyButton, h, replace, text } from "./dom.js";
import { parse } from "./numbers.js";

/** @type {Record<string, string>} */
const KINDS = { json: "JSON", curl: "curl", python: "Python", powershell: "PowerShell", matlab: "MATLAB" };

export class CodePart {
  /**
   * @param {HTMLElement} place
   * @param {(request: any) => void} fill shows a request that was typed or pasted
   */
  constructor(place, fill) {
    this.request = {};
    const choices = Object.entries(KINDS).map(([value, name]) =>
      h(
        "label",
        {},
        h("input", {
          type: "radio",
          name: "code",
          value,
          checked: value === "json",
          onchange: () => this.#show(value),
        }),
        name,
      ),
    );
    this.field = h("textarea", {
      id: "json",
      rows: 12,
      spellcheck: "false",
      "aria-describedby": "json-hint json-fault",
    });
    this.fault = h("p", { class: "fault", id: "json-fault" });
    this.words = h("pre", { tabindex: "0" });
    this.code = h("div", { hidden: true }, this.words);
    this.json = h(
      "div",
      { class: "field" },
      h("label", { for: "json", class: "visually-hidden" }, "Request as JSON"),
      this.field,
      h(
        "p",
        { class: "hint", id: "json-hint" },
        "Typed or pasted JSON fills the form. Members that the form does not show are kept.",
      ),
      this.fault,
    );
    this.kind = "json";
    this.withKey = false;
    this.field.addEventListener("input", () => {
      try {
        const request = parse(this.field.value);
        if (typeof request !== "object" || request === null || Array.isArray(request))
          throw new Error("A request is an object.");
        if ("list" in request) throw new Error("A study with a list of jobs cannot be shown in the form.");
        this.#mark("");
        fill(request);
      } catch (error) {
        this.#mark(/** @type {Error} */ (error).message);
      }
    });
    this.field.addEventListener("blur", () => {
      if (!this.fault.textContent) this.#update();
    });
    const tools = h(
      "div",
      { class: "actions" },
      h("span", { class: "choices", role: "radiogroup", "aria-label": "Form of the request" }, choices),
      copyButton(() => (this.kind === "json" ? this.field.value : (this.words.textContent ?? ""))),
    );
    replace(place, tools, this.json, this.code);
  }

  /** @param {string} fault */
  #mark(fault) {
    text(this.fault, fault);
    if (fault) this.field.setAttribute("aria-invalid", "true");
    else this.field.removeAttribute("aria-invalid");
  }

  /** @param {string} kind */
  #show(kind) {
    this.kind = kind;
    this.json.hidden = kind !== "json";
    this.code.hidden = kind === "json";
    this.#update();
  }

  /** Shows another request; what is being typed stays. @param {any} request */
  set(request) {
    this.request = request;
    if (document.activeElement === this.field) return;
    this.#mark("");
    this.#update();
  }

  /** Writes the request for a program. @param {string} kind */
  async #write(kind) {
    this.words.setAttribute("aria-label", kind === "curl" ? "Command with curl" : `Script for ${KINDS[kind]}`);
    const more = kind === "powershell" || kind === "matlab" ? await import("./code-more.js") : null;
    const write = { curl, python, ...more }[kind];
    if (write && kind === this.kind) text(this.words, write(this.request, this.withKey));
  }

  #update() {
    if (this.kind === "json") this.field.value = json(this.request);
    else this.#write(this.kind);
  }
}
