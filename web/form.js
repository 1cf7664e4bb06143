/**
 * The page with the form. The request is read from the fields at every change; 150 ms after the last one its plan is
 * asked for and shown beside the form, and answers that are overtaken are dropped. The address holds the request
 * (`form-address.js`).
 */
import { absolute } from "./address.js";
import { get, Problem, request as ask, send } from "./api.js";
import { byId, duration, h, number, percent, replace, text } from "./dom.js";
import { address, requestOf } from "./form-address.js";
import { CodePart } from "./form-code.js";
import { offerStandards } from "./form-standards.js";
import { addAggregate, areMasses, removeAggregate } from "./form-aggregates.js";
import { drawing } from "./form-drawing.js";
import { Fields } from "./form-fields.js";
import { offerHelp } from "./form-help.js";
import { materialFields } from "./form-materials.js";
import { grains, showFaults, showPlan } from "./form-plan.js";
import { getAt, removeAt, setAt } from "./form-pointer.js";
import { mixWith, Tables } from "./form-tables.js";
import { report, shell } from "./shell.js";

/** Time after the last change until the plan is asked for, in ms. */
const PAUSE = 150;

/** A cube of A16 aggregate that packs in less than a second. */
const START = {
  specimen: { type: "box", size_mm: [100, 100, 100] },
  mix: { grading: { type: "standard", name: "A16" }, d_min_mm: 2, volume_fraction: 0.6 },
};

/** @typedef {{pointer?: string, detail: string}} Fault */

const form = byId("form");
const answer = byId("answer");
const panel = /** @type {HTMLElement} */ (answer.closest("section"));
const submit = /** @type {HTMLButtonElement} */ (byId("submit"));
const materials = /** @type {HTMLDetailsElement} */ (byId("materials"));
replace(byId("material-fields"), materialFields());
const fields = new Fields(/** @type {HTMLFormElement} */ (form));
fields.take = (control, value) => {
  control.value = value;
  changed();
  control.focus();
};
/** The part for studies, which is loaded when a study is chosen. @type {import("./form-study.js").StudyPart | null} */
let study = null;
/** The study that it shows at first. @type {any} */
let given = { grid: {}, replicates: 10 };
const tables = new Tables(form, takeMix, () => changed());
const code = new CodePart(byId("code"), (request) => fill(request));

/** @type {import("./form-standards.js").Standard[]} */
let standards = [];
/** The largest grain of the last plan, in mm. @type {number | null} */
let largest = null;
/** @type {{name: string, about: string}[]} */
let presets = [];
/** @type {AbortController | null} */
let asking = null;
let timer = 0;
/** Whether a plan could not be had; what else is reported stays when the next one comes. */
let unplanned = false;
/** The key under which the request is submitted; a request that is sent twice makes one job. */
let idempotency = { body: "", key: "" };

/** @param {import("./form-fields.js").Control} control */
function labelOf(control) {
  const unit = control.parentElement?.querySelector(".unit")?.textContent;
  const aggregate = control.closest(".aggregate")?.querySelector("legend")?.textContent;
  const label = control.ariaLabel ?? control.labels?.[0]?.textContent ?? control.id;
  return `${aggregate ? `${aggregate}: ` : ""}${label}${unit ? `, ${unit}` : ""}`;
}

const runs = () => new FormData(/** @type {HTMLFormElement} */ (form)).get("runs");

/** Loads the part for studies, which offers the fields that are shown. */
async function loadStudy() {
  const { StudyPart } = await import("./form-study.js");
  study ??= new StudyPart(byId("study"), () =>
    fields.controls
      .filter(
        (control) =>
          !control.closest("[hidden]") &&
          (control.id === "method" ||
            (["number", "choice"].includes(control.dataset.kind ?? "") && control.id !== "seed")),
      )
      .map((control) => ({
        pointer: (control.dataset.path ?? "").replace("/method/type", "/method"),
        label: labelOf(control),
      })),
  );
  study.fill(given);
  changed();
}

/** What the form says: a job, or a study. */
function read() {
  const { request: job, faults } = fields.read();
  if (runs() !== "study" || !study) return { job, faults, request: job };
  return { job, faults: [...faults, ...study.faults()], request: study.read(job) };
}

/** Shows a request. @param {any} request */
function fill(request) {
  const isStudy = "template" in request;
  const job = isStudy
    ? { ...request.template, name: request.name ?? request.template?.name, seed: request.seed }
    : request;
  fields.fill(JSON.parse(JSON.stringify(job)));
  if (job?.materials) materials.open = true;
  given = isStudy ? request : { grid: {}, replicates: 10 };
  study?.fill(given);
  /** @type {HTMLInputElement} */ (form.querySelector(`[name="runs"][value="${isStudy ? "study" : "job"}"]`)).checked =
    true;
  changed();
}

/** Everything that follows from the fields at once; the plan comes later. */
function changed() {
  byId("study").hidden = runs() !== "study";
  fields.arrange();
  offerHelp(/** @type {Element} */ (form.firstElementChild));
  offerStandards(form, standards);
  clearTimeout(timer);
  asking?.abort();
  asking = null;
  panel.setAttribute("aria-busy", "true");
  if (runs() === "study" && !study) {
    loadStudy().catch(report);
    return;
  }
  study?.arrange();
  const { job, request } = read();
  for (const place of form.querySelectorAll(".about")) {
    const select = /** @type {HTMLSelectElement | null} */ (place.parentElement?.querySelector("[id$=preset]"));
    text(place, presets.find((preset) => preset.name === select?.value)?.about ?? "");
  }
  byId("volume_fraction").setAttribute("placeholder", areMasses(job.mix?.aggregates) ? "of the masses" : "");
  replace(byId("drawing"), drawing(job.specimen, largest));
  code.set(request);
  text(submit, runs() === "study" ? "Pack all" : "Pack");
  performance.mark("changed");
  timer = setTimeout(plan, PAUSE);
}

/** Shows the grains of each shape, and the members of the request that no field shows. @param {any} job */
async function showMore(job) {
  for (const place of /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll("[data-grains]"))) {
    const pointer = place.dataset.grains ?? "";
    const shape = getAt(job, pointer);
    if (place.closest("[hidden]") || !shape) continue;
    const { showShapes } = await import("./form-shapes.js");
    showShapes(place, shape, (other) => replaceWith((request) => setAt(request, pointer, other)));
  }
  const place = byId("others");
  const paths = fields.shown();
  const { withoutField, showMembers } = await import("./form-hidden.js");
  showMembers(place, withoutField(job, paths), (pointers) => {
    replaceWith((request) => pointers.forEach((pointer) => removeAt(request, pointer)));
    byId("submit").focus();
  });
}

/** Changes the request and shows it. @param {(request: any) => void} change */
function replaceWith(change) {
  const { request } = fields.read();
  change(request);
  fields.fill(request);
  changed();
}

/** Asks for the plan and shows it, or the faults. */
async function plan() {
  const { job, faults, request } = read();
  showMore(job).catch(report);
  if (location.hash || JSON.stringify(request) !== JSON.stringify(START))
    history.replaceState(null, "", address(request));
  if (faults.length) return fail(faults);
  const planned = runs() === "study" && study ? study.first(job, setAt) : { point: job, note: "" };
  const here = (asking = new AbortController());
  try {
    // The plan takes a while, in which what draws its curve is loaded.
    const [document, { chart }] = await Promise.all([
      send("POST", "/v1/plans", planned.point, { signal: here.signal }),
      import("./form-chart.js"),
    ]);
    if (here !== asking) return;
    fields.mark([]);
    study?.mark([]);
    // What the server decides is drawn as the server has it.
    const finest = document.classes[0]?.d_min_mm ?? null;
    largest = document.classes.at(-1)?.d_max_mm ?? null;
    const drawn = chart(document.curve ?? [], finest, planned.point.mix, standards, use);
    replace(byId("drawing"), drawing(planned.point.specimen, largest));
    byId("d_min").setAttribute("placeholder", job.mix?.aggregates || finest === null ? "" : number(finest));
    showPlan(answer, document, { request: job, note: planned.note, chart: drawn, use });
    replace(
      byId("forecast"),
      h("strong", {}, `${grains(document.grains)} grains`),
      `, ${duration(document.estimated_time_s)}` +
        (document.success_probability < 0.995 ? `, success ${percent(document.success_probability)}` : ""),
    );
    if (unplanned) report();
    unplanned = false;
  } catch (error) {
    if (here.signal.aborted) return;
    if (!(error instanceof Problem) || error.status === 0 || error.status === 401 || error.status >= 500) {
      report(error);
      unplanned = true;
      text(byId("forecast"), "");
    } else fail(error.errors.length ? error.errors : [{ detail: error.message }]);
  } finally {
    if (here === asking) panel.removeAttribute("aria-busy");
    performance.measure("answer", "changed");
  }
}

/** Shows faults: each at its field, the others in place of the plan. @param {Fault[]} faults */
function fail(faults) {
  const inTemplate = faults.map((fault) => ({ ...fault, pointer: fault.pointer?.replace(/^\/template(?=\/)/, "") }));
  const others = fields.mark(study ? study.mark(inTemplate) : inTemplate);
  if (materials.querySelector("[aria-invalid=true]")) materials.open = true;
  showFaults(answer, others, faults.length - others.length);
  const words = faults.length === 1 ? "One fault" : `${faults.length} faults`;
  replace(byId("forecast"), h("button", { type: "button", class: "quiet", onclick: first }, words));
  panel.removeAttribute("aria-busy");
}

/** Takes a value that is proposed. @param {string} pointer @param {number} value */
function use(pointer, value) {
  replaceWith((request) => {
    if (pointer === "/distance/gap_mm") setAt(request, "/distance/type", "constant");
    setAt(request, pointer, value);
  });
  fields.at(pointer)?.focus();
}

/** Takes the mix of a table. @param {any} mix */
function takeMix(mix) {
  replaceWith((request) => {
    request.mix = mixWith(request.mix, mix);
  });
}

/**
 * Changes the aggregates of the mix, and goes to a field.
 * @param {(mix: any) => any} change
 * @param {(mix: any) => string} field its id
 */
function aggregates(change, field) {
  const { request, faults } = fields.read();
  // What was typed there would be lost.
  if (faults.length) return fail(faults);
  request.mix = change(request.mix);
  fields.fill(request);
  changed();
  byId(field(request.mix)).focus();
}

/** Submits the job or the study, and goes to its page. */
async function run() {
  if (runs() === "study" && !study) return;
  const { request, faults } = read();
  clearTimeout(timer);
  if (faults.length) {
    fail(faults);
    return first();
  }
  submit.disabled = true;
  const isStudy = runs() === "study";
  const body = JSON.stringify(request);
  if (idempotency.body !== body) {
    const random = crypto.getRandomValues(new Uint8Array(16));
    idempotency = { body, key: Array.from(random, (byte) => byte.toString(16).padStart(2, "0")).join("") };
  }
  try {
    const headers = { "idempotency-key": idempotency.key };
    const accepted = await (await ask("POST", isStudy ? "/v1/studies" : "/v1/jobs", request, { headers })).json();
    idempotency = { body: "", key: "" };
    location.assign(absolute(`/${isStudy ? "studies" : "jobs"}/${accepted.id}`));
  } catch (error) {
    const known = error instanceof Problem && error.status >= 400 && error.status < 500 && error.errors.length;
    if (known) {
      fail(error.errors);
      first();
    } else report(error);
  } finally {
    submit.disabled = false;
  }
}

/** Goes to the first field with a fault, which says what is wrong. */
function first() {
  const field = /** @type {HTMLElement | null} */ (form.querySelector("[aria-invalid=true]"));
  field?.focus({ preventScroll: true });
  if (field) field.scrollIntoView({ block: "center" });
  else answer.scrollIntoView({ block: "nearest" });
}

/** Shows the request of the address, the example that it names, or the first request. */
async function start() {
  const name = new URLSearchParams(location.search).get("example");
  try {
    const example = name && !location.hash ? await (await import("./form-examples.js")).exampleOf(name) : null;
    fill(example ?? requestOf(location.hash) ?? START);
    report();
  } catch (error) {
    fill(START);
    report(error);
  }
}

shell();
form.addEventListener("input", (event) => {
  if (!tables.typed(event)) changed();
});
form.addEventListener("change", ({ target }) => {
  fields.tidy(target);
  changed();
});
byId("examples").addEventListener("click", () =>
  import("./form-examples.js").then(({ chooseExample }) => chooseExample(fill)).catch(report),
);
byId("add-aggregate").addEventListener("click", () =>
  aggregates(addAggregate, ({ aggregates: all }) => `aggregate-${all.length - 1}-${areMasses(all) ? "mass" : "share"}`),
);
byId("aggregates").addEventListener("click", (event) => {
  const i = /** @type {HTMLElement} */ (event.target).dataset.remove;
  if (i)
    aggregates(
      (mix) => removeAggregate(mix, Number(i)),
      (mix) => (mix.aggregates ? "add-aggregate" : "grading"),
    );
});
form.addEventListener("submit", (event) => {
  event.preventDefault();
  run();
});
// From any field, without the way through all the others.
form.addEventListener("keydown", (event) => {
  if (event.key !== "Enter" || !(event.ctrlKey || event.metaKey) || submit.disabled) return;
  event.preventDefault();
  run();
});
addEventListener("hashchange", start);
addEventListener("pageshow", (event) => {
  if (event.persisted) changed();
});
// An example is loaded first: nothing is planned before the fields are filled.
Promise.all([get("/v1/capabilities"), start()]).then(([capabilities]) => {
  standards = capabilities.standard_gradings;
  presets = capabilities.shape_presets;
  changed();
}, report);
get("/v1/key", { quiet: true }).then(
  (key) => {
    code.withKey = key.name !== null;
  },
  () => {},
);
