// The path of a newcomer, by the page alone: from a table of Excel to a model that CalculiX runs and a picture of it,
// once by mouse and once by keyboard.
import assert from "node:assert/strict";
import { execFileSync, spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, statSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { inBrowser, openPage, startBrowser, startServer } from "./harness.js";

/** A sieve curve as an Excel workbook of percent cells, */
const BOOK = new URL("../data/mixes/g80-percent-format.xlsx", import.meta.url).pathname;
/** and as the cells that Excel puts on the clipboard. */
const CELLS = "Sieb (mm)\tDurchgang (%)\r\n1\t12\r\n2\t21\r\n4\t36\r\n8\t60\r\n16\t100\r\n";
/** All of it takes at most this; a person reads meanwhile, but presses no more keys. */
const MOST_S = 300;
const MOST_KEYS = 120;

let server, browser, folder;
before(async () => {
  if (inBrowser.skip) return;
  folder = mkdtempSync(join(tmpdir(), "packstone-trial-"));
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
  if (folder) rmSync(folder, { recursive: true, force: true });
});

/** Waits until the plan of what the fields say is shown. @param {import("playwright-core").Page} page */
const planned = (page) => page.waitForSelector(".answer:not([aria-busy]) #answer dl");

/**
 * Unpacks a model and has CalculiX run it, where it is installed.
 * @param {import("playwright-core").Download} download
 * @param {string} name of the folder
 */
async function solve(download, name) {
  const path = join(folder, `${name}.zip`);
  await download.saveAs(path);
  const unpacked = join(folder, name);
  execFileSync("python3", ["-m", "zipfile", "-e", path, unpacked]);
  // As the page says it.
  const ran = spawnSync("ccx", ["model"], { cwd: unpacked, encoding: "utf8", timeout: 240_000 });
  if (ran.error) return console.log("no CalculiX here: the model is not run");
  assert.equal(ran.status, 0, ran.stdout.slice(-2000));
  assert.match(ran.stdout, /Job finished/);
  assert.ok(statSync(join(unpacked, "model.frd")).size > 10_000);
}

/** Saves a picture and looks at its head. @param {import("playwright-core").Download} download @param {string} name */
async function isPicture(download, name) {
  const path = join(folder, `${name}.png`);
  await download.saveAs(path);
  const bytes = readFileSync(path);
  assert.equal(bytes.subarray(1, 4).toString(), "PNG");
  assert.equal(bytes.readUInt32BE(16), 1600, "its width");
  assert.ok(bytes.length > 20_000, `${bytes.length} bytes`);
}

test("from a workbook to a CalculiX model and a picture by mouse", inBrowser, async () => {
  const started = Date.now();
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`);
  const press = (/** @type {string} */ words) => page.getByText(words, { exact: true }).first().click();
  await planned(page);
  await page.setInputFiles("#table-file", BOOK);
  await page.waitForSelector("#reading .notice[data-kind=good]");
  await planned(page);
  await press("Pack");
  await page.waitForSelector("canvas[data-drawn]");
  await press("Picture as PNG");
  const [picture] = await Promise.all([page.waitForEvent("download"), press("Save picture")]);
  await isPicture(picture, "mouse");
  await press("Files");
  await press("Make the file");
  await page.waitForSelector(".files [data-state=succeeded]");
  await accessible();
  const [model] = await Promise.all([page.waitForEvent("download"), press("Download")]);
  await solve(model, "mouse");
  console.log(`${((Date.now() - started) / 1000).toFixed(1)} s`);
  assert.ok((Date.now() - started) / 1000 < MOST_S);
  clean();
  await close();
});

test("from pasted cells to a CalculiX model and a picture by keyboard", inBrowser, async () => {
  const started = Date.now();
  const { page, clean, close } = await openPage(browser, `${server.url}/`, {
    context: { permissions: ["clipboard-read", "clipboard-write"] },
  });
  let keys = 0;
  const key = async (/** @type {string} */ name) => {
    keys += 1;
    await page.keyboard.press(name);
  };
  /** Presses Tab until an element has the focus. @param {string} selector */
  const reach = async (selector) => {
    for (let pressed = 0; pressed < 60; pressed += 1) {
      if (await page.evaluate((s) => document.activeElement?.matches(s) ?? false, selector)) return;
      await key("Tab");
    }
    assert.fail(`${selector} is not reached`);
  };
  await planned(page);
  await page.evaluate((cells) => navigator.clipboard.writeText(cells), CELLS);
  await reach("#table");
  await key("Control+v");
  await page.waitForSelector("#reading .notice[data-kind=good]");
  await planned(page);
  await key("Control+Enter");
  await page.waitForSelector("canvas[data-drawn]");
  await reach("#picture");
  await key("Enter");
  await reach("#save-picture");
  const [picture] = await Promise.all([page.waitForEvent("download"), key("Enter")]);
  await isPicture(picture, "keys");
  await reach("[role=tab]");
  await key("ArrowRight");
  await key("ArrowRight");
  await page.waitForSelector("#export-kind");
  await reach("#make-file");
  await key("Enter");
  await page.waitForSelector(".files [data-state=succeeded]");
  await reach(".files a");
  const [model] = await Promise.all([page.waitForEvent("download"), key("Enter")]);
  await solve(model, "keys");
  assert.ok((Date.now() - started) / 1000 < MOST_S);
  console.log(`${((Date.now() - started) / 1000).toFixed(1)} s, ${keys} keys`);
  assert.ok(keys <= MOST_KEYS, `${keys} keys`);
  clean();
  await close();
});
