// What all pages have in common: they ask for nothing that the interface does not describe, their scripts stay small,
// their headers are the same, and without script they say what to do.
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { dirname, posix } from "node:path";
import { test } from "node:test";
import { gzipSync } from "node:zlib";
import { inBrowser, openPage, SMALL, startBrowser, startServer } from "./harness.js";

const WEB = new URL("../../web/", import.meta.url);
const PAGES = readdirSync(WEB).filter((name) => name.endsWith(".html"));
const read = (/** @type {string} */ name) => readFileSync(new URL(name, WEB), "utf8");

/** Most bytes of the script of a page without the viewer, after gzip of each file. */
const BUDGET = 30_000;

/** The modules that a page loads before anything is done. @param {string} page */
function modules(page) {
  /** @type {Set<string>} */
  const found = new Set();
  const visit = (/** @type {string} */ name) => {
    if (found.has(name)) return;
    found.add(name);
    for (const [, other = ""] of read(name).matchAll(/(?:from|^import) "(\.[^"]+)"/gm)) {
      visit(posix.join(dirname(name), other));
    }
  };
  for (const [, name = ""] of read(page).matchAll(/<script[^>]* src="\/assets\/([^"]+)"/g)) visit(name);
  assert.ok(found.size > 3, `${page} has a script`);
  return [...found];
}

test("the script of each page is within its budget", () => {
  for (const page of PAGES) {
    const names = modules(page).filter((name) => !name.startsWith("viewer/"));
    const size = names.reduce((sum, name) => sum + gzipSync(read(name)).length, 0);
    assert.ok(size < BUDGET, `${page}: ${size} bytes`);
  }
});

test("all pages have the same header, and say what to do without script", () => {
  const header = (/** @type {string} */ page) => /<header.*<\/header>/s.exec(read(page))?.[0].replace(/\s*\n\s*/g, "");
  for (const page of PAGES) {
    assert.equal(header(page), header("index.html"), page);
    assert.match(read(page), /<noscript>.*curl.*<\/noscript>/s, page);
    assert.doesNotMatch(read(page), / style=| on[a-z]+=|<script(?![^>]* src=)/, `${page} has nothing inline`);
  }
});

test("every request of the pages is in the description of the interface", inBrowser, async () => {
  const [server, browser] = await Promise.all([startServer(), startBrowser()]);
  try {
    const { paths } = await (await server.ask("/openapi.json")).json();
    const known = Object.entries(paths).flatMap(([path, methods]) =>
      Object.keys(methods).map((method) => ({
        method: method.toUpperCase(),
        path: new RegExp(`^${path.replace(/\{[^}]+\}/g, "[^/]+")}$`),
        methods,
      })),
    );
    const job = await server.pack(SMALL);
    const study = await (
      await server.ask("/v1/studies", {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ template: { specimen: SMALL.specimen, mix: SMALL.mix }, replicates: 3 }),
      })
    ).json();
    await server.ask(`/v1/studies/${study.id}`, { headers: { prefer: "wait=60" } });
    let asked = 0;
    /** @type {string[]} */
    const unknown = [];
    for (const path of ["/", "/jobs?name=small", `/jobs/${job.id}`, "/studies", `/studies/${study.id}`, "/service"]) {
      const { page, close } = await openPage(browser, "about:blank");
      page.on("request", (request) => {
        const to = new URL(request.url());
        if (!to.protocol.startsWith("http")) return;
        if (to.pathname.startsWith("/assets/") || request.isNavigationRequest()) return;
        asked += 1;
        const operation = known.find((one) => one.method === request.method() && one.path.test(to.pathname));
        if (!operation) {
          unknown.push(`${path} asks ${request.method()} ${to.pathname}`);
          return;
        }
        const given = operation.methods[operation.method.toLowerCase()].parameters ?? [];
        const open = given.some((/** @type {any} */ one) => one.in === "query" && one.schema?.type === "object");
        const queries = given.filter((/** @type {any} */ one) => one.in === "query");
        const names = queries.map((/** @type {any} */ one) => one.name);
        for (const name of to.searchParams.keys()) {
          if (!open && !names.includes(name)) unknown.push(`${path} asks ${to.pathname} with ${name}`);
        }
      });
      await page.goto(server.url + path);
      const shown = { "/": "#answer dl", "/service": "#limits dd", [`/jobs/${job.id}`]: "#result section" };
      await page.waitForSelector(shown[path] ?? "tbody tr");
      await page.waitForTimeout(1500);
      await close();
    }
    assert.deepEqual(unknown, []);
    assert.ok(asked > 20, `${asked} requests were looked at`);
  } finally {
    await browser.close();
    await server.end();
  }
});
