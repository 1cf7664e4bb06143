// What the tests of the page share: the real binary, a browser, and a watch over what a page must not do.
//
// PACKSTONE_BINARY names the binary (default: target/release/packstone), PACKSTONE_CHROMIUM the browser (default: what
// the distribution installs). Where there is no browser the tests are skipped, and say so.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";

const ROOT = new URL("../..", import.meta.url).pathname;
/** The program. */
export const BINARY = process.env.PACKSTONE_BINARY ?? join(ROOT, "target/release/packstone");
const CHROMIUM =
  process.env.PACKSTONE_CHROMIUM ??
  ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"].find(existsSync);
const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

/** What Chromium says by itself when it composes a page with WebGL in software: it copies the canvas. */
const COMPOSER = /GL Driver Message .*GPU stall due to ReadPixels/;

/** Options of a test: skipped aloud without a browser. */
export const inBrowser = { skip: CHROMIUM ? false : "no Chromium here: set PACKSTONE_CHROMIUM", timeout: 300_000 };

/** Starts a browser with WebGL 2 in software. */
export function startBrowser() {
  return chromium.launch({
    executablePath: CHROMIUM,
    args: [
      "--no-sandbox",
      "--disable-gpu",
      "--use-angle=swiftshader",
      "--enable-unsafe-swiftshader",
      "--disable-quic",
      "--no-first-run",
      "--disable-background-networking",
      "--disable-component-update",
      "--disable-sync",
      "--force-device-scale-factor=1",
    ],
  });
}

/**
 * Starts the service over a new data directory. It serves the files that are compiled in, or with the environment
 * variable PACKSTONE_WEB_DIR those of a folder.
 * @param {string[]} [options] more options of `packstone serve`
 */
export async function startServer(options = []) {
  const data = mkdtempSync(join(tmpdir(), "packstone-web-"));
  const server = {
    url: "",
    data,
    /** @type {import("node:child_process").ChildProcess | undefined} */
    child: undefined,
    /** Starts it again at the same address. */
    async start() {
      const listen = server.url ? new URL(server.url).host : "127.0.0.1:0";
      const child = spawn(BINARY, ["serve", "--data-dir", data, "--listen", listen, ...options], {
        stdio: ["ignore", "pipe", "pipe"],
      });
      server.child = child;
      let log = "";
      child.stderr.on("data", (part) => (log += part));
      server.url = await new Promise((resolve, reject) => {
        child.stdout.on("data", (part) => {
          const address = /listening on (http:\/\/\S+)/.exec(String(part));
          if (address) resolve(address[1]);
        });
        child.on("error", (error) =>
          reject(new Error(`${BINARY} does not start (${error.message}): build it, or set PACKSTONE_BINARY`)),
        );
        child.on("exit", (code) => reject(new Error(`packstone ended with ${code}: ${log}`)));
      });
    },
    /** Ends it; its data stay. */
    async stop() {
      const { child } = server;
      // Without a process number it did not start.
      if (!child || child.pid === undefined || child.exitCode !== null) return;
      const ended = new Promise((resolve) => child.once("exit", resolve));
      child.kill("SIGTERM");
      await ended;
    },
    /** Ends it and removes its data. */
    async end() {
      await server.stop();
      rmSync(data, { recursive: true, force: true });
    },
    /**
     * A request to the interface; throws for any answer but 2xx.
     * @param {string} path
     * @param {RequestInit} [init]
     */
    async ask(path, init) {
      const answer = await fetch(server.url + path, init);
      if (!answer.ok) throw new Error(`${path}: ${answer.status} ${await answer.text()}`);
      return answer;
    },
    /**
     * Submits a job.
     * @param {any} request
     * @returns {Promise<any>} the job
     */
    async submit(request) {
      const headers = { "content-type": "application/json" };
      return (await server.ask("/v1/jobs", { method: "POST", headers, body: JSON.stringify(request) })).json();
    },
    /**
     * Submits a job and waits until it has ended.
     * @param {any} request
     * @returns {Promise<any>} the job
     */
    async pack(request) {
      let job = await server.submit(request);
      while (!job.finished_at) {
        job = await (await server.ask(`/v1/jobs/${job.id}`, { headers: { prefer: "wait=60" } })).json();
      }
      assert.equal(job.state, "succeeded", JSON.stringify(job.error));
      return job;
    },
  };
  await server.start();
  return server;
}

/** A request that is packed in a moment: about 200 grains in a cube of 40 mm. */
export const SMALL = {
  name: "small",
  seed: 1,
  specimen: { type: "box", size_mm: [40, 40, 40] },
  mix: { grading: { type: "standard", name: "A16" }, d_min_mm: 4, volume_fraction: 0.5 },
};

/**
 * Opens a page and watches it: console messages, errors, requests to other hosts, reports of the content security
 * policy.
 * @param {import("playwright-core").Browser} browser
 * @param {string} url
 * @param {{scheme?: "light" | "dark", width?: number, height?: number, allow?: RegExp,
 *   context?: import("playwright-core").BrowserContextOptions}} [options] allow: console messages that are expected
 */
export async function openPage(browser, url, { scheme = "light", width = 1280, height = 900, allow, context } = {}) {
  const tab = await browser.newContext({ colorScheme: scheme, viewport: { width, height }, ...context });
  const page = await tab.newPage();
  /** @type {string[]} */
  const seen = [];
  page.on("console", (message) => {
    if (!allow?.test(message.text()) && !COMPOSER.test(message.text()))
      seen.push(`console: ${message.text()} ${message.location().url}`);
  });
  page.on("pageerror", (error) => seen.push(`error: ${error.message}`));
  page.on("request", (request) => {
    const to = new URL(request.url());
    if (to.protocol !== "blob:" && to.protocol !== "data:" && to.origin !== new URL(url).origin) {
      seen.push(`request: ${request.url()}`);
    }
  });
  await page.addInitScript(() => {
    document.addEventListener("securitypolicyviolation", (e) => {
      console.error(`policy: ${e.violatedDirective} ${e.blockedURI} ${e.sourceFile}:${e.lineNumber}`);
    });
  });
  await page.goto(url);
  return {
    page,
    /** Fails if the page did what it must not. */
    clean() {
      assert.deepEqual(seen, []);
    },
    /** Fails on what axe-core finds. */
    async accessible() {
      await page.evaluate(AXE);
      const found = await page.evaluate(async () => {
        const { violations } = await /** @type {any} */ (globalThis).axe.run();
        return violations.flatMap((/** @type {any} */ v) =>
          v.nodes.map((/** @type {any} */ n) => `${v.id}: ${n.target} ${n.failureSummary}`),
        );
      });
      assert.deepEqual(found, []);
    },
    close: () => tab.close(),
  };
}

/**
 * Chooses a file of a program on the page of a job.
 * @param {import("playwright-core").Page} page
 * @param {string} program
 * @param {string} file
 */
export async function chooseFile(page, program, file) {
  await page.click("#tab-files");
  await page.locator("#exports-title + * label", { hasText: program }).click();
  await page.selectOption("#export-kind", file);
}
