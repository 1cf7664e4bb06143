/** From a packing to an answer: its effective stiffness, and a model that a solver runs. */
import { absolute } from "./address.js";
import { get, request as ask, send } from "./api.js";
import { h, number, percent, quantity, replace, text } from "./dom.js";
import { numberOf } from "./numbers.js";
import { announce } from "./shell.js";

/** The materials that the fields show where the request has none: a mortar with stiff grains, E in GPa. */
const MATERIALS = { matrix: [25, 0.2], aggregate: [70, 0.2] };
/** Voxels along the longest edge: seconds, and a per cent. */
const CELLS = "64";

/** What the two actions make. @typedef {"properties" | "deck"} Kind */
/** @type {Record<Kind, Record<string, string>>} */
const OPTIONS = {
  properties: { kinds: "stiffness", cells: CELLS },
  deck: { solver: "calculix", load: "uniaxial_z" },
};

/** The properties of a report in words. @param {any} report @returns {[string, string][]} */
function answerOf(report) {
  const { stiffness, cell } = report;
  const { youngs_modulus_gpa: young, poissons_ratio: poisson } = stiffness.isotropic;
  const axes = stiffness.youngs_moduli_gpa?.map((/** @type {number} */ e) => number(e, 4)).join(", ");
  const { hashin_shtrikman_lower: lower, hashin_shtrikman_upper: upper } = stiffness.bounds;
  const bounds = [lower, upper].map(({ youngs_modulus_gpa: e }) => number(e, 4));
  return [
    ["Young's modulus", quantity(young, "GPa", 4)],
    ["Poisson's ratio", number(poisson, 3)],
    ["Along x, y, z", axes ? `${axes}\u202fGPa` : "none"],
    ["Bounds of Hashin and Shtrikman", `${bounds.join(" to ")}\u202fGPa`],
    ["Anisotropy", number(stiffness.universal_anisotropy ?? 0, 2)],
    ["Error of the voxels", percent(stiffness.error.voxels, 2)],
    ["Cell", `${cell.kind.replaceAll("_", " ")}, ${cell.voxels.join(" × ")} voxels`],
  ];
}

export class ModelPart {
  /**
   * @param {any} job
   * @param {any} request
   * @param {() => Promise<void>} changed called when an export was requested
   */
  constructor(job, request, changed) {
    this.job = job;
    this.request = request;
    this.changed = changed;
    /** @type {Record<string, [HTMLInputElement, HTMLInputElement]>} */
    this.inputs = {};
    this.actions = h("div", { class: "actions" });
    this.status = h("p", { class: "hint", role: "status" });
    this.fault = h("p", { class: "fault", role: "alert" });
    this.answer = h("div", {});
    this.element = h(
      "section",
      { class: "panel stack", "aria-labelledby": "model-title", hidden: true },
      h("h2", { id: "model-title" }, "Stiffness and models"),
      request.materials ? null : this.#fields(),
      this.actions,
      this.status,
      this.fault,
      this.answer,
    );
  }

  /** Shows what this service can make, and the latest stiffness that it has. */
  async start() {
    const { exports } = await get("/v1/capabilities");
    const has = (/** @type {Kind} */ kind) => exports.some((/** @type {any} */ e) => e.type === kind);
    const isBox = this.request.specimen.type === "box";
    const button = (/** @type {string} */ words, /** @type {Kind} */ kind) =>
      has(kind) && h("button", { type: "button", onclick: () => this.#make(kind) }, words);
    const buttons = [isBox && button("Stiffness", "properties"), button("Model for CalculiX", "deck")].filter(Boolean);
    replace(this.actions, buttons);
    this.element.hidden = buttons.length === 0;
    const { items } = await get(this.job.links.exports);
    const made = items.filter((/** @type {any} */ e) => e.type === "properties" && e.report?.stiffness);
    if (made.length) this.#show(made[0]);
  }

  /** Young's modulus and Poisson's ratio of matrix and grains. */
  #fields() {
    const field = (/** @type {string} */ phase, /** @type {number} */ place, /** @type {string} */ label) => {
      const id = `material-${phase}-${place}`;
      const value = MATERIALS[/** @type {"matrix" | "aggregate"} */ (phase)][place];
      const input = h("input", { id, inputmode: "decimal", value });
      const unit = place === 0 && h("span", { class: "unit" }, "GPa");
      const shown = unit ? h("div", { class: "with-unit" }, input, unit) : input;
      return { input, element: h("div", { class: "field" }, h("label", { for: id }, label), shown) };
    };
    const parts = Object.keys(MATERIALS).flatMap((phase) => {
      const name = phase === "matrix" ? "Matrix" : "Grains";
      const young = field(phase, 0, `${name}: Young's modulus`);
      const poisson = field(phase, 1, `${name}: Poisson's ratio`);
      this.inputs[phase] = [young.input, poisson.input];
      return [young.element, poisson.element];
    });
    return h("div", { class: "options" }, parts);
  }

  /** The materials of the fields; none where the request has its own. @returns {Record<string, string>} */
  #materials() {
    if (this.request.materials) return {};
    const materials = Object.fromEntries(
      Object.entries(this.inputs).map(([phase, [young, poisson]]) => [
        phase,
        { youngs_modulus_gpa: numberOf(young.value, "GPa"), poissons_ratio: numberOf(poisson.value) },
      ]),
    );
    return { materials: JSON.stringify(materials) };
  }

  /** Requests an export, and follows it to its end. @param {Kind} kind */
  async #make(kind) {
    text(this.fault, "");
    const query = new URLSearchParams({ ...OPTIONS[kind], ...this.#materials() });
    try {
      let item = await send("POST", `${this.job.links.exports}/${kind}?${query}`);
      await this.changed();
      while (this.element.isConnected && (item.state === "queued" || item.state === "running")) {
        const share = item.progress ? ` (${percent(item.progress.fraction)})` : "";
        text(this.status, `${kind === "deck" ? "The model is being made" : "The stiffness is being computed"}${share}`);
        const answer = await ask("GET", item.links.self, undefined, { headers: { prefer: "wait=1" } });
        item = await answer.json();
      }
      text(this.status, "");
      if (item.state === "failed") return text(this.fault, item.error.detail);
      if (kind === "properties") this.#show(item);
      else this.#offer(item);
      await this.changed();
    } catch (error) {
      text(this.status, "");
      const { errors = [], message } = /** @type {import("./api.js").Problem} */ (error);
      text(this.fault, errors.map(({ detail }) => detail).join("; ") || message);
    }
  }

  /** @param {any} item an export of properties */
  #show(item) {
    replace(
      this.answer,
      h(
        "dl",
        { class: "facts", "data-of": "stiffness" },
        answerOf(item.report).map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))),
      ),
    );
    announce("The stiffness is computed");
  }

  /** @param {any} item a deck */
  #offer(item) {
    replace(
      this.status,
      h("a", { class: "button", href: absolute(item.links.file), download: "" }, "Download the model"),
      " Unpack it and run ",
      h("code", {}, "packstone solve"),
      " on the file.",
    );
    announce("The model is made");
  }
}
