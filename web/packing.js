/**
 * One packing in a file of its own, as `packstone run --format html` writes it: figures, viewer and request. The file
 * holds the documents and the grains; nothing is asked of any server.
 */
import { json } from "./code.js";
import { byId, copyButton, h, replace } from "./dom.js";
import { partialBadge } from "./job-ends.js";
import { facts } from "./job-facts.js";
import { ViewPart } from "./job-view.js";

/** The result without its grains, and how many of the grains the file holds: the largest. */
const { grains, result } = JSON.parse(byId("result-data").textContent ?? "");
const { request } = result;

/** The view format of the grains. @returns {Promise<ReadableStream<Uint8Array>>} */
async function open() {
  const text = atob(byId("grains-data").textContent ?? "");
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return new Blob([bytes]).stream();
}

const name = request.name ?? `Packing of seed ${request.seed}`;
document.title = `${name} - Packstone`;
replace(byId("title"), h("bdi", {}, name), partialBadge(result.summary));
const words = h("pre", { tabindex: "0", "aria-label": "Request as JSON" }, `${json(request)}\n`);
const view = new ViewPart(
  { name: `${request.seed}${result.summary.partial ? "-partial" : ""}`, open, limit: grains },
  result,
  request,
);
const warnings = result.warnings.map((/** @type {string} */ warning) =>
  h("div", { class: "notice", "data-kind": "warning" }, h("p", {}, warning)),
);
const figures = [...warnings, facts(request, request, result)];
// A frame, as that of a notebook, is small and is there for the viewer.
const framed = window.parent !== window;
replace(
  byId("result"),
  ...(framed ? [view.element, ...figures] : [...figures, view.element]),
  h(
    "section",
    { class: "panel stack tight", "aria-labelledby": "request-title" },
    h("h2", { id: "request-title" }, "Request"),
    h(
      "p",
      { class: "hint" },
      "As request.json, `packstone run request.json` makes the same packing with the same version.",
    ),
    h(
      "div",
      { class: "actions" },
      copyButton(() => words.textContent ?? ""),
    ),
    words,
  ),
);
await view.start();
