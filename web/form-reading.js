/**
 * Tables of gradings and recipes, pasted or in files: the service reads them (`POST /v1/mixes/read`), and what it
 * understood is shown as curves and tables with its notes. Where several readings fit, they stand side by side, and one
 * click chooses.
 */
import { Problem, send } from "./api.js";
import { byId, h, number, replace, text } from "./dom.js";
import { curve as drawn } from "./form-curve.js";

const MEANINGS = {
  passing: "passing",
  retained: "retained",
  cumulative_retained: "cumulative retained",
  mass: "mass retained",
  cumulative_mass: "cumulative mass retained",
  mass_passing: "mass passing",
};
const UNITS = {
  mm: "mm",
  um: "µm",
  in: "inches",
  us_sieve: "US sieve numbers",
  bs_mesh: "BS meshes",
  tyler_mesh: "Tyler meshes",
  phi: "phi",
};

/** The reading that each place waits for. @type {WeakMap<Element, AbortController>} */
const current = new WeakMap();

/** @param {any} note */
export const wordsOf = ({ line, cell, text: words }) =>
  cell ? `Cell ${cell}: ${words}` : line ? `Row ${line}: ${words}` : words.charAt(0).toUpperCase() + words.slice(1);

/** Stops waiting for a reading, and shows nothing. @param {Element} place */
export function clear(place) {
  current.get(place)?.abort();
  replace(place);
}

/**
 * Reads a table and shows what was understood.
 * @param {Element} place
 * @param {Blob} table
 * @param {(request: any) => void} take takes the part of a request that follows, at once or when it is chosen
 * @returns {Promise<string | null>} what keeps the table from being used now, if anything; `null` where another table
 *   was read meanwhile
 */
export async function read(place, table, take) {
  current.get(place)?.abort();
  const here = new AbortController();
  current.set(place, here);
  replace(place, h("p", { class: "hint" }, "The table is being read."));
  try {
    const reading = await send("POST", "/v1/mixes/read", table, { signal: here.signal });
    if (here.signal.aborted) return null;
    text(byId("announce"), summary(reading));
    show(place, reading, take);
    if (reading.verdict === "ask") return "Choose one of the readings below.";
    if (reading.request) take(reading.request);
    else return wordsOf(faultsOf(reading)[0] ?? { text: summary(reading) });
    return "";
  } catch (error) {
    if (here.signal.aborted) return null;
    if (!(error instanceof Problem)) throw error;
    replace(place, notice("error", [error.message]));
    return error.message;
  }
}

/** @param {any} reading @returns {any[]} */
const faultsOf = (reading) => reading.notes.filter((/** @type {any} */ note) => note.level === "fault");

/** @param {any} reading */
function summary({ verdict, candidates, request }) {
  if (verdict === "refuse") return "The table was not understood.";
  if (verdict === "ask") return `${candidates.length} readings fit: choose one.`;
  if (!request) return "The table has limits alone, and no curve.";
  return verdict === "warn" ? "The table has one reading, with warnings." : "The table has one reading.";
}

/** @param {string} kind @param {import("./dom.js").Child[]} lines */
const notice = (kind, lines) =>
  h("div", { class: "notice", "data-kind": kind }, h("div", {}, ...lines.map((line) => h("p", {}, line))));

/** @param {any[]} notes */
function notesOf(notes) {
  if (!notes.length) return null;
  return h("ul", { class: "notes" }, ...notes.map((note) => h("li", { "data-level": note.level }, wordsOf(note))));
}

/** @param {Element} place @param {any} reading @param {(request: any) => void} take */
function show(place, reading, take) {
  const { verdict, curves, bands, recipes, candidates, notes } = reading;
  const kind = { ok: "good", warn: "warning", ask: "warning", refuse: "error" }[/** @type {"ok"} */ (verdict)];
  const isChoice = candidates.length > 0;
  replace(
    place,
    notice(kind, [summary(reading)]),
    notesOf(notes),
    isChoice && choice(candidates, take),
    ...(isChoice ? [] : [...curves.map(curvePart), ...recipes.map(recipePart)]),
    ...bands.map(bandPart),
  );
}

/** The candidates side by side. @param {any[]} candidates @param {(request: any) => void} take */
function choice(candidates, take) {
  const buttons = candidates.map((one) =>
    h(
      "button",
      { type: "button", "aria-pressed": "false" },
      "Use this",
      h("span", { class: "visually-hidden" }, `: ${one.label}`),
    ),
  );
  for (const [i, button] of buttons.entries()) {
    button.addEventListener("click", () => {
      for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
      take(candidates[i].request);
    });
  }
  const parts = candidates.map((one, i) =>
    h(
      "figure",
      {},
      h("figcaption", { dir: "auto" }, one.label),
      one.curve && drawn(one.curve.points, null, []),
      one.recipe && recipeTable(one.recipe),
      notesOf((one.curve ?? one.recipe)?.notes ?? []),
      buttons[i],
    ),
  );
  return [h("div", { class: "candidates" }, ...parts), allTogether(candidates, buttons, take)];
}

/** Most aggregates of a mix. */
const MOST_AGGREGATES = 16;

/**
 * A button that takes the curves in the columns of a table as aggregates with equal shares.
 * @param {any[]} candidates
 * @param {HTMLElement[]} buttons of the single candidates
 * @param {(request: any) => void} take
 */
function allTogether(candidates, buttons, take) {
  const gradings = candidates.map((one) => one.curve && one.request.mix?.grading).filter(Boolean);
  const columns = new Set(candidates.map((one) => one.curve?.column));
  const count = candidates.length;
  if (gradings.length < count || columns.size < count || count > MOST_AGGREGATES) return null;
  const nameOf = (/** @type {any} */ one, /** @type {number} */ i) =>
    (one.curve.name ?? `Aggregate ${i + 1}`).slice(0, 64);
  const names = candidates.map(nameOf);
  const aggregates = gradings.map((grading, i) => ({
    ...(names.indexOf(names[i] ?? "") === i ? { name: names[i] } : {}),
    share: Number((1 / count).toPrecision(6)),
    grading,
  }));
  const click = () => {
    for (const button of buttons) button.setAttribute("aria-pressed", "false");
    take({ mix: { aggregates } });
  };
  return h("p", {}, h("button", { type: "button", onclick: click }, `Use all ${count} as aggregates`));
}

/** @param {string[]} heads @param {import("./dom.js").Child[][]} rows */
function table(heads, rows) {
  const cells = (/** @type {import("./dom.js").Child[]} */ row) =>
    row.map((cell, i) =>
      i ? h("td", { class: "number" }, cell) : h("th", { scope: "row", dir: "auto", class: "plain" }, cell),
    );
  return h(
    "table",
    {},
    h("thead", {}, h("tr", {}, ...heads.map((head, i) => h("th", { scope: "col", class: i ? "number" : "" }, head)))),
    h("tbody", {}, ...rows.map((row) => h("tr", {}, ...cells(row)))),
  );
}

/** A share in percent, with what the table has of it. @param {number} share */
const inPercent = (share) => number(Number((100 * share).toFixed(2)));

/** @param {any} curve */
function curvePart({ name, column, meaning, unit, points, completed, notes }) {
  const words = `column ${column}, ${MEANINGS[/** @type {"passing"} */ (meaning)] ?? meaning}, sieves in ${
    UNITS[/** @type {"mm"} */ (unit)] ?? unit
  }`;
  return h(
    "details",
    { open: true },
    h("summary", {}, name ? h("bdi", {}, name) : "Curve", `: ${words}`),
    drawn(points, null, []),
    table(
      ["Sieve, mm", "Passing, %", ...(completed.length ? ["Note"] : [])],
      points.map((/** @type {[number, number]} */ [mm, share]) => [
        number(mm),
        inPercent(share),
        ...(completed.length ? [completed.includes(mm) ? "added" : "printed"] : []),
      ]),
    ),
    notesOf(notes),
  );
}

/** @param {any} band */
function bandPart({ name, points }) {
  return h(
    "details",
    {},
    h("summary", {}, "Limits", name ? [": ", h("bdi", {}, name)] : ""),
    table(
      ["Sieve, mm", "At least, %", "At most, %"],
      points.map((/** @type {[number, number, number]} */ [mm, low, high]) => [
        number(mm),
        inPercent(low),
        inPercent(high),
      ]),
    ),
  );
}

/** @param {any} recipe */
function recipePart(recipe) {
  return h(
    "details",
    { open: true },
    h("summary", {}, "Recipe", recipe.name ? [": ", h("bdi", {}, recipe.name)] : ""),
    recipeTable(recipe),
    notesOf(recipe.notes),
  );
}

/** @param {any} recipe */
function recipeTable(recipe) {
  const { cement_kg_m3, cement_density_kg_m3, water_kg_m3, water_cement, air_volume_fraction } = recipe;
  /** @type {import("./dom.js").Child[][]} */
  const rows = [];
  const add = (
    /** @type {string} */ name,
    /** @type {any} */ value,
    unit = "kg/m³",
    /** @type {any} */ density = null,
  ) => {
    if (value !== null && value !== undefined)
      rows.push([name, `${value} ${unit}`.trim(), density === null ? "" : number(density)]);
  };
  const kilograms = (/** @type {any} */ mass) => (typeof mass === "number" ? number(mass) : null);
  const share = (/** @type {any} */ part) => (typeof part === "number" ? inPercent(part) : null);
  add("Cement", kilograms(cement_kg_m3), "kg/m³", cement_density_kg_m3 ?? null);
  for (const one of recipe.additions ?? []) add(one.name, kilograms(one.mass_kg_m3), "kg/m³", one.density_kg_m3);
  add("Water", kilograms(water_kg_m3));
  add("Water/cement", typeof water_cement === "number" ? number(water_cement, 3) : null, "");
  for (const one of recipe.aggregates) add(one.name, kilograms(one.mass_kg_m3), "kg/m³", one.density_kg_m3);
  add("Air", share(air_volume_fraction), "%");
  add("All aggregate by volume", share(recipe.aggregate_volume_fraction), "%");
  add("Sum of volumes without air", kilograms(recipe.volume_sum_m3), "m³");
  add("Air that follows", share(recipe.implied_air), "%");
  return table(["Part", "Amount", "Density, kg/m³"], rows);
}
