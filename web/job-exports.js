/** Files of a result: the grains in each format, and exports that the server makes on request. */
import { absolute } from "./address.js";
import { get, request as ask, send } from "./api.js";
import { badge, bytes, h, number, percent, replace, text } from "./dom.js";
import { fields, FORMATS, TYPES } from "./export-options.js";
import { announce, confirm, report as problem } from "./shell.js";

/** @type {Record<string, string>} */
const GRAINS = {
  csv: "table",
  json: "with all figures",
  npy: "NumPy",
  vtp: "ParaView",
  vtk: "VTK, legacy",
  html: "viewer",
};

/**
 * Links to the grains, with the lengths of the files.
 * @param {any} job
 */
export function downloadPart(job) {
  const links = job.result.formats
    .filter((/** @type {string} */ f) => GRAINS[f])
    .map((/** @type {string} */ format) => {
      const size = h("span", {}, GRAINS[format]);
      const href = absolute(`${job.links.result}?format=${format}`);
      ask("GET", href, undefined, { headers: { range: "bytes=0-0" } }).then(
        (answer) => {
          const total = Number(answer.headers.get("content-range")?.split("/")[1]);
          answer.body?.cancel();
          if (total) text(size, `${GRAINS[format]}, ${bytes(total)}`);
        },
        () => {},
      );
      return h("a", { class: "button", href, download: "" }, format.toUpperCase(), " ", size);
    });
  return h(
    "section",
    { class: "panel", "aria-labelledby": "files-title" },
    h("h2", { id: "files-title" }, "Grains as a file"),
    h("div", { class: "links" }, links),
  );
}

/** The value of an option, which has spaces to be broken at. @param {any} value @returns {string} */
function inWords(value) {
  if (typeof value !== "object") return String(value);
  const parts = Object.entries(value).map(([name, part]) => `${name} ${inWords(part)}`);
  return `(${parts.join(", ")})`;
}

export class ExportPart {
  /**
   * @param {any} job
   * @param {any} request
   * @param {any} report
   */
  constructor(job, request, report) {
    this.job = job;
    this.request = request;
    this.kind = h("select", { id: "export-kind", onchange: () => this.#options() });
    this.options = h("div", { class: "options" });
    this.estimate = h("div", { class: "hint estimate", role: "status" });
    this.fault = h("p", { class: "fault", role: "alert" });
    this.list = h("div", {});
    this.shapes = Boolean(report.shapes);
    this.made = fields([], () => {});
    this.details = h("details", {}, h("summary", {}, "Options"), this.options);
    const form = h(
      "form",
      {
        class: "stack",
        onsubmit: (/** @type {Event} */ event) => {
          event.preventDefault();
          this.#start();
        },
      },
      h(
        "div",
        { class: "row" },
        h("div", { class: "field" }, h("label", { for: "export-kind" }, "File"), this.kind),
        h("button", { type: "submit" }, "Make the file"),
      ),
      this.estimate,
      this.details,
      this.fault,
    );
    this.element = h(
      "section",
      { class: "panel stack", "aria-labelledby": "exports-title" },
      h("h2", { id: "exports-title" }, "Meshes and models"),
      form,
      this.list,
    );
  }

  async start() {
    const { exports } = await get("/v1/capabilities");
    /** @type {{type: string, format: string, options: string[]}[]} */
    this.kinds = exports.flatMap((/** @type {any} */ e) =>
      e.formats.map((/** @type {any} */ f) => ({ type: e.type, format: f.name, options: f.options })),
    );
    const fits = this.kinds.filter(
      ({ type, format }) =>
        // Pictures of cuts have a part of the page of their own.
        (type !== "slice" || ["msh", "inp", "vtu"].includes(format)) &&
        (this.shapes || (type !== "shapes" && type !== "certificates")),
    );
    const groups = [...new Set(fits.map(({ type }) => type))];
    replace(
      this.kind,
      groups.map((type) =>
        h(
          "optgroup",
          { label: TYPES[type] ?? type },
          fits
            .filter((f) => f.type === type)
            .map((f) =>
              h(
                "option",
                { value: `${type} ${f.format}` },
                `${TYPES[type] ?? type}: ${FORMATS[f.format] ?? f.format} (${f.format})`,
              ),
            ),
        ),
      ),
    );
    this.#options();
    await this.refresh();
  }

  #chosen() {
    const [type = "", format = ""] = this.kind.value.split(" ");
    return { type, format };
  }

  #options() {
    const { type, format } = this.#chosen();
    const names = this.kinds?.find((k) => k.type === type && k.format === format)?.options ?? [];
    this.made = fields(names, () => this.#estimate(), format);
    const { elements } = this.made;
    replace(this.options, elements.length ? elements : h("p", { class: "hint" }, "This file has no options."));
    this.#estimate();
  }

  /** Asks how long the file is likely to be. */
  #estimate() {
    clearTimeout(this.timer);
    this.timer = setTimeout(async () => {
      const wanted = { ...this.#chosen(), ...this.made.values() };
      this.asking?.abort();
      this.asking = new AbortController();
      const { signal } = this.asking;
      try {
        const plan = await send("POST", "/v1/plans", { ...this.request, postprocess: [wanted] }, { signal });
        const { estimate } = plan.exports[0];
        const mesh = estimate.mesh ? `, ${number(estimate.mesh.triangles, 2)} triangles` : "";
        replace(
          this.estimate,
          [`About ${bytes(estimate.bytes)}${mesh}`, ...(estimate.warnings ?? [])].map((words) => h("p", {}, words)),
        );
        this.#fail();
      } catch (error) {
        if (signal.aborted) return;
        replace(this.estimate);
        this.#fail(error);
      }
    }, 200);
  }

  /** Shows each fault at its field, and the others below; none takes them away. @param {any} [error] */
  #fail({ errors = [], message = "" } = {}) {
    const faults = errors.map((/** @type {import("./api.js").Fault} */ { pointer, parameter, detail }) => ({
      name: parameter ?? /^\/postprocess\/0\/(\w+)/.exec(pointer ?? "")?.[1] ?? "",
      detail,
    }));
    const others = this.made.mark(faults);
    const atField = this.options.querySelector("[aria-invalid=true]");
    if (atField) this.details.open = true;
    text(this.fault, errors.length || atField ? others.join("; ") : message);
  }

  async #start() {
    const { type, format } = this.#chosen();
    const query = new URLSearchParams({
      format,
      ...Object.fromEntries(
        Object.entries(this.made.values()).map(([k, v]) => [k, typeof v === "object" ? JSON.stringify(v) : String(v)]),
      ),
    });
    this.#fail();
    /** @type {HTMLElement | null} */
    const wrong = this.options.querySelector("[aria-invalid=true]");
    if (wrong) return wrong.focus();
    try {
      await send("POST", `${this.job.links.exports}/${type}?${query}`);
      announce("The export is being made");
      await this.refresh();
    } catch (error) {
      this.#fail(error);
    }
  }

  /** Shows the exports that the job has, and looks again while one is being made. */
  async refresh() {
    clearTimeout(this.again);
    if (!this.element.isConnected) return;
    const { items } = await get(this.job.links.exports);
    const made = items.filter((/** @type {any} */ e) => e.kept || e.type !== "slice" || e.report?.triangles);
    const open = made.some((/** @type {any} */ e) => e.state === "queued" || e.state === "running");
    const focus = document.activeElement?.getAttribute("data-of");
    replace(
      this.list,
      made.length
        ? h(
            "div",
            { class: "table" },
            h(
              "table",
              {},
              h(
                "thead",
                {},
                h(
                  "tr",
                  {},
                  ["File", "State", "Length", ""].map((name) =>
                    h("th", { scope: "col" }, name || h("span", { class: "visually-hidden" }, "Actions")),
                  ),
                ),
              ),
              h(
                "tbody",
                {},
                made.map((/** @type {any} */ e) => this.#row(e)),
              ),
            ),
          )
        : [],
    );
    if (focus) /** @type {HTMLElement | null} */ (this.list.querySelector(`[data-of="${CSS.escape(focus)}"]`))?.focus();
    if (open) {
      this.busy = true;
      this.again = setTimeout(() => this.refresh().catch(problem), 1000);
    } else if (this.busy) {
      this.busy = false;
      announce("The export is finished");
    }
  }

  /** @param {any} item an export */
  #row(item) {
    const { type, format, ...options } = item.options;
    const given = Object.entries(options)
      .filter(([, v]) => v !== null)
      .map(([k, v]) => `${k} ${inWords(v)}`);
    const remove = async () => {
      const running = item.state === "queued" || item.state === "running";
      const words = "It can be made again from the result.";
      if (!running && !(await confirm("Delete this file?", words, "Delete file"))) return;
      await send("DELETE", item.links.file)
        .then(() => this.refresh())
        .catch(problem);
    };
    const share = item.state === "running" && item.progress ? ` ${percent(item.progress.fraction)}` : "";
    return h(
      "tr",
      {},
      h(
        "td",
        {},
        h("strong", {}, `${TYPES[type] ?? type}: ${FORMATS[format] ?? format}`),
        h("div", { class: "hint" }, given.join(", ")),
        item.error ? h("div", { class: "fault" }, item.error.detail) : null,
        item.links.script &&
          h(
            "div",
            { class: "hint" },
            "Save the script beside the mesh: gmsh -3 NAME.msh.geo fills it with tetrahedra.",
          ),
        (item.report?.warnings ?? []).map((/** @type {string} */ w) => h("div", { class: "hint" }, w)),
      ),
      h("td", {}, badge(item.state), share),
      h("td", { class: "number" }, bytes(item.bytes)),
      h(
        "td",
        {},
        h(
          "div",
          { class: "actions" },
          item.state === "succeeded"
            ? [
                h(
                  "a",
                  {
                    class: "button",
                    href: absolute(item.links.file),
                    download: "",
                    "data-of": `get ${item.links.self}`,
                  },
                  "Download",
                ),
                item.links.script &&
                  h("a", { class: "button", href: absolute(item.links.script), download: "" }, "Script for Gmsh"),
              ]
            : [],
          h(
            "button",
            { type: "button", class: "quiet", onclick: remove, "data-of": `delete ${item.links.self}` },
            item.state === "running" || item.state === "queued" ? "Cancel" : "Delete",
          ),
        ),
      ),
    );
  }
}
