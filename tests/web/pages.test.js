// What all pages have in common: they ask for nothing that the interface does not describe, their scripts stay small,
// their headers are the same, and without script they say what to do.
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { createServer, request } from "node:http";
import { dirname, posix } from "node:path";
import { test } from "node:test";
import { parsers } from "prettier/plugins/acorn";
import { inBrowser, openPage, SMALL, startBrowser, startServer } from "./harness.js";

const WEB = new URL("../../web/", import.meta.url);
const PAGES = readdirSync(WEB).filter((name) => name.endsWith(".html"));
const read = (/** @type {string} */ name) => readFileSync(new URL(name, WEB), "utf8");

/** Most bytes of the script of a page without the viewer, with gzip of each file. */
const BUDGET = 26_000;
/**
 * And of the viewer: what a picture of spheres needs, with the matrix, an octant, an oblique plane and the images of a
 * periodic box (1.7 kB of shaders); and with what is loaded for other grains, to save pictures and to tell of a grain.
 */
const BUDGET_VIEWER = 9_900;
const BUDGET_WHOLE_VIEWER = 14_000;

/** Modules and those that they import, directly or not, before anything is done. @param {string[]} names */
function imported(...names) {
  /** @type {Set<string>} */
  const found = new Set();
  const visit = (/** @type {string} */ name) => {
    if (found.has(name)) return;
    found.add(name);
    for (const [, other = ""] of read(name).matchAll(/(?:from|^import) "(\.[^"]+)"/gm)) {
      visit(posix.join(dirname(name), other));
    }
  };
  names.forEach(visit);
  return [...found];
}

/** The modules that a page loads before anything is done. @param {string} page */
function modules(page) {
  const found = imported(
    ...[...read(page).matchAll(/<script[^>]* src="(?:\.\.\/)?assets\/([^"]+)"/g)].map(([, name = ""]) => name),
  );
  assert.ok(found.length > 3, `${page} has a script`);
  return found;
}

/**
 * The syntax tree of a script, without places and comments. What is left of a template literal has none of the lines
 * that are comments of a shader.
 * @param {string} text
 */
function tree(text) {
  return JSON.stringify(parsers.acorn.parse(text, /** @type {any} */ ({})), (key, value) => {
    if (["start", "end", "loc", "range", "comments", "extra", "__contentEnd"].includes(key)) return undefined;
    // The parser keeps parentheses where a comment states their type.
    if (value?.type === "ParenthesizedExpression") return value.expression;
    if (typeof value !== "string") return value;
    return value
      .split("\n")
      .filter((line) => !line.trim().startsWith("//"))
      .join("\n");
  });
}

test("scripts are sent without comments and indentation, else as they are, and are within their budgets", async () => {
  const server = await startServer();
  try {
    /** @type {Map<string, number>} */
    const lengths = new Map();
    const names = /** @type {string[]} */ (readdirSync(WEB, { recursive: true }));
    for (const name of names.filter((one) => one.endsWith(".js"))) {
      const answer = await server.ask(`/assets/${name}`, { headers: { "accept-encoding": "gzip" } });
      assert.equal(answer.headers.get("content-encoding"), "gzip");
      lengths.set(name, Number(answer.headers.get("content-length")));
      const sent = await answer.text();
      assert.doesNotMatch(sent, /\/\*\*|^\s*\/\//m, `${name} has comments`);
      assert.doesNotMatch(sent, /^ +(?:const|return) /m, `${name} is indented`);
      assert.ok(tree(sent) === tree(read(name)), `${name} is other code`);
    }
    const total = (/** @type {string[]} */ list) => list.reduce((sum, name) => sum + (lengths.get(name) ?? NaN), 0);
    for (const page of PAGES) {
      const size = total(modules(page).filter((name) => !name.startsWith("viewer/")));
      console.log(`  the scripts of ${page} are ${size} bytes`);
      assert.ok(size < BUDGET, `${page}: ${size} bytes`);
    }
    const viewer = total(imported("viewer/viewer.js"));
    console.log(`  the scripts of the viewer are ${viewer} bytes`);
    assert.ok(viewer < BUDGET_VIEWER, `the viewer: ${viewer} bytes`);
    const whole = total(names.filter((name) => /^viewer\/.*\.js$/.test(name)));
    console.log(`  with those that it loads later they are ${whole} bytes`);
    assert.ok(whole < BUDGET_WHOLE_VIEWER, `the whole viewer: ${whole} bytes`);
  } finally {
    await server.end();
  }
});

test("all pages have the same header, and say what to do without script", () => {
  // Addresses are relative to the page.
  const header = (/** @type {string} */ page) =>
    /<header.*<\/header>/s
      .exec(read(page))?.[0]
      .replace(/\s*\n\s*/g, "")
      .replace(/(href|src)="\.{1,2}\//g, '$1="');
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
    for (const path of [
      "/",
      "/jobs?name=small",
      `/jobs/${job.id}`,
      `/compare?jobs=${job.id},${job.id}`,
      "/studies",
      `/studies/${study.id}`,
      "/service",
    ]) {
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

/**
 * A proxy that serves a server below the path `/packstone/`, which it removes.
 * @param {string} target
 */
async function proxyBelowPath(target) {
  const proxy = createServer((asked, answer) => {
    if (!asked.url?.startsWith("/packstone/")) {
      answer.writeHead(404).end();
      return;
    }
    const options = { method: asked.method, headers: asked.headers };
    const passed = request(target + asked.url.slice("/packstone".length), options, (found) => {
      answer.writeHead(found.statusCode ?? 502, found.headers);
      found.pipe(answer);
    });
    passed.on("error", () => answer.destroy());
    answer.on("close", () => passed.destroy());
    asked.pipe(passed);
  });
  await new Promise((resolve) => proxy.listen(0, "127.0.0.1", () => resolve(undefined)));
  const { port } = /** @type {import("node:net").AddressInfo} */ (proxy.address());
  return { url: `http://127.0.0.1:${port}/packstone`, end: () => proxy.close(() => {}).closeAllConnections() };
}

for (const options of [[], ["--base-path", "/packstone"]]) {
  test(`the pages work below a path, with the options ${JSON.stringify(options)}`, inBrowser, async () => {
    const [server, browser] = await Promise.all([startServer(options), startBrowser()]);
    const proxy = await proxyBelowPath(server.url);
    try {
      const { page, clean, close } = await openPage(browser, `${proxy.url}/`);
      // The plan is asked for, and the form submits a job and goes to its page.
      await page.waitForSelector("#answer dl");
      await page.click("button[type=submit]");
      await page.waitForURL(/\/packstone\/jobs\/[0-9a-f-]+$/);
      await page.waitForSelector("#result section", { timeout: 120_000 });
      assert.equal(await page.getAttribute("nav a[aria-current]", "aria-current"), "true");
      for (const [link, address] of [
        ["Jobs", "/packstone/jobs"],
        ["Studies", "/packstone/studies"],
        ["Service", "/packstone/service"],
        ["New packing", "/packstone/"],
      ]) {
        await page.click(`nav a:text-is("${link}")`);
        await page.waitForURL((to) => to.pathname === address);
        assert.equal(await page.getAttribute("nav a[aria-current]", "aria-current"), "page", address);
      }
      await page.goto(`${proxy.url}/jobs`);
      await page.click("tbody a.name");
      await page.waitForURL(/\/packstone\/jobs\/[0-9a-f-]+$/);
      await page.waitForSelector("#result section");
      clean();
      await close();
    } finally {
      proxy.end();
      await browser.close();
      await server.end();
    }
  });
}

for (const options of [[], ["--base-path", "/packstone"]]) {
  test(`documents are pages, with the options ${JSON.stringify(options)}`, inBrowser, async () => {
    const [server, browser] = await Promise.all([startServer(options), startBrowser()]);
    const proxy = await proxyBelowPath(server.url);
    try {
      const { page, clean, close } = await openPage(browser, `${proxy.url}/`);
      await page.waitForSelector("#answer dl");
      await page.click('nav a:text-is("Documents")');
      await page.waitForURL(/\/packstone\/docs\/$/);
      await page.click('main a:text-is("glossary")');
      await page.waitForURL(/\/packstone\/docs\/glossary$/);
      await page.click('main a[href="shapes#sizes"]');
      await page.waitForURL(/\/packstone\/docs\/shapes#sizes$/);
      await page.click('.contents a:text-is("Gallery")');
      await page.waitForURL(/\/packstone\/docs\/gallery$/);
      await page.waitForFunction(() => {
        const picture = /** @type {HTMLImageElement | null} */ (document.querySelector("main img"));
        return picture?.complete && picture.naturalWidth > 0;
      });
      // An example opens in the form.
      await page.click('main a[href="../?example=dice"] >> nth=0');
      await page.waitForSelector("#answer dl");
      assert.equal(await page.inputValue("#template"), "cube");
      const foot = await page.innerText("footer");
      assert.match(foot, /Packstone \d+\.\d+\.\d+/);
      await page.click('footer a:text-is("Glossary")');
      await page.waitForURL(/\/packstone\/docs\/glossary$/);
      clean();
      await close();
    } finally {
      proxy.end();
      await browser.close();
      await server.end();
    }
  });
}

for (const [scheme, width] of /** @type {["light" | "dark", number][]} */ ([
  ["light", 1280],
  ["dark", 390],
])) {
  test(`documents and the page for wrong addresses are accessible, ${scheme}, ${width} px`, inBrowser, async () => {
    const [server, browser] = await Promise.all([startServer(), startBrowser()]);
    try {
      const missing = /status of 404/;
      const { page, clean, accessible, close } = await openPage(browser, `${server.url}/docs/`, {
        scheme,
        width,
        allow: missing,
      });
      for (const path of [
        "/docs/",
        "/docs/mixes",
        "/docs/gallery",
        "/docs/tutorial/",
        "/none",
        "/none/at/all",
        "/docs/none",
      ]) {
        const answer = await page.goto(server.url + path);
        const isThere = path.startsWith("/docs/") && path !== "/docs/none";
        assert.equal(answer?.status(), isThere ? 200 : 404, path);
        await accessible();
        const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
        assert.ok(overflow <= 0, `${path} is ${overflow} px too wide`);
        if (isThere) continue;
        assert.match(await page.innerText("h1"), /no such page/);
        await page.click("main a >> nth=0");
        await page.waitForSelector("#answer dl");
      }
      clean();
      await close();
      // Programs get a problem document.
      for (const accept of ["*/*", "application/json"]) {
        const answer = await fetch(`${server.url}/none`, { headers: { accept } });
        assert.equal(answer.headers.get("content-type"), "application/problem+json");
      }
    } finally {
      await browser.close();
      await server.end();
    }
  });
}
