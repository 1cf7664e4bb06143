// Runs that end before their target: stopped and kept from the page, marked wherever they are shown, and what the page
// offers after them and after failures.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { pathToFileURL } from "node:url";
import { BINARY, inBrowser, openPage, startBrowser, startServer } from "./harness.js";

/** What Chromium itself says of what was refused: the mesh of a periodic box, the plot of a study of one point. */
const REFUSED = /status of 422/;

/** Equal spheres that jam before their target, and grow until they are stopped. */
const GROWING = {
  name: "growing",
  seed: 3,
  specimen: { type: "box", size_mm: [14.4, 14.4, 14.4], boundary: "periodic" },
  mix: { grading: { type: "monodisperse", diameter_mm: 1 }, volume_fraction: 0.7 },
  method: { type: "edmd", stop: { stall_dt_s: 1e-300 } },
};
const LIMITED = { ...GROWING, name: "limited", on_limit: "keep", method: { type: "edmd", stop: { events: 20_000 } } };
/** Equal spheres added at random jam near 0.384. */
const FAILING = {
  ...GROWING,
  name: "too full",
  mix: { ...GROWING.mix, volume_fraction: 0.5 },
  method: { type: "rsa", attempts_per_grain: 100 },
};

let server, browser;
before(async () => {
  if (inBrowser.skip) return;
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
});

/** The form's request. @param {import("playwright-core").Page} page */
async function formRequest(page) {
  await page.waitForSelector(".answer:not([aria-busy])");
  return JSON.parse(await page.inputValue("#json"));
}

test("a run is stopped and kept, and its partial packing is marked everywhere", inBrowser, async () => {
  const job = await server.submit(GROWING);
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs/${job.id}`, {
    allow: REFUSED,
  });
  await page.click("[data-action='Stop and keep']");
  await page.waitForSelector("#title .badge[data-state=partial]", { timeout: 60_000 });
  assert.equal(await page.locator("[data-action='Stop and keep'], [data-action=Retry]").count(), 0);
  const notice = page.locator("#result .notice", { hasText: "Partial packing" });
  await notice.waitFor();
  const done = await (await server.ask(`/v1/jobs/${job.id}`)).json();
  const { volume_fraction_reached: reached, size_scale: scale } = done.result.summary.partial;
  const words = (await notice.textContent()) ?? "";
  assert.ok(words.includes((100 * reached).toFixed(2)) && words.includes("of 70.00"), words);
  assert.ok(scale < 1 && words.includes("all sizes times 0."), words);
  await accessible();
  await page.goto(`${server.url}/jobs`);
  await page.waitForSelector("#jobs tr .badge[data-state=partial]");
  clean();
  await close();
});

test("a limit that ended a run is offered twice as large", inBrowser, async () => {
  const job = await server.pack(LIMITED);
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs/${job.id}`, { allow: REFUSED });
  await page.click("#result a.button:has-text('Twice the limit of events')");
  await page.waitForURL(/\/#/);
  assert.deepEqual((await formRequest(page)).method.stop, { events: 40_000 });
  clean();
  await close();
});

test("Retry is offered where a second run can succeed, and changes where it cannot", inBrowser, async () => {
  const failed = await server.submit(FAILING);
  const late = await server.submit({ ...GROWING, timeout_s: 0.5 });
  for (const { id } of [failed, late]) await server.ask(`/v1/jobs/${id}`, { headers: { prefer: "wait=60" } });
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs/${late.id}`, {
    allow: REFUSED,
  });
  await page.waitForSelector("[data-action=Retry]");
  await page.goto(`${server.url}/jobs/${failed.id}`);
  await page.waitForSelector("#result .notice a.button");
  assert.equal(await page.locator("[data-action=Retry]").count(), 0);
  assert.match((await page.textContent("[data-action=Change]")) ?? "", /^Try: /);
  await accessible();
  await page.click("#result a.button:has-text('Grow the grains')");
  await page.waitForURL(/\/#/);
  assert.deepEqual((await formRequest(page)).method, { type: "growth" });
  await page.goto(`${server.url}/jobs?name=too+full`);
  await page.waitForSelector("#jobs tr [data-do=change]");
  assert.equal(await page.locator("#jobs [data-do=retry]").count(), 0);
  clean();
  await close();
});

test("a study offers to retry what failed where a second run can succeed", inBrowser, async () => {
  const { seed: _, name: _name, ...late } = { name: "", ...GROWING, timeout_s: 0.5 };
  const { seed: _seed, name: _named, ...full } = { name: "", ...FAILING };
  const studies = [];
  for (const template of [late, full]) {
    const body = JSON.stringify({ template, seed: 1, replicates: 2 });
    const made = await server.ask("/v1/studies", {
      method: "POST",
      headers: { "content-type": "application/json" },
      body,
    });
    const { id } = await made.json();
    await server.ask(`/v1/studies/${id}`, { headers: { prefer: "wait=60" } });
    studies.push(id);
  }
  const { page, clean, close } = await openPage(browser, `${server.url}/studies/${studies[0]}`, {
    allow: REFUSED,
  });
  await page.waitForSelector("#buttons >> text=Retry failed");
  const asked = page.waitForResponse((answer) => answer.url().includes("/jobs?state=failed"));
  await page.goto(`${server.url}/studies/${studies[1]}`);
  await asked;
  await page.waitForSelector("#buttons >> text=Run again");
  assert.equal(await page.locator("#buttons >> text=Retry failed").isVisible(), false);
  clean();
  await close();
});

test("the file of a partial packing says so", inBrowser, async () => {
  const folder = mkdtempSync(join(tmpdir(), "packstone-partial-"));
  try {
    writeFileSync(join(folder, "job.json"), JSON.stringify(LIMITED));
    const ran = spawnSync(BINARY, ["run", "job.json", "--format", "html"], { cwd: folder, encoding: "utf8" });
    assert.equal(ran.status, 0, ran.stderr);
    assert.match(readFileSync(join(folder, "result.html"), "utf8"), /"partial":/);
    const { page, clean, accessible, close } = await openPage(browser, pathToFileURL(join(folder, "result.html")).href);
    await page.waitForSelector("#title .badge[data-state=partial]");
    assert.match((await page.textContent("#result")) ?? "", /Partial packing: the run ended at its limit of events/);
    await page.waitForSelector("canvas[data-drawn]");
    await page.click("text=Picture as PNG");
    const [picture] = await Promise.all([page.waitForEvent("download"), page.click("text=Save picture")]);
    assert.equal(picture.suggestedFilename(), "packing-3-partial.png");
    await accessible();
    clean();
    await close();
  } finally {
    rmSync(folder, { recursive: true, force: true });
  }
});
