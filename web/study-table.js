/**
 * The table of a study's points, sorted by any column and shown a hundred rows at a time, so that ten thousand points
 * cost what a hundred cost. The jobs of a point are looked up when they are asked for: a listing has no filter for it.
 */
import { absolute } from "./address.js";
import { get } from "./api.js";
import { badge, duration, h, number, percent, quantity, replace } from "./dom.js";
import { partialBadge } from "./job-ends.js";
import { report } from "./shell.js";

const PAGE = 100;

/** @typedef {{key: string, name: string, show: (row: any) => string, value: (row: any) => any}} Column */

/** @type {[string, string, (value: any) => string][]} The figures of a point: member, head, notation. */
const FIGURES = [
  ["runs", "Runs", (value) => number(value, 1)],
  ["success_rate", "Success", (value) => percent(value)],
  ["partial", "Partial", (value) => number(value, 1)],
  ["volume_fraction_reached_median", "Reached", (value) => percent(value, 1)],
  ["grains", "Grains", (value) => number(value, 4)],
  ["volume_fraction_effective", "Placed", (value) => percent(value, 1)],
  ["time_s_median", "Time", (value) => duration(value)],
  ["time_s_per_success", "Time per success", (value) => duration(value)],
  ["distance_mm_median", "Distance", (value) => quantity(value, "mm", 3)],
  ["youngs_modulus_gpa_mean", "Young's modulus", (value) => quantity(value, "GPa", 4)],
  ["youngs_modulus_gpa_std", "Deviation", (value) => quantity(value, "GPa", 2)],
  ["poissons_ratio_mean", "Poisson's ratio", (value) => number(value, 3)],
  ["expansion_1_k_mean", "Expansion", (value) => quantity(value, "1/K", 4)],
  ["conductivity_w_m_k_mean", "Conductivity", (value) => quantity(value, "W/(m K)", 4)],
  ["diffusivity_m2_s_mean", "Diffusivity", (value) => quantity(value, "m\u00b2/s", 4)],
  ["waiting", "Waiting", (value) => number(value, 1)],
  ["properties_waiting", "Properties waiting", (value) => number(value, 1)],
];

/**
 * A value of a varied field: of an object its type and its other members. Seeds are names rather than amounts.
 * @param {any} value
 * @param {string} [name] of the field
 * @returns {string}
 */
export function words(value, name = "") {
  if (typeof value === "number") return name.endsWith("seed") ? String(value) : number(value, 6);
  if (typeof value !== "object" || value === null) return String(value);
  if (Array.isArray(value)) return JSON.stringify(value);
  const { type, ...others } = value;
  const members = Object.entries(others).map(([name, member]) => `${columnName(name)} ${words(member, name)}`);
  return [type, ...members].filter(Boolean).join(", ");
}

/** What a varied field is called. @param {string} column a JSON pointer, or a name */
export const columnName = (column) => (column.split("/").at(-1) ?? column).replaceAll("_", " ");

/** The 95 % interval of a success rate. @param {any} row */
const interval = (row) =>
  row.runs ? ` (${Math.round(100 * row.success_rate_low)} to ${Math.round(100 * row.success_rate_high)})` : "";

export class StudyTable {
  /**
   * @param {HTMLElement} place
   * @param {string} path of the study in the interface
   */
  constructor(place, path) {
    this.place = place;
    this.path = path;
    /** @type {any[]} */
    this.rows = [];
    /** @type {Column[]} */
    this.columns = [];
    this.sorted = { key: "", down: false };
    this.from = 0;
  }

  /** Shows a table. @param {any} table @param {boolean} finished */
  set(table, finished) {
    this.rows = table.rows.map((/** @type {any} */ row, /** @type {number} */ index) => ({ ...row, "~point": index }));
    const has = (/** @type {string} */ key) => this.rows.some((row) => row[key] !== null && row[key] !== undefined);
    this.columns = [
      { key: "~point", name: "Point", show: (row) => String(row["~point"]), value: (row) => row["~point"] },
      ...table.columns.map((/** @type {string} */ key) => ({
        key,
        name: columnName(key).replace(/^./, (first) => first.toUpperCase()),
        show: (/** @type {any} */ row) => words(row[key], key),
        value: (/** @type {any} */ row) => row[key],
      })),
      ...FIGURES.filter(
        ([key]) =>
          has(key) &&
          (key !== "waiting" || !finished) &&
          (key !== "properties_waiting" || this.rows.some((row) => row.properties_waiting > 0)) &&
          (key !== "partial" || this.rows.some((row) => row.partial > 0)),
      ).map(([key, name, show]) => ({
        key,
        name,
        value: (/** @type {any} */ row) => row[key],
        show: (/** @type {any} */ row) => show(row[key]) + (key === "success_rate" ? interval(row) : ""),
      })),
    ];
    this.#show();
  }

  /** @param {string} key */
  #sort(key) {
    this.sorted = { key, down: this.sorted.key === key && !this.sorted.down };
    this.from = 0;
    this.#show();
    const heads = /** @type {NodeListOf<HTMLElement>} */ (this.place.querySelectorAll("th button"));
    heads[this.columns.findIndex((column) => column.key === key)]?.focus();
  }

  /** @param {number} from */
  #turn(from) {
    this.from = from;
    this.#show();
    /** @type {HTMLElement | null} */ (this.place.querySelector(".table"))?.focus();
  }

  #show() {
    const { key, down } = this.sorted;
    const column = this.columns.find((one) => one.key === key);
    const order = column
      ? [...this.rows].sort((a, b) => compare(column.value(a), column.value(b)) * (down ? -1 : 1))
      : this.rows;
    const shown = order.slice(this.from, this.from + PAGE);
    const keepsFocus =
      this.place.contains(document.activeElement) && document.activeElement?.getAttribute("aria-label");
    const scrolled = this.place.querySelector(".table")?.scrollLeft ?? 0;
    const isNumber = (/** @type {Column} */ one) =>
      this.rows.every(
        (row) => (typeof one.value(row) !== "string" && typeof one.value(row) !== "object") || one.value(row) === null,
      );
    const classes = new Map(this.columns.map((one) => [one, isNumber(one) ? "number" : ""]));
    const table = h(
      "table",
      {},
      h(
        "thead",
        {},
        h(
          "tr",
          {},
          ...this.columns.map((one) =>
            h(
              "th",
              {
                scope: "col",
                class: classes.get(one),
                "aria-sort": one === column ? (down ? "descending" : "ascending") : "none",
              },
              h("button", { type: "button", onclick: () => this.#sort(one.key) }, one.name),
            ),
          ),
          h("th", { scope: "col" }, "Jobs"),
        ),
      ),
      h(
        "tbody",
        {},
        ...shown.map((row) =>
          h(
            "tr",
            {},
            ...this.columns.map((one, index) =>
              h(
                index ? "td" : "th",
                index ? { class: classes.get(one) } : { scope: "row", class: "number" },
                one.show(row),
              ),
            ),
            h(
              "td",
              {},
              h(
                "button",
                {
                  type: "button",
                  class: "quiet",
                  "aria-label": `Jobs of point ${row["~point"]}`,
                  onclick: () => this.#jobs(row["~point"]).catch(report),
                },
                "Jobs",
              ),
            ),
          ),
        ),
      ),
    );
    const end = Math.min(this.from + PAGE, this.rows.length);
    replace(
      this.place,
      h("div", { class: "table", tabindex: "0", role: "region", "aria-label": "Points of the study" }, table),
      this.rows.length > PAGE &&
        h(
          "div",
          { class: "actions" },
          h(
            "button",
            { type: "button", disabled: this.from === 0, onclick: () => this.#turn(this.from - PAGE) },
            "Previous",
          ),
          h(
            "button",
            { type: "button", disabled: end >= this.rows.length, onclick: () => this.#turn(this.from + PAGE) },
            "Next",
          ),
          h(
            "span",
            { class: "muted" },
            `${number(this.from + 1, 1)} to ${number(end, 1)} of ${number(this.rows.length, 1)} points`,
          ),
        ),
    );
    const region = this.place.querySelector(".table");
    if (region) region.scrollLeft = scrolled;
    if (keepsFocus)
      /** @type {HTMLElement | null} */ (this.place.querySelector(`[aria-label="${CSS.escape(keepsFocus)}"]`))?.focus();
  }

  /** Shows the jobs of a point in a dialog. @param {number} point */
  async #jobs(point) {
    const list = h("ul", { class: "stack tight plain" }, h("li", { class: "muted" }, "Looking them up"));
    const dialog = h(
      "dialog",
      { class: "small", "aria-labelledby": "jobs-title" },
      h("h2", { id: "jobs-title" }, `Jobs of point ${point}`),
      list,
      h("div", { class: "actions" }, h("button", { type: "button", onclick: () => dialog.close() }, "Close")),
    );
    dialog.addEventListener("close", () => dialog.remove());
    document.body.append(dialog);
    dialog.showModal();
    /** @type {any[]} */
    const found = [];
    for (let cursor = ""; cursor !== null && dialog.isConnected;) {
      const page = await get(`${this.path}/jobs?sort=created&limit=500${cursor && `&cursor=${cursor}`}`);
      found.push(...page.items.filter((/** @type {any} */ job) => job.point === point));
      cursor = page.next_cursor;
    }
    replace(
      list,
      ...found.map((job) =>
        h(
          "li",
          {},
          h("a", { href: absolute(`/jobs/${job.id}`) }, `Seed ${job.seed}`),
          " ",
          badge(job.state, job),
          " ",
          partialBadge(job.result?.summary),
        ),
      ),
      !found.length && h("li", {}, "The jobs of this point were deleted."),
    );
    // The first seeds that were packed, as many as are compared.
    const packed = found.filter((job) => job.state === "succeeded").slice(0, 4);
    if (packed.length < 2) return;
    const seeds = packed.map((job) => job.id).join(",");
    const words = packed.length < found.length ? `Compare ${packed.length} of them` : "Compare them";
    dialog.lastElementChild?.prepend(h("a", { class: "button", href: absolute(`/compare?jobs=${seeds}`) }, words));
  }
}

/** @param {any} a @param {any} b */
function compare(a, b) {
  if (a === b) return 0;
  if (a === null || a === undefined) return 1;
  if (b === null || b === undefined) return -1;
  if (typeof a === "number" && typeof b === "number") return a - b;
  return words(a) < words(b) ? -1 : 1;
}
