/**
 * Elements and the text in them. Text is only ever inserted as text nodes, so that names and labels of strangers are
 * shown as they were written. Numbers are shown with their units, in the notation 12 345.6 with a thin space.
 */

const SVG = "http://www.w3.org/2000/svg";

/**
 * @typedef {Node | string | number | false | null | undefined} Child
 * @typedef {Record<string, any>} Attributes
 *   `on...`: a listener; `style`: an object of CSS properties; `true`: an attribute without value; `false`, `null` and
 *   `undefined`: no attribute
 */

/**
 * @param {Element} element
 * @param {Attributes} attributes
 */
function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (name === "style") {
      const { style } = /** @type {HTMLElement} */ (element);
      for (const [property, setting] of Object.entries(value)) style.setProperty(property, String(setting));
    } else element.setAttribute(name, value === true ? "" : String(value));
  }
}

/** @param {Child[]} children */
const shown = (children) =>
  children
    .flat()
    .filter((child) => child !== false && child !== null && child !== undefined)
    .map((child) => (child instanceof Node ? child : String(child)));

/**
 * Makes an element of HTML.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {Attributes} [attributes]
 * @param {...(Child | Child[])} children
 * @returns {HTMLElementTagNameMap[T]}
 */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  set(element, attributes);
  element.append(...shown(/** @type {Child[]} */ (children)));
  return element;
}

/**
 * Makes an element of SVG.
 * @template {keyof SVGElementTagNameMap} T
 * @param {T} tag
 * @param {Attributes} [attributes]
 * @param {...(Child | Child[])} children
 * @returns {SVGElementTagNameMap[T]}
 */
export function s(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  set(element, attributes);
  element.append(...shown(/** @type {Child[]} */ (children)));
  return element;
}

/**
 * Replaces what is in an element.
 * @param {Element} element
 * @param {...(Child | Child[])} children
 */
export function replace(element, ...children) {
  element.replaceChildren(...shown(/** @type {Child[]} */ (children)));
}

/**
 * Sets the text of an element, if it differs: a status that is read out is not read twice.
 * @param {Element} element
 * @param {string} words
 */
export function text(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

/**
 * The element with an id, which the page must have.
 * @template {HTMLElement} [T=HTMLElement]
 * @param {string} id
 * @returns {T}
 */
export function byId(id) {
  const element = document.getElementById(id);
  if (!element) throw new Error(`the page has no element ${id}`);
  return /** @type {T} */ (element);
}

/** Stands between a number and its unit, and between groups of digits. */
const THIN = "\u202f";

/**
 * A number for people: groups of three digits, `digits` significant digits, and whole numbers with all of theirs.
 * @param {number | null | undefined} value
 * @param {number} [digits]
 */
export function number(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "\u2013";
  const size = Math.abs(value);
  const isTooLong = size >= 1e15 && !Number.isSafeInteger(value);
  if (size !== 0 && (size < 1e-4 || isTooLong)) return value.toExponential(digits - 1);
  const whole = size >= 10 ** (digits - 1);
  const words = whole ? Math.round(value).toString() : String(Number(value.toPrecision(digits)));
  const [integer = "", decimals] = words.split(".");
  const grouped = integer.replace(/\B(?=(\d{3})+$)/g, THIN).replace("-", "\u2212");
  return decimals ? `${grouped}.${decimals}` : grouped;
}

/**
 * A number with its unit.
 * @param {number | null | undefined} value
 * @param {string} unit
 * @param {number} [digits]
 */
export const quantity = (value, unit, digits) =>
  value === null || value === undefined ? "\u2013" : `${number(value, digits)}${THIN}${unit}`;

/**
 * A share of 1 in percent.
 * @param {number | null | undefined} share
 * @param {number} [decimals]
 */
export function percent(share, decimals = 0) {
  if (share === null || share === undefined) return "\u2013";
  // What rounds to zero has no sign.
  return `${(100 * share).toFixed(decimals).replace(/^-(?=[0.]*$)/, "")}${THIN}%`;
}

/**
 * A time span in s, min, h or d.
 * @param {number | null | undefined} seconds
 */
export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "\u2013";
  if (seconds < 0.001) return `< 1${THIN}ms`;
  if (seconds < 1) return quantity(1000 * seconds, "ms", 2);
  if (seconds < 9.95) return quantity(seconds, "s", 2);
  const whole = Math.round(seconds);
  /** @type {(large: number, a: string, small: number, b: string) => string} */
  const two = (large, a, small, b) => `${large}${THIN}${a}` + (small ? ` ${small}${THIN}${b}` : "");
  if (whole < 60) return `${whole}${THIN}s`;
  if (whole < 3600) return two(Math.floor(whole / 60), "min", whole % 60, "s");
  if (whole < 86400) return two(Math.floor(whole / 3600), "h", Math.floor((whole % 3600) / 60), "min");
  return two(Math.floor(whole / 86400), "d", Math.floor((whole % 86400) / 3600), "h");
}

/**
 * An amount of bytes in kB, MB, GB or TB (powers of 1000).
 * @param {number | null | undefined} amount
 */
export function bytes(amount) {
  if (amount === null || amount === undefined) return "\u2013";
  const units = ["B", "kB", "MB", "GB", "TB"];
  const power = amount < 1000 ? 0 : Math.min(4, Math.floor(Math.log10(amount) / 3));
  return quantity(amount / 1000 ** power, units[power] ?? "B", 3);
}

/**
 * A moment as an element: day and time here, and with seconds as a title.
 * @param {string | null | undefined} moment RFC 3339
 */
export function when(moment) {
  if (!moment) return "\u2013";
  const date = new Date(moment);
  const pad = (/** @type {number} */ part) => String(part).padStart(2, "0");
  const clock = `${pad(date.getHours())}:${pad(date.getMinutes())}:${pad(date.getSeconds())}`;
  const day = `${date.getFullYear()}-${pad(date.getMonth() + 1)}-${pad(date.getDate())}`;
  return h("time", { datetime: moment, title: `${day} ${clock}` }, `${day} ${clock.slice(0, 5)}`);
}

/**
 * The badge of a state.
 * @param {string} state
 * @param {{cancel_requested?: boolean, finish_requested?: boolean}} [job] what was asked of it while it runs
 */
export function badge(state, { cancel_requested, finish_requested } = {}) {
  const asked = cancel_requested ? "stopping" : finish_requested ? "finishing" : state;
  return h("span", { class: "badge", "data-state": state }, state === "running" ? asked : state);
}

/**
 * Copies text into the clipboard and says so on the button.
 * @param {() => string} words
 */
export function copyButton(words) {
  const button = h("button", { type: "button", class: "quiet", onclick: copy }, "Copy");
  let timer = 0;
  async function copy() {
    let done = "Copied";
    await navigator.clipboard.writeText(words()).catch(() => {
      done = "Not allowed";
    });
    text(button, done);
    clearTimeout(timer);
    timer = setTimeout(() => text(button, "Copy"), 2000);
  }
  button.setAttribute("aria-live", "polite");
  return button;
}
