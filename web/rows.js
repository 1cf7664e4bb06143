/**
 * Rows of a table that stay what they are while their content changes, so that focus, selection and an open menu
 * survive an update.
 */

/**
 * @template T
 * @typedef {{row: HTMLTableRowElement, show: (item: T) => void}} Row
 */

/**
 * Brings the rows of a table in line with a list.
 * @template T
 * @param {HTMLTableSectionElement} body
 * @param {T[]} items
 * @param {(item: T) => string} key what tells items apart
 * @param {(item: T) => Row<T>} make makes the row of an item; `show` shows a later state of it
 */
export function rows(body, items, key, make) {
  const known = /** @type {Map<string, Row<T>>} */ (kept.get(body) ?? new Map());
  /** @type {Map<string, Row<T>>} */
  const next = new Map();
  for (const [index, item] of items.entries()) {
    const name = key(item);
    const row = known.get(name) ?? make(item);
    row.show(item);
    next.set(name, row);
    const here = body.rows[index];
    if (here !== row.row) body.insertBefore(row.row, here ?? null);
  }
  while (body.rows.length > items.length) body.lastElementChild?.remove();
  kept.set(body, next);
}

/** @type {WeakMap<HTMLTableSectionElement, Map<string, any>>} */
const kept = new WeakMap();
