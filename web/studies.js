/** The list of studies: a filter in the address, pages, and what can be done with each study. */
import { absolute } from "./address.js";
import { get } from "./api.js";
import { badge, byId, h, number, replace, when } from "./dom.js";
import { live } from "./live.js";
import { rows } from "./rows.js";
import { report, shell } from "./shell.js";
import { buttons, counts } from "./study-parts.js";

const body = /** @type {HTMLTableSectionElement} */ (byId("studies"));
const filters = /** @type {HTMLFormElement} */ (byId("filters"));
let timer = 0;

/** The filters of the address, as a query of the interface. */
function query() {
  const given = new URLSearchParams(location.search);
  const query_ = new URLSearchParams({ limit: "50" });
  for (const name of ["state", "label", "cursor"])
    for (const value of given.getAll(name)) if (value) query_.append(name, value);
  return query_;
}

/** Shows the filters of the address in their fields. */
function fill() {
  const given = query();
  for (const field of /** @type {NodeListOf<HTMLInputElement | HTMLSelectElement>} */ (
    filters.querySelectorAll("[name]")
  )) {
    field.value = given.get(field.name) ?? "";
  }
}

async function update() {
  const query_ = query();
  try {
    const page = await get(`/v1/studies?${query_}`);
    if (query_.toString() !== query().toString()) return;
    rows(body, page.items, (study) => study.id, makeRow);
    byId("table").hidden = !page.items.length;
    byId("empty").hidden = page.items.length > 0;
    const filtered = query_.has("state") || query_.has("label");
    replace(
      byId("empty"),
      filtered ? "No study fits these filters. " : "No studies yet. ",
      filtered
        ? h("a", { href: absolute("/studies") }, "Show all studies")
        : h(
            "a",
            {
              href: absolute(
                "/#specimen=box&specimen.size_mm=100,100,100&mix.grading=standard&mix.grading.name=A16&mix.d_min_mm=2" +
                  "&mix.volume_fraction=0.6&vary.mix.volume_fraction=0.6,0.7,0.8&study.replicates=10",
              ),
            },
            "Describe a study",
          ),
    );
    const next = new URLSearchParams(location.search);
    if (page.next_cursor) next.set("cursor", page.next_cursor);
    replace(
      byId("pages"),
      query_.has("cursor") && h("a", { class: "button", href: absolute("/studies") }, "First page"),
      page.next_cursor && h("a", { class: "button", rel: "next", href: absolute(`/studies?${next}`) }, "Next page"),
    );
    report();
  } catch (error) {
    report(error);
    throw error;
  }
}

/** @param {any} first @returns {import("./rows.js").Row<any>} */
function makeRow(first) {
  const [name, state, progress, size, actions] = [
    h("th", { scope: "row", role: "rowheader" }),
    h("td", { role: "cell" }),
    h("td", { role: "cell", class: "wide" }),
    h("td", { role: "cell", class: "number wide" }),
    h("td", { role: "cell", class: "actions-cell" }),
  ];
  const row = h(
    "tr",
    { role: "row" },
    name,
    state,
    progress,
    size,
    h("td", { role: "cell", class: "wide nowrap" }, when(first.created_at)),
    actions,
  );
  let version = "";
  return {
    row,
    show(study) {
      const now = `${study.updated_at} ${study.name} ${JSON.stringify(study.counts)}`;
      if (now === version) return;
      version = now;
      replace(
        name,
        h(
          "a",
          { class: "name", href: absolute(`/studies/${study.id}`) },
          h("bdi", {}, study.name || `Study ${study.id.slice(-8)}`),
        ),
      );
      replace(state, badge(study.finished_at ? "finished" : "open"));
      replace(
        progress,
        h("progress", { value: study.progress.fraction, max: 1, "aria-label": "Finished jobs" }),
        h("div", { class: "hint" }, counts(study)),
      );
      replace(size, `${number(study.points, 1)} × ${number(study.replicates, 1)}`);
      replace(actions, buttons(study, watch.now));
    },
  };
}

shell();
filters.addEventListener("submit", (event) => event.preventDefault());
filters.addEventListener("input", () => {
  clearTimeout(timer);
  timer = setTimeout(() => {
    const chosen = new URLSearchParams();
    for (const [name, value] of new FormData(filters)) if (value) chosen.append(name, String(value));
    history.pushState(null, "", absolute(`/studies${chosen.size ? `?${chosen}` : ""}`));
    watch.now();
  }, 250);
});
addEventListener("popstate", () => {
  clearTimeout(timer);
  fill();
  watch.now();
});
fill();
const watch = live(update);
