/** Files of a result by the program that reads them: the grains in each format, and exports that the server makes. */
import { absolute } from "./address.js";
import { get, request as ask, send } from "./api.js";
import { confirmDeletion } from "./deletion.js";
import { badge, bytes, h, number, percent, replace, text } from "./dom.js";
import { fields } from "./export-options.js";
import { keyOf, PROGRAMS, SOLID, wordsOf } from "./job-programs.js";
import { qualityOf } from "./job-quality.js";
import { announce, report as problem } from "./shell.js";

/** Where the browser keeps which program was chosen last. */
const KEPT = "packstone-program";
/** The files that are not made without materials. */
const NEED_MATERIALS = new Set(["deck zip", "voxels zip fans"]);
/** Materials to start from where the request has none: a mortar with stiff grains. */
const MATERIALS =
  '{"matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2}, ' +
  '"aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2}}';
/**
 * The materials that a file needs to be made without those of a request.
 * @param {import("./job-programs.js").File} file
 */
export const materialsFor = (file) => (NEED_MATERIALS.has(keyOf(file)) ? MATERIALS : null);
/** What is said of them. */
const ASSUMED =
  " The request has no materials: a mortar of 25 GPa and grains of 70 GPa are assumed. Change them under Options.";
/** What is said of a mesh of surfaces. */
const NO_SOLID = "Surfaces alone, without solid elements. For a solid mesh choose ";

/** The value of an option, which has spaces to be broken at. @param {any} value @returns {string} */
function inWords(value) {
  if (typeof value !== "object") return String(value);
  const parts = Object.entries(value).map(([name, part]) => `${name} ${inWords(part)}`);
  return `(${parts.join(", ")})`;
}

/** The program that was chosen last. */
function lastChosen() {
  try {
    return localStorage.getItem(KEPT) ?? "";
  } catch {
    return "";
  }
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
    this.shapes = Boolean(report.shapes);
    this.program = PROGRAMS.find(({ name }) => name === lastChosen()) ?? PROGRAMS[0];
    this.made = fields([], () => {});
    this.kind = h("select", { id: "export-kind", onchange: () => this.#options() });
    this.options = h("div", { class: "options" });
    this.note = h("p", { class: "hint note" });
    this.estimate = h("div", { class: "hint estimate", role: "status" });
    this.fault = h("p", { class: "fault", role: "alert" });
    this.links = h("div", { class: "links" });
    this.list = h("div", {});
    this.details = h("details", {}, h("summary", {}, "Options"), this.options);
    this.form = h(
      "form",
      {
        class: "stack tight",
        onsubmit: (/** @type {Event} */ event) => {
          event.preventDefault();
          this.#start();
        },
      },
      h(
        "div",
        { class: "row" },
        h("div", { class: "field" }, h("label", { for: "export-kind" }, "File"), this.kind),
        h("button", { type: "submit", id: "make-file" }, "Make the file"),
      ),
      this.note,
      this.estimate,
      this.details,
      this.fault,
    );
    this.choices = h("span", { class: "choices", role: "radiogroup", "aria-labelledby": "exports-title" });
    this.element = h(
      "section",
      { class: "panel stack", "aria-labelledby": "exports-title" },
      h("h2", { id: "exports-title" }, "Files by program"),
      this.choices,
      this.links,
      this.form,
      this.list,
    );
  }

  async start() {
    const { exports } = await get("/v1/capabilities");
    /** The options of each type and format that the server knows. @type {Map<string, string[]>} */
    this.known = new Map(
      exports.flatMap((/** @type {any} */ e) =>
        e.formats.map((/** @type {any} */ f) => [`${e.type} ${f.name}`, f.options]),
      ),
    );
    replace(
      this.choices,
      PROGRAMS.map((program) =>
        h(
          "label",
          {},
          h("input", {
            type: "radio",
            name: "program",
            value: program.name,
            checked: program === this.program,
            onchange: () => this.#choose(program),
          }),
          program.name,
        ),
      ),
    );
    this.#choose(this.program);
    await this.refresh();
  }

  /** Shows the files for a program. @param {import("./job-programs.js").Program} program */
  #choose(program) {
    this.program = program;
    try {
      localStorage.setItem(KEPT, program.name);
    } catch {
      // Without storage the first program is chosen next time.
    }
    replace(this.links, this.#grains(program.grains));
    const fits = program.files.filter(
      ({ type, format }) =>
        this.known?.has(`${type} ${format}`) && (this.shapes || (type !== "shapes" && type !== "certificates")),
    );
    replace(
      this.kind,
      fits.map((file) => h("option", { value: keyOf(file) }, `${file.words} (${file.format})`)),
    );
    this.form.hidden = fits.length === 0;
    if (fits.length) this.#options();
  }

  /** Links to the grains in some formats, with the lengths of the files. @param {[string, string][]} formats */
  #grains(formats) {
    return formats
      .filter(([format]) => this.job.result.formats.includes(format))
      .map(([format, words]) => {
        const size = h("span", {}, words);
        const href = absolute(`${this.job.links.result}?format=${format}`);
        ask("GET", href, undefined, { headers: { range: "bytes=0-0" } }).then(
          (answer) => {
            const total = Number(answer.headers.get("content-range")?.split("/")[1]);
            answer.body?.cancel();
            if (total) text(size, `${words}, ${bytes(total)}`);
          },
          () => {},
        );
        return h("a", { class: "button", href, download: "" }, format.toUpperCase(), " ", size);
      });
  }

  /** The file that is chosen. */
  #chosen() {
    return this.program.files.find((file) => keyOf(file) === this.kind.value) ?? this.program.files[0];
  }

  /** What is to be made: type, format and options. */
  #wanted() {
    const { type, format, set = {} } = this.#chosen();
    return { type, format, ...this.made.values(), ...set };
  }

  #options() {
    const file = this.#chosen();
    const { type, format } = file;
    const names = this.known?.get(`${type} ${format}`) ?? [];
    // What makes one file of a format another one is no option of it.
    const free = names.filter((name) => name !== "for" && !(type === "mesh" && name === "elements"));
    const made = file.surface ? free.filter((name) => !/^(order|tet_|target_)/.test(name)) : free;
    this.made = fields(made, () => this.#estimate());
    const { elements } = this.made;
    replace(this.options, elements.length ? elements : h("p", { class: "hint" }, "This file has no options."));
    const materials = /** @type {HTMLTextAreaElement | null} */ (this.options.querySelector("#option-materials"));
    const assumed = Boolean(materials && !this.request.materials && NEED_MATERIALS.has(keyOf(file)));
    if (materials && assumed) materials.value = MATERIALS;
    const solid = () => {
      const gmsh = /** @type {import("./job-programs.js").Program} */ (PROGRAMS.find(({ name }) => name === "Gmsh"));
      const radio = /** @type {HTMLInputElement} */ (this.choices.querySelector("[value=Gmsh]"));
      radio.checked = true;
      this.#choose(gmsh);
      this.kind.value = SOLID;
      this.#options();
      this.kind.focus();
    };
    replace(
      this.note,
      file.note,
      assumed && ASSUMED,
      file.surface && NO_SOLID,
      file.surface && h("button", { type: "button", class: "quiet", onclick: solid }, "Solid mesh: tetrahedra"),
    );
    this.#estimate();
  }

  /** Asks how long the file is likely to be. */
  #estimate() {
    clearTimeout(this.timer);
    this.timer = setTimeout(async () => {
      this.asking?.abort();
      this.asking = new AbortController();
      const { signal } = this.asking;
      try {
        const plan = await send("POST", "/v1/plans", { ...this.request, postprocess: [this.#wanted()] }, { signal });
        const { estimate } = plan.exports[0];
        const { mesh } = estimate;
        const parts = [
          `About ${bytes(estimate.bytes)}`,
          mesh && `${number(mesh.triangles, 2)} triangles`,
          mesh?.tetrahedra && `${number(mesh.tetrahedra, 2)} tetrahedra`,
        ];
        const warnings = estimate.warnings ?? [];
        replace(
          this.estimate,
          [parts.filter(Boolean).join(", "), ...warnings].map((words) => h("p", {}, words)),
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
    const { type, ...options } = this.#wanted();
    const query = new URLSearchParams(
      Object.entries(options).map(([k, v]) => [k, typeof v === "object" ? JSON.stringify(v) : String(v)]),
    );
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
            "ul",
            { class: "files", "aria-label": "Files that were made" },
            made.map((/** @type {any} */ e) => this.#row(e)),
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
      const also = "It can be made again from the result.";
      if (!running && !(await confirmDeletion({ one: "file", size: item.bytes, also }))) return;
      await send("DELETE", item.links.file)
        .then(() => this.refresh())
        .catch(problem);
    };
    const share = item.state === "running" && item.progress ? ` ${percent(item.progress.fraction)}` : "";
    const file = wordsOf(item.options);
    const figures = item.report ? qualityOf(item.report) : [];
    const warnings = item.report?.warnings ?? [];
    return h(
      "li",
      {},
      h(
        "div",
        { class: "file" },
        h("strong", {}, file ? `${file.name}: ${file.words}` : `${type} (${format})`),
        " ",
        badge(item.state),
        share,
        item.bytes !== null && h("span", { class: "muted" }, ` ${bytes(item.bytes)}`),
        given.length > 0 && h("p", { class: "hint" }, given.join(", ")),
        figures.length > 0 &&
          h(
            "dl",
            { class: "quality" },
            figures.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))),
          ),
        item.error ? h("p", { class: "fault" }, item.error.detail) : null,
        item.links.script &&
          h(
            "p",
            { class: "hint" },
            "Surfaces alone: save the script beside the mesh, and gmsh -3 NAME.msh.geo fills it with tetrahedra.",
          ),
        warnings.map((/** @type {string} */ words) => h("p", { class: "hint" }, words)),
      ),
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
    );
  }
}
