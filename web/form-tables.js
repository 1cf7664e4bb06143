/**
 * Where tables of gradings and recipes come from: what is pasted, dropped, or chosen as a file. A table in the field of
 * a curve gives its points, one in the field for tables the whole mix. What shows them is loaded with the first.
 */
import { areMasses } from "./form-aggregates.js";
import { byId } from "./dom.js";
import { areTyped, rowsOf } from "./form-sieves.js";

/** Time after the last key until a text that is no plain rows is read as a table, in ms. */
const PAUSE = 500;
/** Fewer rows are added to those of the field where they are pasted. */
const WHOLE = 3;

/** @typedef {HTMLTextAreaElement} Field */

export class Tables {
  /**
   * @param {HTMLElement} form
   * @param {(mix: any) => void} take takes a mix
   * @param {() => void} changed something was read
   */
  constructor(form, take, changed) {
    this.take = take;
    this.changed = changed;
    this.field = /** @type {Field} */ (byId("table"));
    this.place = byId("reading");
    this.timer = 0;
    const file = /** @type {HTMLInputElement} */ (byId("table-file"));
    file.addEventListener("change", () => {
      if (file.files?.[0]) this.read(this.field, file.files[0]);
      file.value = "";
    });
    form.addEventListener("paste", (event) => this.#paste(event));
    for (const type of ["dragover", "drop"])
      form.addEventListener(type, (event) => this.#drop(/** @type {any} */ (event)));
  }

  /** The field that takes tables at an element, if any does. @param {EventTarget | null} target */
  #fieldAt(target) {
    const field = /** @type {Field | null} */ (/** @type {Element} */ (target)?.closest?.("textarea"));
    return field === this.field || field?.dataset.kind === "sieves" ? field : null;
  }

  /** @param {ClipboardEvent} event */
  #paste(event) {
    const field = this.#fieldAt(event.target);
    if (!field) return;
    const file = event.clipboardData?.files[0];
    const words = event.clipboardData?.getData("text/plain") ?? "";
    const rows = words.split(/\r?\n|\r/).filter((row) => row.trim()).length;
    const isWhole = field.selectionEnd - field.selectionStart === field.value.length;
    if (!file && (rows < 2 || (!isWhole && rows < WHOLE))) return;
    event.preventDefault();
    if (!file) field.value = words;
    this.read(field, file ?? words);
  }

  /** @param {DragEvent} event */
  #drop(event) {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    const file = event.dataTransfer.files[0];
    if (event.type === "drop" && file) this.read(this.#fieldAt(event.target) ?? this.field, file);
  }

  /**
   * Looks at what was typed. Whether the form has to wait for it.
   * @param {Event} event of input
   */
  typed(event) {
    const field = this.#fieldAt(event.target);
    if (!field) return false;
    clearTimeout(this.timer);
    delete field.dataset.fault;
    const words = field.value;
    // A text that is set as a whole, by a script or by dropping it, is no typing.
    const { inputType = "" } = /** @type {InputEvent} */ (event);
    const isWhole = ["", "insertFromDrop"].includes(inputType) && /\S\s*\n\s*\S/.test(words);
    if (!words.trim()) this.#clear(field);
    else if (isWhole) this.read(field, words);
    else if (field === this.field || !areTyped(words)) {
      this.#wait(field);
      this.timer = setTimeout(() => this.read(field, words), PAUSE);
    } else this.#clear(field);
    return field === this.field;
  }

  /** The form is not sent before a table was read. @param {Field} field */
  #wait(field) {
    if (field !== this.field) field.dataset.fault = "The table is being read.";
  }

  /** @param {Field} field */
  #clear(field) {
    const place = field === this.field ? this.place : field.closest(".field")?.querySelector(".reading");
    if (place?.firstChild) import("./form-reading.js").then(({ clear }) => clear(place));
  }

  /**
   * Reads a table into a field.
   * @param {Field} field
   * @param {Blob | string} table
   */
  async read(field, table) {
    clearTimeout(this.timer);
    this.#wait(field);
    if (field !== this.field) this.changed();
    const place = this.#placeOf(field);
    const blob = typeof table === "string" ? new Blob([table], { type: "text/plain" }) : table;
    const { read } = await import("./form-reading.js");
    const fault = await read(place, blob, (request) => this.#take(field, request.mix));
    // What is read into the field for tables changes the form when it is taken.
    if (fault === null || field === this.field) return;
    if (fault) field.dataset.fault = fault;
    this.changed();
  }

  /** @param {Field} field */
  #placeOf(field) {
    if (field === this.field) return this.place;
    const parent = /** @type {HTMLElement} */ (field.closest(".field"));
    const known = parent.querySelector(".reading");
    if (known) return known;
    const made = document.createElement("div");
    made.className = "reading stack";
    parent.append(made);
    return made;
  }

  /** @param {Field} field @param {any} mix */
  #take(field, mix) {
    delete field.dataset.fault;
    if (field === this.field || !mix.grading?.points) return this.take(mix);
    field.value = rowsOf(mix.grading.points);
    this.changed();
  }
}

/**
 * A mix with what a table says of it in place of what it said before.
 * @param {any} mix as in a request
 * @param {any} read
 */
export function mixWith(mix, read) {
  const { grading: _, aggregates: __, ...others } = mix ?? {};
  if (!read.aggregates) return { ...others, ...read };
  const { shape: ___, shapes: ____, ...without } = others;
  const { volume_fraction: _____, proportions: ______, count: _______, ...empty } = without;
  const hasAmount = areMasses(read.aggregates) || read.volume_fraction !== undefined || read.proportions;
  const kept = hasAmount ? empty : without;
  // An aggregate without a curve waits for one.
  const aggregates = read.aggregates.map((/** @type {any} */ one) => ({
    ...one,
    grading: one.grading ?? { type: "sieves" },
  }));
  return { ...kept, ...read, aggregates };
}
