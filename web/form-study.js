/** The part of the form that makes a study: values of one or two fields, and seeds. */
import { h, replace, text } from "./dom.js";
import { faultOf, listOf, numberOf, parse } from "./numbers.js";

/** @typedef {{pointer: string, values: any}} Axis */

/** Whether a value is an object with nothing but a type. @param {any} value */
const isPlainType = (value) => typeof value === "object" && value !== null && Object.keys(value).join() === "type";

/** @param {any} values of a grid, as people write them */
function written(values) {
  if (!Array.isArray(values))
    return values && "from" in values ? `${values.from} to ${values.to} step ${values.step}` : JSON.stringify(values);
  if (values.every((value) => isPlainType(value))) return values.map((value) => value.type).join(", ");
  return values.every((value) => typeof value !== "object" && !/[,;\s[]/.test(String(value)))
    ? values.join(", ")
    : JSON.stringify(values);
}

/**
 * The values of a field: a list, a range, or an array of JSON. Words for a method are objects with this type.
 * @param {string} words
 * @param {string} pointer
 * @returns {{values: any, fault: string}} `fault` is empty where the words were understood
 */
function read(words, pointer) {
  const plain = words.trim();
  const unit = /_mm(\/|$)/.test(pointer) ? "mm" : "";
  const range = /^(\S+)\s+to\s+(\S+)\s+step\s+(\S+)$/.exec(plain);
  if (range) {
    const [from, to, step] = range.slice(1).map((part) => numberOf(part, unit));
    const areNumbers = [from, to, step].every((value) => typeof value === "number");
    return {
      values: { from, to, step },
      fault: areNumbers ? "" : "A range has three numbers, as 0.5 to 0.7 step 0.05.",
    };
  }
  if (plain.startsWith("[")) {
    try {
      return { values: parse(plain), fault: "" };
    } catch (error) {
      return { values: [], fault: /** @type {Error} */ (error).message };
    }
  }
  const { parts, fault } = listOf(plain);
  const values = parts.map((part) => {
    const value = numberOf(part, unit);
    return typeof value === "string" && pointer === "/method" ? { type: value } : value;
  });
  return { values, fault: fault || (parts.map(faultOf).find(Boolean) ?? "") };
}

/** How many values there are. @param {any} values */
const count = (values) =>
  Array.isArray(values)
    ? values.length
    : Math.max(0, Math.floor(((values.to - values.from) / values.step) * (1 + 1e-12) + 1e-9) + 1) || 0;

/** The pointer to the values of a field in the study. @param {string} pointer */
const gridPointer = (pointer) => `/grid/${pointer.replaceAll("~", "~0").replaceAll("/", "~1")}`;

export class StudyPart {
  /**
   * @param {HTMLElement} place
   * @param {() => {pointer: string, label: string}[]} choices the fields that can be varied
   */
  constructor(place, choices) {
    this.place = place;
    this.choices = choices;
    /** @type {any} Members of the study that this part does not know. */
    this.base = {};
    this.axes = [0, 1].map((index) => this.#axis(index));
    this.seeds = h("input", { id: "seeds", inputmode: "numeric", "aria-describedby": "seeds-fault", value: "10" });
    this.sum = h("p", { class: "hint", role: "status" });
    replace(
      place,
      ...this.axes.map((axis) => axis.row),
      h(
        "div",
        { class: "row" },
        h(
          "div",
          { class: "field" },
          h("label", { for: "seeds" }, "Seeds for each point"),
          this.seeds,
          h("p", { class: "fault", id: "seeds-fault" }),
        ),
      ),
      this.sum,
    );
  }

  /** @param {number} index */
  #axis(index) {
    const select = h("select", { id: `vary-${index}` });
    const values = h("input", {
      id: `values-${index}`,
      type: "text",
      spellcheck: "false",
      "aria-describedby": `values-${index}-hint values-${index}-fault`,
    });
    const row = h(
      "div",
      { class: "axis-row" },
      h("div", { class: "field" }, h("label", { for: select.id }, index ? "And" : "Vary"), select),
      h(
        "div",
        { class: "field" },
        h("label", { for: values.id }, "Values"),
        values,
        h(
          "p",
          { class: "hint", id: `values-${index}-hint` },
          index ? "" : "A list, as 0.5, 0.6 or 0,5; 0,6, or a range, as 0.5 to 0.7 step 0.05.",
        ),
        h("p", { class: "fault", id: `values-${index}-fault` }),
      ),
    );
    return { select, values, row };
  }

  /** Offers the fields that are shown now. */
  arrange() {
    const choices = this.choices();
    for (const [index, { select, values }] of this.axes.entries()) {
      const chosen = select.value;
      const known = chosen === "" || choices.some((choice) => choice.pointer === chosen);
      replace(
        select,
        h("option", { value: "" }, index ? "nothing else" : "nothing, seeds alone"),
        ...choices.map((choice) => h("option", { value: choice.pointer }, choice.label)),
        !known && h("option", { value: chosen }, chosen),
      );
      select.value = chosen;
      values.disabled = !chosen;
    }
  }

  /** Shows a study. @param {any} study */
  fill(study) {
    const { template: _, grid = {}, replicates = 1, name: __, ...others } = study;
    const entries = Object.entries(grid);
    this.base = { others, grid: Object.fromEntries(entries.slice(2)) };
    for (const [index, { select, values }] of this.axes.entries()) {
      const [pointer = "", given] = entries[index] ?? [];
      replace(select, h("option", { value: pointer }, pointer));
      select.value = pointer;
      values.value = pointer ? written(given) : "";
    }
    this.seeds.value = String(replicates);
    this.arrange();
  }

  /** The study with a template. @param {any} job */
  read(job) {
    const { name, seed, ...template } = job;
    const words = this.seeds.value.trim();
    const replicates = Number.isInteger(Number(words)) && words ? Number(words) : words || null;
    const axes = this.axes
      .filter(({ select }) => select.value)
      .map(({ select, values }) => [select.value, read(values.value, select.value).values]);
    const grid = { ...Object.fromEntries(axes), ...this.base.grid };
    const points = Object.values(grid).reduce((product, values) => product * count(values), 1);
    const jobs = points * Number(replicates);
    text(
      this.sum,
      Number.isFinite(jobs) && jobs > 0
        ? `${points} ${points === 1 ? "point" : "points"}, ${jobs} ${jobs === 1 ? "job" : "jobs"}`
        : "",
    );
    const study = {
      name,
      seed,
      ...this.base.others,
      template,
      grid: Object.keys(grid).length ? grid : undefined,
      replicates,
    };
    return Object.fromEntries(Object.entries(study).filter(([, value]) => value !== undefined));
  }

  /**
   * The first point as a job, for its plan; and what it is.
   * @param {any} job
   * @param {(job: any, pointer: string, value: any) => void} set
   */
  first(job, set) {
    const point = structuredClone(job);
    const words = this.axes
      .filter(({ select }) => select.value)
      .map(({ select, values }) => {
        const { values: given } = read(values.value, select.value);
        const value = Array.isArray(given) ? given[0] : given.from;
        if (value !== undefined) set(point, select.value, value);
        return `${select.selectedOptions[0]?.textContent} ${typeof value === "object" ? JSON.stringify(value) : value}`;
      });
    return { point, note: words.length ? `For the first point: ${words.join(", ").toLowerCase()}.` : "" };
  }

  /**
   * The faults that the page finds itself.
   * @returns {{pointer: string, detail: string}[]}
   */
  faults() {
    /** @type {{pointer: string, detail: string}[]} */
    const faults = [];
    for (const { select, values } of this.axes.filter((axis) => axis.select.value)) {
      const { values: given, fault } = read(values.value, select.value);
      const detail = fault || (count(given) ? "" : "Values are needed: a list, or a range.");
      if (detail) faults.push({ pointer: gridPointer(select.value), detail });
    }
    const seeds = this.seeds.value.trim();
    const detail = /^[1-9]\d*$/.test(seeds) ? faultOf(seeds) : "A whole number from 1 on is needed.";
    if (detail) faults.push({ pointer: "/replicates", detail });
    return faults;
  }

  /**
   * Shows faults of the study's own fields; gives back the others. What a varied field is refused for belongs to the
   * values that it is given here.
   * @param {{pointer?: string, detail: string}[]} faults
   */
  mark(faults) {
    /** @type {Record<string, string>} */
    const found = {};
    const others = faults.filter(({ pointer = "", detail }) => {
      const isAt = (/** @type {string} */ place) => `${pointer}/`.startsWith(`${place}/`);
      const axis = this.axes.findIndex(
        ({ select: { value } }) => value && (isAt(gridPointer(value)) || isAt(value)) && !this.place.hidden,
      );
      const id = axis >= 0 ? `values-${axis}` : pointer === "/replicates" ? "seeds" : "";
      if (id) found[id] ??= detail;
      return !id;
    });
    for (const field of [...this.axes.map(({ values }) => values), this.seeds]) {
      text(/** @type {Element} */ (document.getElementById(`${field.id}-fault`)), found[field.id] ?? "");
      if (found[field.id]) field.setAttribute("aria-invalid", "true");
      else field.removeAttribute("aria-invalid");
    }
    return others;
  }
}
