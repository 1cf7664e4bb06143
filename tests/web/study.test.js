// The page of a study: what it varies, its runs beside each other, and the files of all runs by program.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { inBrowser, openPage, SMALL, startBrowser, startServer } from "./harness.js";

let server, browser, study;
before(async () => {
  if (inBrowser.skip) return;
  [server, browser] = await Promise.all([startServer(["--workers", "2"]), startBrowser()]);
  const body = {
    template: { specimen: SMALL.specimen, mix: SMALL.mix },
    replicates: 2,
    grid: { "/mix/volume_fraction": [0.3, 0.4] },
  };
  const headers = { "content-type": "application/json" };
  study = await (await server.ask("/v1/studies", { method: "POST", headers, body: JSON.stringify(body) })).json();
  await server.ask(`/v1/studies/${study.id}`, { headers: { prefer: "wait=60" } });
});
after(async () => {
  await browser?.close();
  await server?.end();
});

test("a study says what it packs, and its runs are compared from their table", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/studies/${study.id}`);
  await page.waitForSelector("#runs tbody tr");
  assert.equal(await page.innerText("h1"), "Study of A16, cube 40 mm");
  const facts = await page.innerText("#facts");
  for (const words of [/Grading\s+A16/, /Specimen\s+box 40 × 40 × 40/, /Varied\s+volume fraction/])
    assert.match(facts, words);
  assert.equal(await page.locator("#runs tbody tr").count(), 4);
  await accessible();
  const boxes = page.locator("#runs input");
  await boxes.nth(0).check();
  await boxes.nth(3).check();
  await page.click("a:has-text('Compare')");
  await page.waitForURL(/compare\?jobs=/);
  await page.waitForSelector("canvas[data-drawn]");
  clean();
  await close();
});

test("the files of all runs are made for a program and downloaded", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/studies/${study.id}#files`);
  const files = page.locator("#panel-files");
  await files.locator("label", { hasText: "ParaView" }).click();
  assert.equal(await files.locator(".files a.button").count(), 4, "the grains are there");
  await files.locator("label", { hasText: "Abaqus and CalculiX" }).click();
  await files.locator("button", { hasText: "Make for all runs" }).click();
  await page.waitForFunction(() => document.querySelectorAll("#panel-files .files a.button").length === 4);
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    files.locator(".files a.button").first().click(),
  ]);
  assert.match(download.suggestedFilename(), /deck.*\.zip$/);
  await accessible();
  await page.click("#tab-request");
  assert.match(await page.innerText("#panel-request pre"), /"replicates": 2/);
  clean();
  await close();
});

test("files of more than a hundred runs are made, some at a time", inBrowser, async () => {
  const template = {
    specimen: { type: "box", size_mm: [20, 20, 20] },
    mix: { grading: { type: "monodisperse", diameter_mm: 5 }, volume_fraction: 0.1, allow_coarse: true },
  };
  const headers = { "content-type": "application/json" };
  const body = JSON.stringify({ template, replicates: 105 });
  const many = await (await server.ask("/v1/studies", { method: "POST", headers, body })).json();
  let state = many;
  while (!state.finished_at)
    state = await (await server.ask(`/v1/studies/${many.id}`, { headers: { prefer: "wait=60" } })).json();
  const { page, clean, close } = await openPage(browser, `${server.url}/studies/${many.id}#files`);
  const files = page.locator("#panel-files");
  await files.locator("label", { hasText: "ParaView" }).click();
  assert.equal(await files.locator(".files li").count(), 100);
  await files.locator("button", { hasText: "More runs" }).click();
  await page.waitForFunction(() => document.querySelectorAll("#panel-files .files a.button").length === 105);
  assert.equal(await files.locator("button", { hasText: "More runs" }).isVisible(), false);
  // Files that are made reach those that were not shown yet.
  await page.reload();
  await files.locator("label", { hasText: "FFT" }).click();
  assert.equal(await files.locator(".files li").count(), 100);
  await files.locator("button", { hasText: "Make for all runs" }).click();
  await page.waitForFunction(() => document.querySelectorAll("#panel-files .files a.button").length === 105, null, {
    timeout: 120_000,
  });
  clean();
  await close();
});

test("before a study is deleted its size is said", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/studies/${study.id}`);
  await page.waitForSelector("#points tbody tr");
  await page.click("#buttons button:has-text('Delete')");
  await page.waitForSelector("dialog[open]");
  assert.match(await page.innerText("dialog"), /4 jobs are deleted.*[\d.]+.(kB|MB) become free/s);
  await page.keyboard.press("Escape");
  clean();
  await close();
});
