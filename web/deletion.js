/** The one question before anything is deleted: what, how much of it, how large it is, and that it is for good. */
import { bytes, number } from "./dom.js";
import { confirm } from "./shell.js";

/**
 * @param {{count?: number, one: string, many?: string, name?: string, size?: number | null, also?: string}} what
 *   `one`, `many`: what is deleted, as `job` and `jobs`; `name`: of a single one; `size`: bytes that become free;
 *   `also`: what goes or stays with it, a sentence
 * @returns {Promise<boolean>}
 */
export function confirmDeletion({ count = 1, one, many = `${one}s`, name, size, also }) {
  const things = count === 1 ? `this ${one}` : `${number(count)} ${many}`;
  const called = name ? `"${name}": ` : "";
  const free = size ? `${bytes(size)} become free. ` : "";
  return confirm(
    `Delete ${things}?`,
    `${called}${also ? `${also} ` : ""}${free}This cannot be undone.`,
    count === 1 ? `Delete ${one}` : `Delete ${number(count)} ${many}`,
  );
}
