/**
 * The address of a request: `/#` and the request in a form that people can read, so that a link is a mix.
 *
 *     /#specimen=box&specimen.size_mm=100,100,100&mix.grading=standard&mix.grading.name=A16&mix.d_min_mm=2
 *       &mix.volume_fraction=0.6&distance=constant&distance.gap_mm=0.3&seed=7
 *
 * Each entry is `path=value`. A path has the names of the members, joined by dots. The member `type` of the objects
 * in `TYPED` is written as the value of the object itself. A value is
 *   - a number, `true`, `false` or `null`, as in JSON;
 *   - numbers joined by commas: an array of two numbers or more;
 *   - pairs `a:b` of numbers joined by commas: an array of arrays of two numbers (sieves);
 *   - anything else in JSON, if it begins with `"`, `[` or `{`;
 *   - else a text as it is.
 * The address of a study has the entries of its template, with `vary.PATH=values` for each pointer of its `grid` and
 * `study.MEMBER=value` for its other members (`study.replicates=20`). What is a percent-encoded dot is no separator.
 * Any request and study with a template can be written and read back.
 */
import { absolute } from "./address.js";
import { parse } from "./numbers.js";

/** Objects whose `type` is written as their value. */
const TYPED = new Set(["specimen", "mix.grading", "mix.shape", "mix.shape.ratios", "distance", "method"]);
const NUMBER = /^-?(0|[1-9]\d*)(\.\d+)?([eE][+-]?\d+)?$/;
const PAIR = /^[^:,]+:[^:,]+$/;

/** @typedef {{[member: string]: any}} Members */

/** @param {any} value */
const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
/** @param {any} value */
const isNumber = (value) => typeof value === "number";

/** @param {string} words */
const escaped = (words) =>
  encodeURIComponent(words).replace(/%(2C|3A|5B|5D|2F|20|40|24)/g, (code) =>
    code === "%20" ? "+" : decodeURIComponent(code),
  );
/** @param {string} name */
const escapedName = (name) => encodeURIComponent(name).replaceAll(".", "%2E");
/** @param {string} words */
const unescaped = (words) => decodeURIComponent(words.replaceAll("+", "%20"));

/** @param {any} value */
function written(value) {
  if (typeof value === "string") {
    const plain = value !== "" && !/^["[{]/.test(value) && value === read(value, JSON.parse);
    return plain ? value : JSON.stringify(value);
  }
  if (Array.isArray(value) && value.length > 1 && value.every(isNumber)) return value.join(",");
  if (
    Array.isArray(value) &&
    value.length &&
    value.every((v) => Array.isArray(v) && v.length === 2 && v.every(isNumber))
  ) {
    return value.map((pair) => pair.join(":")).join(",");
  }
  return JSON.stringify(value);
}

/** @param {string} words @param {(words: string) => any} [json] @returns {any} */
function read(words, json = parse) {
  if (/^["[{]/.test(words)) return json(words);
  if (words === "true" || words === "false" || words === "null" || NUMBER.test(words)) return json(words);
  const parts = words.split(",");
  if (parts.length > 1 && parts.every((part) => NUMBER.test(part))) return parts.map((part) => json(part));
  const pairs = parts.map((part) => (PAIR.test(part) ? part.split(":") : []));
  if (pairs.every((pair) => pair.length === 2 && pair.every((part) => NUMBER.test(part)))) {
    return pairs.map((pair) => pair.map((part) => json(part)));
  }
  return words;
}

/**
 * @param {Members} members
 * @param {string} path
 * @param {string} prefix
 * @param {string[]} entries
 */
function flatten(members, path, prefix, entries) {
  for (const [name, value] of Object.entries(members)) {
    const here = path ? `${path}.${escapedName(name)}` : escapedName(name);
    if (value === undefined) continue;
    if (isObject(value) && Object.keys(value).length) {
      const { type, ...others } = value;
      const short = TYPED.has(here) && typeof type === "string";
      if (short) entries.push(`${prefix}${here}=${escaped(type)}`);
      flatten(short ? others : value, here, prefix, entries);
    } else entries.push(`${prefix}${here}=${escaped(written(value))}`);
  }
}

/**
 * The address of a request on the page with the form.
 * @param {Members} request a job, or a study with a template
 * @returns {string}
 */
export function address(request) {
  /** @type {string[]} */
  const entries = [];
  const { template, grid, ...study } = request;
  if (!isObject(template)) flatten(request, "", "", entries);
  else {
    flatten(template, "", "", entries);
    for (const [pointer, values] of Object.entries(grid ?? {})) {
      const path = pointer
        .split("/")
        .slice(1)
        .map((part) => escapedName(part.replaceAll("~1", "/").replaceAll("~0", "~")));
      entries.push(`vary.${path.join(".")}=${escaped(written(values))}`);
    }
    flatten(study, "", "study.", entries);
    if (entries.every((entry) => !/^(vary|study)\./.test(entry))) entries.push("study.replicates=1");
  }
  return absolute(`/#${entries.join("&")}`);
}

/**
 * The request of an address.
 * @param {string} hash what follows `/`, with or without its `#`
 * @returns {Members | null} `null` where there is none
 * @throws {Error} where an entry cannot be read
 */
export function requestOf(hash) {
  const entries = hash.replace(/^#/, "").split("&").filter(Boolean);
  if (!entries.length) return null;
  /** @type {Members} */
  const request = {};
  /** @type {Members} */
  const study = {};
  /** @type {Members} */
  const grid = {};
  for (const entry of entries) {
    const at = entry.indexOf("=");
    if (at < 1) throw new Error(`The address has an entry without a value: ${entry}`);
    const path = entry.slice(0, at).split(".").map(unescaped);
    const words = unescaped(entry.slice(at + 1));
    if (path[0] === "vary" && path.length > 1) {
      const pointer = path
        .slice(1)
        .map((part) => `/${part.replaceAll("~", "~0").replaceAll("/", "~1")}`)
        .join("");
      grid[pointer] = read(words);
    } else if (path[0] === "study" && path.length > 1) put(study, path.slice(1), read(words));
    else if (TYPED.has(path.join("."))) put(request, [...path, "type"], words);
    else put(request, path, read(words));
  }
  const isStudy = Object.keys(study).length > 0 || Object.keys(grid).length > 0;
  if (!isStudy) return request;
  return { ...study, template: request, ...(Object.keys(grid).length ? { grid } : {}) };
}

/**
 * Sets a member of a member, and makes the objects on the way.
 * @param {Members} members
 * @param {string[]} path
 * @param {any} value
 */
function put(members, path, value) {
  let here = members;
  for (const name of path.slice(0, -1)) {
    if (!Object.hasOwn(here, name) || !isObject(here[name])) {
      Object.defineProperty(here, name, { value: {}, enumerable: true, writable: true, configurable: true });
    }
    here = here[name];
  }
  const name = /** @type {string} */ (path.at(-1));
  Object.defineProperty(here, name, { value, enumerable: true, writable: true, configurable: true });
}
