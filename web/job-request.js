/** The request of a job as JSON, as a command with curl, and as a script with Python. */
import { absolute } from "./address.js";
import { curl, json, python } from "./code.js";
import { copyButton, h, text } from "./dom.js";

/**
 * @param {any} job
 * @param {any} request
 */
export function requestPart(job, request) {
  const long = json(request).length > 200_000;
  if (long) {
    return h(
      "section",
      { class: "panel", "aria-labelledby": "request-title" },
      h("h2", { id: "request-title" }, "Request"),
      h("p", {}, "The request is long. ", h("a", { href: absolute(job.links.request) }, "Read it as JSON"), "."),
    );
  }
  const withKey = job.submitted_by !== null;
  /** @type {Record<string, string>} */
  const forms = { JSON: `${json(request)}\n`, curl: curl(request, withKey), Python: python(request, withKey) };
  const words = h("pre", { tabindex: "0", "aria-label": "Request as JSON" }, forms.JSON);
  const choose = (/** @type {string} */ kind) => {
    text(words, forms[kind] ?? "");
    words.setAttribute("aria-label", `Request as ${kind}`);
  };
  return h(
    "section",
    { class: "panel stack tight", "aria-labelledby": "request-title" },
    h("h2", { id: "request-title" }, "Request"),
    h(
      "div",
      { class: "actions" },
      h(
        "span",
        { class: "choices", role: "radiogroup", "aria-label": "Form of the request" },
        Object.keys(forms).map((kind) =>
          h(
            "label",
            {},
            h("input", { type: "radio", name: "form", checked: kind === "JSON", onchange: () => choose(kind) }),
            kind,
          ),
        ),
      ),
      copyButton(() => words.textContent ?? ""),
    ),
    words,
  );
}
