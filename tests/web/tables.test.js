// Tables of gradings and recipes on the page: pasted, dropped, or chosen as a file; shown as understood, and chosen from.
import assert from "node:assert/strict";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { inBrowser, openPage, startBrowser, startServer } from "./harness.js";

/** What Chromium itself says of a plan that was refused: the answer 422 is what these tests ask for. */
const REFUSED = /status of 422/;
const CURVE = "Siebweite (mm);Durchgang (%)\n0,25;8\n1;24\n4;51,5\n8;74\n16;100\n";
const POINTS = [
  [0.25, 0.08],
  [1, 0.24],
  [4, 0.515],
  [8, 0.74],
  [16, 1],
];
const TWO =
  "Sieve (mm);Sand 0/4, passing %;Gravel 4/16, passing %\n16;100;100\n8;100;40\n4;98;5\n1;55;1\n0,25;12;0\n0,063;0;0\n";
const RECIPE =
  "Material;kg/m3;Density kg/m3\nCement CEM I 42,5 R;350;3100\nWater;175;1000\nSand 0/4;750;2650\nGravel 4/16;1080;2680\n";

let server, browser, folder;
before(async () => {
  if (inBrowser.skip) return;
  folder = mkdtempSync(join(tmpdir(), "packstone-tables-"));
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
  if (folder) rmSync(folder, { recursive: true, force: true });
});

/** The request as the page shows it. @param {import("playwright-core").Page} page */
const request = async (page) => JSON.parse(await page.inputValue("#json"));
/** Waits until the plan of what the fields say is shown. @param {import("playwright-core").Page} page */
const planned = (page) => page.waitForSelector(".answer:not([aria-busy]) #answer dl");
/**
 * Pastes a text into a field, as a browser does.
 * @param {import("playwright-core").Page} page
 * @param {string} field
 * @param {string} words
 */
const paste = (page, field, words) =>
  page.locator(field).evaluate((element, text) => {
    const clipboardData = new DataTransfer();
    clipboardData.setData("text/plain", text);
    element.focus();
    element.dispatchEvent(new ClipboardEvent("paste", { clipboardData, bubbles: true, cancelable: true }));
  }, words);
/** Waits for what a table was understood as. @param {import("playwright-core").Page} page @param {RegExp} words */
const understood = (page, words) =>
  page.waitForFunction(
    ([source, flags]) => new RegExp(source, flags).test(document.querySelector("#reading .notice")?.textContent ?? ""),
    [words.source, words.flags],
  );

test("a table that is pasted fills the form, and is shown as curve and table", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  await paste(page, "#table", CURVE);
  await understood(page, /one reading/);
  await planned(page);
  const { mix } = await request(page);
  assert.deepEqual(mix.grading.points, POINTS);
  assert.equal(mix.volume_fraction, 0.6, "what the table does not say stays");
  assert.equal(await page.inputValue("#grading"), "sieves");
  assert.equal(await page.locator("#reading svg.chart path.main").count(), 1);
  const cells = await page.locator("#reading tbody tr").first().locator("th, td").allInnerTexts();
  assert.deepEqual(cells.slice(0, 2), ["0.25", "8"]);
  assert.match(await page.innerText("#reading summary"), /passing, sieves in mm/);
  await accessible();
  clean();
  await close();
});

test("of several readings one is chosen by one click", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  const before = (await request(page)).mix.grading;
  await paste(page, "#table", TWO);
  await understood(page, /choose one/);
  assert.deepEqual((await request(page)).mix.grading, before, "nothing is taken before");
  const candidates = page.locator("#reading .candidates figure");
  const count = await candidates.count();
  assert.ok(count >= 2, `${count} candidates`);
  assert.equal(await page.locator("#reading .candidates svg.chart path.main").count(), count);
  await accessible();
  const gravel = candidates.filter({ hasText: "Gravel" }).first();
  await gravel.locator("button").click();
  await planned(page);
  const { points } = (await request(page)).mix.grading;
  assert.equal(points.find((/** @type {number[]} */ [mm]) => mm === 4)?.[1], 0.05);
  assert.equal(await gravel.locator("button").getAttribute("aria-pressed"), "true");
  await candidates.filter({ hasText: "Sand" }).first().locator("button").click();
  await planned(page);
  const sand = (await request(page)).mix.grading.points;
  assert.equal(sand.find((/** @type {number[]} */ [mm]) => mm === 4)?.[1], 0.98);
  // Or both, as the aggregates of one mix.
  await page.click(`button:has-text("Use all ${count} as aggregates")`);
  await planned(page);
  const { aggregates, volume_fraction } = (await request(page)).mix;
  assert.deepEqual(
    aggregates.map((/** @type {any} */ one) => [one.name, one.share]),
    [
      ["Sand 0/4", 0.5],
      ["Gravel 4/16", 0.5],
    ],
  );
  assert.ok(volume_fraction > 0, "the amount stays");
  await page.fill("#d_placed", "8");
  await planned(page);
  assert.equal((await request(page)).mix.d_max_mm, 8);
  clean();
  await close();
});

test("a table that cannot be read says row and reason, and changes nothing", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  const given = await request(page);
  await paste(page, "#table", "Sieve (mm);Passing (%)\n16;100\n8;60\n4;x5\n2;21\n1;12\n");
  await understood(page, /not understood/);
  assert.match(await page.innerText("#reading .notes"), /Row 4/);
  assert.deepEqual(await request(page), given);
  await accessible();
  // An emptied field shows nothing.
  await page.fill("#table", "");
  await page.waitForFunction(() => !document.getElementById("reading")?.firstChild);
  clean();
  await close();
});

test("files are chosen and dropped", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  const file = join(folder, "curve.csv");
  writeFileSync(file, Buffer.from(`\ufeff${CURVE}`, "utf16le"));
  await page.setInputFiles("#table-file", file);
  await understood(page, /one reading/);
  await planned(page);
  assert.deepEqual((await request(page)).mix.grading.points, POINTS);
  // Onto the field of a curve: its points.
  await page.locator("#points").evaluate(
    (element, text) => {
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File([text], "other.csv", { type: "text/csv" }));
      element.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
    },
    CURVE.replace("51,5", "50"),
  );
  await page.waitForFunction(() => /** @type {any} */ (document.getElementById("points")).value.includes("4\t50\n"));
  await planned(page);
  assert.equal((await request(page)).mix.grading.points[2][1], 0.5);
  assert.match(await page.innerText(".field:has(#points) .reading"), /one reading/);
  clean();
  await close();
});

test("a recipe fills aggregates and proportions", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  await paste(page, "#table", RECIPE);
  await understood(page, /reading/);
  await page.waitForSelector("#aggregate-1-mass");
  assert.equal(await page.inputValue("#aggregate-0-mass"), "750");
  assert.equal(await page.inputValue("#aggregate-1-density"), "2680");
  assert.equal(await page.inputValue("#aggregate-1-name"), "Gravel 4/16");
  assert.equal(await page.locator("#aggregate-0-share").count(), 0);
  const { mix } = await request(page);
  assert.equal(mix.volume_fraction, undefined, "it follows from the masses");
  assert.equal(mix.proportions.cement_kg_m3, 350);
  assert.equal(await page.inputValue("#cement"), "350");
  assert.match(await page.innerText("#reading"), /Sum of volumes without air/);
  await planned(page);
  await accessible();
  // What is pasted into the field of an aggregate is its curve.
  await page.selectOption("#aggregate-1-grading", "sieves");
  await paste(page, "#aggregate-1-points", "Sieve mm;Passing %\n2;0\n4;5\n8;40\n16;100\n");
  await page.waitForFunction(() =>
    /** @type {any} */ (document.getElementById("aggregate-1-points")).value.startsWith("2\t0\n"),
  );
  assert.deepEqual((await request(page)).mix.aggregates[1].grading.points[2], [8, 0.4]);
  // A mass is divided and given back as a share is.
  await page.click("#add-aggregate");
  assert.deepEqual(
    (await request(page)).mix.aggregates.map((/** @type {any} */ one) => one.mass_kg_m3),
    [750, 540, 540],
  );
  await page.click("[data-remove='2']");
  await page.click("[data-remove='1']");
  const one = (await request(page)).mix;
  assert.deepEqual([one.aggregates, one.volume_fraction], [undefined, undefined], "the proportions stay");
  clean();
  await close();
});
