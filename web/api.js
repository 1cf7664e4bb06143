/**
 * Requests to the service's interface. Everything that a page knows, it knows by these functions, so that a script can
 * do what the page does. The browser sends the session cookie by itself; where the server asks for a key, the
 * dialog of `key.js` asks for it once, and the request is sent again.
 */
import { absolute } from "./address.js";

/** An answer other than 2xx: a problem document (RFC 9457), or what comes nearest to one. */
export class Problem extends Error {
  /**
   * @param {number} status HTTP status; 0 where no answer came
   * @param {{type?: string, title?: string, detail?: string, errors?: Fault[], [member: string]: any}} document
   */
  constructor(status, document) {
    super(document.detail || document.title || `The server answered with status ${status}`);
    this.name = "Problem";
    this.status = status;
    this.type = document.type ?? "about:blank";
    this.title = document.title ?? `Status ${status}`;
    this.detail = document.detail ?? "";
    /** @type {Fault[]} */
    this.errors = document.errors ?? [];
    this.document = document;
  }
}

/**
 * @typedef {{pointer?: string, parameter?: string, header?: string, detail: string}} Fault
 * @typedef {{headers?: Record<string, string>, signal?: AbortSignal, quiet?: boolean}} Options
 *   `quiet`: an answer of 401 is a problem like any other and opens no dialog.
 */

/** @type {Promise<void> | null} One dialog for all requests that wait for a key. */
let asking = null;
/** Whether the dialog was closed without a key: what a page asks by itself does not open it again. */
let declined = false;

/** Asks for an API key and exchanges it for a session. Rejects where the dialog is closed without a key. */
export function signIn() {
  asking ??= import("./key.js")
    .then((key) => key.ask())
    .then(
      () => {
        declined = false;
      },
      (error) => {
        declined = true;
        throw error;
      },
    )
    .finally(() => {
      asking = null;
    });
  return asking;
}

/** Ends the session and loads the page anew. */
export async function signOut() {
  await send("DELETE", "/session", undefined, { quiet: true });
  location.reload();
}

/**
 * Sends a request; the answer is one of status 2xx or 304.
 * @param {string} method
 * @param {string} path of the service, wherever it lies
 * @param {any} [body] a file is sent as it is, all else as JSON
 * @param {Options} [options]
 * @returns {Promise<Response>}
 * @throws {Problem} for any other answer, and with status 0 where the server does not answer
 */
export async function request(method, path, body, options = {}) {
  const headers = new Headers(options.headers);
  const isFile = body instanceof Blob;
  const type = isFile ? body.type || "application/octet-stream" : "application/json";
  if (body !== undefined && !headers.has("content-type")) headers.set("content-type", type);
  /** @type {RequestInit} */
  const init = { method, headers, signal: options.signal, credentials: "same-origin" };
  if (body !== undefined) init.body = isFile ? body : JSON.stringify(body);
  let answer;
  try {
    answer = await fetch(absolute(path), init);
  } catch (error) {
    if (options.signal?.aborted) throw error;
    throw new Problem(0, { title: "No answer", detail: "The server cannot be reached." });
  }
  if (answer.ok || answer.status === 304) return answer;
  if (answer.status === 401 && !options.quiet && !(declined && method === "GET")) {
    await signIn();
    return request(method, path, body, { ...options, quiet: true });
  }
  const answered = answer.headers.get("content-type") ?? "";
  throw new Problem(answer.status, answered.includes("json") ? await answer.json().catch(() => ({})) : {});
}

/**
 * @param {string} path
 * @param {Options} [options]
 * @returns {Promise<any>} the JSON document at `path`
 * @throws {Problem}
 */
export async function get(path, options) {
  return (await request("GET", path, undefined, options)).json();
}

/**
 * @param {string} method
 * @param {string} path
 * @param {any} [body] a file is sent as it is, all else as JSON
 * @param {Options} [options]
 * @returns {Promise<any>} the JSON document of the answer; `null` where it has none
 * @throws {Problem}
 */
export async function send(method, path, body, options) {
  const answer = await request(method, path, body, options);
  const type = answer.headers.get("content-type") ?? "";
  return answer.status !== 204 && type.includes("json") ? answer.json() : null;
}

/**
 * Follows a stream of server-sent events until it is closed. A connection that breaks is made again: by the browser
 * with `Last-Event-ID`, and after an answer that is no stream by this function, after 1 s, then 2 s, up to 30 s.
 * While the page is hidden there is no connection.
 * @param {string} path
 * @param {{[event: string]: (data: any, event: MessageEvent) => void}} handlers
 *   by the event's name; `data` is the parsed JSON
 * @param {{open?: () => void, down?: () => void}} [connection]
 *   `open`: the stream is there, and what happened before may have been missed; `down`: it could not be had
 * @returns {{close: () => void}}
 */
export function events(path, handlers, connection = {}) {
  /** @type {EventSource | null} */
  let source = null;
  let wait = 1;
  let timer = 0;
  const stop = () => {
    clearTimeout(timer);
    source?.close();
    source = null;
  };
  const start = () => {
    if (source || document.hidden) return;
    const here = (source = new EventSource(absolute(path)));
    here.onopen = () => {
      wait = 1;
      connection.open?.();
    };
    here.onerror = () => {
      if (here !== source || here.readyState !== EventSource.CLOSED) return;
      stop();
      connection.down?.();
      timer = setTimeout(start, wait * 1000);
      wait = Math.min(2 * wait, 30);
    };
    for (const [name, handle] of Object.entries(handlers)) {
      here.addEventListener(name, (event) => handle(JSON.parse(event.data || "null"), event));
    }
  };
  const turn = () => (document.hidden ? stop() : start());
  const again = () => {
    stop();
    start();
  };
  document.addEventListener("visibilitychange", turn);
  document.addEventListener("session", again);
  start();
  return {
    close() {
      document.removeEventListener("visibilitychange", turn);
      document.removeEventListener("session", again);
      stop();
    },
  };
}
