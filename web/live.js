/**
 * Keeps a page up to date: by the stream `GET /v1/events` where it can be had, else by asking every few seconds.
 * While the page is hidden nothing is asked; when it is shown again it is brought up to date at once.
 */
import { events } from "./api.js";

/**
 * @param {() => Promise<number | void>} update
 *   brings the page up to date; what it returns is the time in s after which it is to be called again even without an
 *   event, for what changes without one
 * @param {{poll_s?: number, gather_ms?: number}} [options]
 *   `poll_s`: time between two calls without a stream, and after one that failed; `gather_ms`: events of this time
 *   make one call
 * @returns {{now: () => void, close: () => void}} `now` brings the page up to date at once
 */
export function live(update, { poll_s = 3, gather_ms = 100 } = {}) {
  let busy = false;
  let again = false;
  let streaming = false;
  let timer = 0;
  let due = Infinity;
  let closed = false;

  /** Calls `update` in so many ms, or earlier if that is planned. @param {number} wait */
  function plan(wait) {
    const at = performance.now() + wait;
    if (at >= due) return;
    clearTimeout(timer);
    due = at;
    timer = setTimeout(run, wait);
  }
  async function run() {
    clearTimeout(timer);
    due = Infinity;
    if (closed || document.hidden) return;
    if (busy) {
      again = true;
      return;
    }
    busy = true;
    const next = await update().catch(() => poll_s);
    busy = false;
    if (again) plan(gather_ms);
    else if (!streaming) plan(1000 * Math.min(next ?? poll_s, poll_s));
    else if (next !== undefined) plan(1000 * next);
    again = false;
  }
  const heard = () => {
    if (busy) again = true;
    else plan(gather_ms);
  };
  const shown = () => {
    if (!document.hidden) run();
  };
  const turned = (/** @type {boolean} */ there) => () => {
    streaming = there;
    heard();
  };
  document.addEventListener("visibilitychange", shown);
  const handlers = { job: heard, study: heard, reset: heard };
  const stream = events("/v1/events", handlers, { open: turned(true), down: turned(false) });
  run();
  return {
    now: run,
    close() {
      closed = true;
      clearTimeout(timer);
      document.removeEventListener("visibilitychange", shown);
      stream.close();
    },
  };
}
