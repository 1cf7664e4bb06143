/** In what requests differ: the fields alone that are not the same in all of them. */
import { number } from "./dom.js";

/** Fields that say what a job is called, and not what it packs. */
const NAMES = new Set(["name", "labels"]);

/** @param {any} value */
const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);

/**
 * The fields in which documents differ, each as the names on its way and its value in each document.
 * @param {any[]} documents
 * @param {string[]} [path]
 * @returns {{path: string[], values: any[]}[]}
 */
export function differences(documents, path = []) {
  const texts = documents.map((one) => JSON.stringify(one));
  if (texts.every((text) => text === texts[0])) return [];
  const areLists = documents.every((one) => Array.isArray(one) && one.length === documents[0].length);
  // Lists of numbers are values, as the lengths of a box are.
  const areItems = areLists && documents.every((one) => one.every(isObject));
  if (!documents.every(isObject) && !areItems) return [{ path, values: documents }];
  const keys = new Set(documents.flatMap((one) => Object.keys(one)));
  return [...keys]
    .filter((key) => path.length > 0 || !NAMES.has(key))
    .flatMap((key) =>
      differences(
        documents.map((one) => (Object.hasOwn(one, key) ? one[key] : undefined)),
        [...path, key],
      ),
    );
}

/** What a field is called. @param {string[]} path */
export const fieldWords = (path) =>
  path.map((name) => (/^\d+$/.test(name) ? `${Number(name) + 1}` : name.replaceAll("_", " "))).join(" \u203a ");

/** A value in words. @param {any} value @param {string[]} [path] @returns {string} */
export function valueWords(value, path = []) {
  if (value === undefined || value === null) return "\u2013";
  if (typeof value === "number") return path.at(-1) === "seed" ? String(value) : number(value, 6);
  if (typeof value === "string") return value;
  if (Array.isArray(value) && value.every((one) => typeof one === "number"))
    return value.map((one) => number(one, 6)).join(" × ");
  const words = Array.isArray(value)
    ? value.map((one) => valueWords(one)).join("; ")
    : isObject(value)
      ? Object.entries(value)
          .map(([name, one]) => (name === "type" ? "" : `${fieldWords([name])} `) + valueWords(one, [name]))
          .join(", ")
      : String(value);
  return words.length > 200 ? `${words.slice(0, 200)}\u2026` : words;
}
