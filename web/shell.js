/**
 * What all pages share beside their content. The header stands in each page's HTML, so that it is painted before any
 * script has run; this module marks the current page, shows the version of the service and who is signed in, and
 * shows problems that belong to no field.
 */
import { absolute, within } from "./address.js";
import { get, Problem, signIn, signOut } from "./api.js";
import { byId, h, replace, text } from "./dom.js";

/** Marks the page's link in the navigation, and shows the account. Call it once. */
export function shell() {
  const here = within(location.pathname);
  for (const link of document.querySelectorAll("nav a")) {
    const path = within(/** @type {HTMLAnchorElement} */ (link).pathname);
    const inside = path === "/" ? here === "/" : here.startsWith(path);
    if (inside) link.setAttribute("aria-current", here === path ? "page" : "true");
  }
  document.addEventListener("session", account);
  account();
  foot();
}

/** Ends the page with the version of the service and links that help. */
function foot() {
  const version = h("span", {}, "Packstone");
  get("/assets/version.json").then(
    (document) => text(version, `Packstone ${document.version}`),
    () => {},
  );
  const links = { "": "Documents", gallery: "Examples", glossary: "Glossary", failed: "My packing failed" };
  document.body.append(
    h(
      "footer",
      { class: "foot" },
      version,
      Object.entries(links).map(([page, words]) => h("a", { href: absolute(`/docs/${page}`) }, words)),
      h("a", { href: absolute("/openapi.json") }, "Interface"),
    ),
  );
}

/** Shows the name of the key and a button to sign in or out, where the server asks for keys. */
async function account() {
  const place = byId("account");
  try {
    const key = await get("/v1/key", { quiet: true });
    if (key.name === null) return replace(place);
    replace(
      place,
      h("span", { title: `Role: ${key.role}` }, key.name),
      h("button", { type: "button", class: "quiet", onclick: signOut }, "Sign out"),
    );
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 401) return;
    const enter = () =>
      signIn().then(
        () => location.reload(),
        () => {},
      );
    replace(place, h("button", { type: "button", class: "quiet", onclick: enter }, "Sign in"));
  }
}

/**
 * Shows a problem above the content, or takes it away.
 * @param {unknown} [error] nothing takes the last one away
 */
export function report(error) {
  const place = byId("report");
  if (error === undefined) return replace(place);
  const problem = error instanceof Problem ? error : null;
  const words = error instanceof Error ? error.message : String(error);
  const old = place.firstElementChild;
  if (old?.getAttribute("data-words") === words) return;
  const close = h("button", { type: "button", class: "quiet", onclick: () => report() }, "Close");
  replace(
    place,
    h(
      "div",
      { class: "notice", "data-kind": "error", "data-words": words },
      h("div", {}, h("strong", {}, problem ? problem.title : "The page failed"), h("p", {}, words)),
      close,
    ),
  );
}

/**
 * Asks a question before something that cannot be undone.
 * @param {string} question
 * @param {string} consequence
 * @param {string} action what the button says
 * @param {string} [otherwise] what the other button says
 * @returns {Promise<boolean>}
 */
export function confirm(question, consequence, action, otherwise = "Keep") {
  return new Promise((resolve) => {
    let yes = false;
    const dialog = h(
      "dialog",
      { class: "small", "aria-labelledby": "confirm-title", "aria-describedby": "confirm-text" },
      h("h2", { id: "confirm-title" }, question),
      h("p", { id: "confirm-text" }, consequence),
      h(
        "div",
        { class: "actions" },
        h(
          "button",
          {
            type: "button",
            class: "danger",
            onclick: () => {
              yes = true;
              dialog.close();
            },
          },
          action,
        ),
        h("button", { type: "button", autofocus: true, onclick: () => dialog.close() }, otherwise),
      ),
    );
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(yes);
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}

/** A polite line for screen readers. @param {string} words */
export function announce(words) {
  text(byId("announce"), words);
}
