/** Members of JSON documents by JSON pointers (RFC 6901). */

/** @param {string} pointer */
const parts = (pointer) =>
  pointer
    .split("/")
    .slice(1)
    .map((part) => part.replaceAll("~1", "/").replaceAll("~0", "~"));
/** @param {any} value */
const isHolder = (value) => typeof value === "object" && value !== null;

/**
 * @param {any} document
 * @param {string} pointer
 * @returns {any} `undefined` where there is nothing
 */
export const getAt = (document, pointer) =>
  parts(pointer).reduce(
    (here, name) => (isHolder(here) && Object.hasOwn(here, name) ? here[name] : undefined),
    document,
  );

/**
 * Sets a member of its own, whatever it is called: `__proto__` too comes from addresses.
 * @param {any} holder
 * @param {string} name
 * @param {any} value
 */
const own = (holder, name, value) =>
  Object.defineProperty(holder, name, { value, enumerable: true, writable: true, configurable: true });

/**
 * Sets a member, and makes the objects and arrays on the way.
 * @param {any} document
 * @param {string} pointer
 * @param {any} value
 */
export function setAt(document, pointer, value) {
  const names = parts(pointer);
  let here = document;
  for (const [index, name] of names.slice(0, -1).entries()) {
    if (!Object.hasOwn(here, name) || !isHolder(here[name])) {
      own(here, name, /^\d+$/.test(names[index + 1] ?? "") ? [] : {});
    }
    here = here[name];
  }
  own(here, names.at(-1) ?? "", value);
}

/**
 * Removes a member, and the objects that are empty without it.
 * @param {any} document
 * @param {string} pointer
 */
export function removeAt(document, pointer) {
  const names = parts(pointer);
  const last = names.pop() ?? "";
  const parent = `/${names.join("/")}`;
  const here = names.length ? getAt(document, parent) : document;
  if (!isHolder(here) || Array.isArray(here) || !Object.hasOwn(here, last)) return;
  delete here[last];
  if (names.length > 1 && Object.keys(here).length === 0) removeAt(document, parent);
}
