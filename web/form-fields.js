/**
 * The fields of the form and the request that they make. A control names its place in the request by a JSON pointer:
 *
 *   - `data-path`: the pointer; `data-kind`: `number`, `text`, `choice`, `sieves`, or `variant` for a member `type`;
 *   - `data-when`: the condition under which the control or what is around it is shown, `PATH=a,b` or `PATH!a`;
 *   - `data-start`: its value when it is first shown; `data-default`: what its absence means;
 *   - `data-with`: another member that is set with it, `PATH=value`.
 *
 * Members of a request that no control knows are kept as they are. An object whose members the controls cannot show
 * (size classes, mixtures) is kept whole: its variant is then "As in the JSON". Several aggregates, which take the
 * place of the grading, have these fields each (`form-aggregates.js`).
 */
import { byId, h, replace } from "./dom.js";
import { aggregateFields } from "./form-aggregates.js";
import { rowsOf, sieves } from "./form-sieves.js";
import { getAt, removeAt, setAt } from "./form-pointer.js";
import { faultOf, numberOf, offersOf } from "./numbers.js";

/** @typedef {HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement} Control */

/** Values of variants that no option of the page has: what is kept whole, and several aggregates. */
const GIVEN = "~given";
const SEVERAL = "~several";

/** The member that takes the place of another, if any does. @param {string} object */
const instead = (object) =>
  object === "/mix/grading" ? "/mix/aggregates" : object.endsWith("/shape") ? `${object}s` : "";

export class Fields {
  /** @param {HTMLFormElement} form */
  constructor(form) {
    this.form = form;
    /** @type {any} The request that the form was filled from. */
    this.base = {};
    /** @type {Control[]} */
    this.controls = [];
    /** Takes a value that is offered at a field. @type {(control: Control, value: string) => void} */
    this.take = () => {};
    this.#find();
  }

  /** Finds the controls, some of which are new. */
  #find() {
    const known = new Set(this.controls);
    this.controls = Array.from(this.form.querySelectorAll("[data-path]"));
    for (const control of this.controls) if (!known.has(control)) this.#describe(control);
  }

  /** Makes the place for a control's fault. @param {Control} control */
  #describe(control) {
    if (control.type === "radio") return;
    const id = `${control.id}-fault`;
    const hint = document.getElementById(`${control.id}-hint`);
    control.setAttribute("aria-describedby", hint ? `${hint.id} ${id}` : id);
    control.closest(".field")?.append(h("p", { class: "fault", id }));
  }

  /** What a control at a path says; empty where it is not shown. @param {string} path */
  value(path) {
    const control = this.controls.find((one) => one.dataset.path === path && (one.type !== "radio" || isChecked(one)));
    return control && !control.closest("[hidden]") ? control.value : "";
  }

  /** Shows the parts of the form that belong to the variants chosen. */
  arrange() {
    for (const part of /** @type {NodeListOf<HTMLElement>} */ (this.form.querySelectorAll("[data-when]"))) {
      const [, path = "", mark, values = ""] = /^([^=!]+)([=!])(.*)$/.exec(part.dataset.when ?? "") ?? [];
      const value = path.startsWith("/") ? this.value(path) : String(new FormData(this.form).get(path));
      part.hidden = values.split(",").includes(value) !== (mark === "=");
    }
  }

  /**
   * Shows a request.
   * @param {any} request
   */
  fill(request) {
    this.base = structuredClone(request);
    replace(byId("aggregates"), aggregateFields(getAt(request, "/mix/aggregates")));
    this.#find();
    const part = ["proportions", "count"].find((name) => getAt(request, `/mix/${name}`)) ?? "volume_fraction";
    for (const radio of /** @type {NodeListOf<HTMLInputElement>} */ (this.form.querySelectorAll("[data-part]"))) {
      radio.checked = radio.value === part;
    }
    const variants = this.controls.filter((control) => control.dataset.kind === "variant");
    for (const control of variants) this.#fillVariant(control);
    this.arrange();
    for (const control of this.controls) if (control.dataset.kind !== "variant") this.#fillOne(control);
    this.arrange();
  }

  /** @param {Control} control */
  #fillVariant(control) {
    const path = control.dataset.path ?? "";
    const absent = getAt(this.base, path.replace(/\/type$/, "")) === undefined;
    const first = control instanceof HTMLSelectElement ? control.options[0]?.value : "box";
    const type = getAt(this.base, path) ?? control.dataset.default ?? (absent ? first : undefined);
    if (control instanceof HTMLInputElement) {
      control.checked = control.value === type;
      return;
    }
    const select = /** @type {HTMLSelectElement} */ (control);
    const object = path.replace(/\/type$/, "");
    select.querySelector('[value^="~"]')?.remove();
    const known = Array.from(select.options).some((option) => option.value === type);
    const place = instead(object);
    const other = place ? getAt(this.base, place) : undefined;
    const given = !known || other !== undefined || !this.#fits(object, type);
    const value = Array.isArray(other) && object === "/mix/grading" ? SEVERAL : GIVEN;
    if (given) select.append(h("option", { value }, value === SEVERAL ? "Several aggregates" : "As in the JSON"));
    select.value = given ? value : type;
  }

  /** Whether the controls can show all that they would overwrite. @param {string} object @param {string} type */
  #fits(object, type) {
    return this.controls.every((control) => {
      const path = control.dataset.path ?? "";
      if (!path.startsWith(`${object}/`) || !shownWith(control, `${object}/type`, type)) return true;
      const value = getAt(this.base, path);
      const [companion, needed] = (control.dataset.with ?? "").split("=");
      const other = companion && getAt(this.base, companion);
      if (other !== undefined && companion && other !== needed) return false;
      if (value === undefined || value === null) return true;
      if (control.dataset.kind === "sieves") return Array.isArray(value);
      return typeof value === "number" || typeof value === "string";
    });
  }

  /** @param {Control} control */
  #fillOne(control) {
    delete control.dataset.fault;
    const value = getAt(this.base, control.dataset.path ?? "");
    const hidden = control.closest("[hidden]");
    const { start = "", default: standard = "" } = control.dataset;
    if (value !== undefined && value !== null)
      control.value = control.dataset.kind === "sieves" ? rowsOf(value) : String(value);
    else control.value = standard || (hidden ? start : "");
    if (control instanceof HTMLSelectElement && control.selectedIndex < 0) {
      if (value === undefined) control.value = start || (control.options[0]?.value ?? "");
      else control.append(h("option", { value: String(value), selected: true }, String(value)));
    }
  }

  /**
   * The request that the fields make, and the faults that the page finds itself.
   * @returns {{request: any, faults: {pointer: string, detail: string}[]}}
   */
  read() {
    const request = structuredClone(this.base);
    /** @type {{pointer: string, detail: string}[]} */
    const faults = [];
    for (const control of this.controls) if (control.dataset.kind === "variant") this.#readVariant(control, request);
    for (const radio of /** @type {NodeListOf<HTMLInputElement>} */ (this.form.querySelectorAll("[data-part]"))) {
      if (!radio.checked) removeAt(request, radio.dataset.part ?? "");
    }
    for (const control of this.controls)
      if (control.dataset.kind !== "variant") this.#readOne(control, request, faults);
    for (const control of this.controls) if (control.dataset.kind === "variant") this.#dropDefault(control, request);
    return { request: ordered(request), faults };
  }

  /** @param {Control} control @param {any} request */
  #readVariant(control, request) {
    if (control.type === "radio" && !isChecked(control)) return;
    const path = control.dataset.path ?? "";
    const object = path.replace(/\/type$/, "");
    if (control.value.startsWith("~")) return;
    if (control.closest("[hidden]")) return removeAt(request, object);
    removeAt(request, instead(object));
    const type = getAt(request, path) ?? control.dataset.default;
    if (type !== control.value || !this.#fits(object, type)) setAt(request, object, { type: control.value });
    else setAt(request, path, control.value);
  }

  /** @param {Control} control @param {any} request @param {{pointer: string, detail: string}[]} faults */
  #readOne(control, request, faults) {
    const path = control.dataset.path ?? "";
    if (this.#isGiven(path)) return;
    const words = control.value.trim();
    if (control.closest("[hidden]")) return removeAt(request, path);
    if (words === "") return /\/\d+$/.test(path) ? setAt(request, path, null) : removeAt(request, path);
    if (words === control.dataset.default && getAt(this.base, path) === undefined) return removeAt(request, path);
    const [companion, needed] = (control.dataset.with ?? "").split("=");
    if (companion) setAt(request, companion, needed);
    if (control.dataset.kind === "sieves") {
      // A table that is not the rows of points is read first.
      const { points, fault } = sieves(control.value);
      const detail = control.dataset.fault || fault;
      if (detail) faults.push({ pointer: path, detail });
      setAt(request, path, points);
    } else if (control.dataset.kind === "number") {
      const fault = faultOf(words);
      if (fault) faults.push({ pointer: path, detail: fault });
      setAt(request, path, numberOf(words, unitOf(control)));
    } else setAt(request, path, control.value);
  }

  /** Leaves an object away that says no more than its absence. @param {Control} control @param {any} request */
  #dropDefault(control, request) {
    const object = (control.dataset.path ?? "").replace(/\/type$/, "");
    const value = getAt(request, object);
    const plain = value && Object.keys(value).length === 1 && value.type === control.dataset.default;
    if (plain && getAt(this.base, object) === undefined) removeAt(request, object);
  }

  /** Whether a path is inside of an object that is kept whole. @param {string} path */
  #isGiven(path) {
    return this.controls.some(
      (control) =>
        control.dataset.kind === "variant" &&
        control.value.startsWith("~") &&
        path.startsWith((control.dataset.path ?? "").replace(/type$/, "")),
    );
  }

  /**
   * Shows faults at their fields.
   * @param {{pointer?: string, detail: string}[]} faults
   * @returns {{pointer?: string, detail: string}[]} those that belong to no field on the page
   */
  mark(faults) {
    /** @type {Map<Control, string[]>} */
    const found = new Map();
    const others = faults.filter((fault) => {
      const control = this.at(fault.pointer ?? "");
      if (control) found.set(control, [...(found.get(control) ?? []), plainly(control, fault.detail)]);
      return !control;
    });
    for (const control of this.controls) {
      const words = found.get(control);
      if (words) control.setAttribute("aria-invalid", "true");
      else control.removeAttribute("aria-invalid");
      const place = document.getElementById(`${control.id}-fault`);
      if (place) this.#say(place, control, words?.join(" ") ?? "");
    }
    return others;
  }

  /**
   * Says what is wrong with a control, and offers the values next to it that can be.
   * @param {HTMLElement} place @param {Control} control @param {string} words
   */
  #say(place, control, words) {
    const key = words && `${words} ${control.value}`;
    if ((place.dataset.words ?? "") === key) return;
    place.dataset.words = key;
    const unit = unitOf(control);
    const offers = control.dataset.kind === "number" ? offersOf(control.value, words, unit) : [];
    const button = (/** @type {string} */ value) =>
      h(
        "button",
        { type: "button", class: "offer", onclick: () => this.take(control, value) },
        `Use ${value}${unit && ` ${unit}`}`,
      );
    replace(place, words, offers.length > 0 && h("span", { class: "offers" }, offers.map(button)));
  }

  /** Shows a number that was typed with its unit in that of its field. @param {EventTarget | null} target */
  tidy(target) {
    const control = this.controls.find((one) => one === target);
    if (control?.dataset.kind !== "number" || !/\d\s*[^\d.,\s]+$/.test(control.value)) return;
    control.value = String(numberOf(control.value, unitOf(control)));
  }

  /** Pointers of what the controls on the page show. */
  shown() {
    const shown = this.controls.filter(
      (control) => !control.closest("[hidden]") && !control.value.startsWith("~given"),
    );
    return shown.map((control) => control.dataset.path ?? "");
  }

  /** The control that shows a pointer, if any does. @param {string} pointer */
  at(pointer) {
    const shown = this.controls.filter((control) => !control.closest("[hidden]") && control.type !== "radio");
    return (
      shown.find((control) => control.dataset.path === pointer) ??
      shown.find((control) => pointer.startsWith(`${control.dataset.path}/`)) ??
      (pointer.split("/").length > 2
        ? shown.find((control) => control.dataset.path?.startsWith(`${pointer}/`))
        : undefined)
    );
  }
}

/** The unit that stands beside a control. @param {Control} control */
const unitOf = (control) => control.parentElement?.querySelector(".unit")?.textContent ?? "";

/** @param {Control} control */
const isChecked = (control) => control instanceof HTMLInputElement && control.checked;

/** Whether a control belongs to a variant. @param {Control} control @param {string} path @param {string} type */
function shownWith(control, path, type) {
  const part = /** @type {HTMLElement | null} */ (control.closest(`[data-when^="${path}="]`));
  return (
    !part ||
    (part.dataset.when ?? "")
      .slice(path.length + 1)
      .split(",")
      .includes(type)
  );
}

/** @param {Control} control @param {string} detail */
function plainly(control, detail) {
  if (control.value.trim() === "" && /is missing|null is not/.test(detail)) return "A value is needed.";
  return detail.charAt(0).toUpperCase() + detail.slice(1);
}

/** The members in the order in which people read them. @param {any} request */
function ordered(request) {
  const { name, seed, specimen, mix, distance, method, ...others } = request;
  return Object.fromEntries(
    Object.entries({ name, seed, ...others, specimen, mix, distance, method }).filter(
      ([, value]) => value !== undefined,
    ),
  );
}
