/**
 * Addresses of the service. It may lie below a path of its host, as behind a proxy at `https://lab.example/packstone/`:
 * this module lies at `assets/address.js` below that path.
 */

/** The path below which the service lies, with a slash at its end. In a file of its own there is none. */
const base = import.meta.url.startsWith("http") ? new URL("..", import.meta.url).pathname : "/";

/**
 * The address of a path of the service, as `/v1/jobs`. Links that a server below a path gives begin with that path
 * already, and stay.
 * @param {string} path
 */
export const absolute = (path) => (path.startsWith(base) ? path : `${base}${path.slice(1)}`);

/**
 * The path of an address of this page within the service, as `/jobs`.
 * @param {string} pathname
 */
export const within = (pathname) => (pathname.startsWith(base) ? `/${pathname.slice(base.length)}` : pathname);

/** The address of the service, without a slash at its end, as clients of Python are given it. */
export const service = () => `${location.origin}${base.slice(0, -1)}`;
