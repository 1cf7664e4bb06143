// What helps to fill the form: help at each field, examples, shapes with their picture, members without a field, values
// that are offered, scripts for other programs.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { inBrowser, openPage, startBrowser, startServer } from "./harness.js";

/** What Chromium itself says of a plan that was refused. */
const REFUSED = /status of 422/;

let server, browser;
before(async () => {
  if (inBrowser.skip) return;
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
});

/** The request as the page shows it. @param {import("playwright-core").Page} page */
const request = async (page) => JSON.parse(await page.inputValue("#json"));
/** Waits until the plan of what the fields say is shown. @param {import("playwright-core").Page} page */
const planned = (page) => page.waitForSelector(".answer:not([aria-busy]) #answer dl");

test("each field has help in a sentence, with a link that leads to a document", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  await page.locator("label", { hasText: /^Study$/ }).click();
  await page.waitForSelector("#vary-0");
  // All fields, those of other variants too.
  const fields = await page.evaluate(() =>
    [...document.querySelectorAll(".sections .field:not(td > *), .sections [data-help]")].map((field) => ({
      label: field.querySelector("label, .label")?.textContent,
      help: field.querySelectorAll(".help").length,
    })),
  );
  assert.ok(fields.length > 45, `${fields.length} fields`);
  assert.deepEqual(
    fields.filter((field) => field.help !== 1),
    [],
  );
  const keys = await page.evaluate(async () => {
    const { HELP } = await import(new URL("assets/help.js", document.baseURI).href);
    const parts = /** @type {NodeListOf<HTMLElement>} */ (
      document.querySelectorAll(".sections .field:not(td > *), .sections [data-help]")
    );
    const used = [...parts].map((field) => {
      if (field.dataset.help) return field.dataset.help;
      const control = /** @type {HTMLInputElement} */ (field.querySelector("input, select, textarea"));
      return control.type === "radio" ? control.name : (control.dataset.path ?? control.id);
    });
    return { missing: used.filter((key) => !HELP[key]), pages: Object.values(HELP).map(([, to]) => to) };
  });
  assert.deepEqual(keys.missing, []);
  for (const to of new Set(keys.pages)) {
    const [path, heading] = to.split("#");
    const text = await (await server.ask(`/docs/${path}`)).text();
    if (heading) assert.ok(text.includes(` id="${heading}"`), to);
  }
  // By keyboard: the button comes before its field, opens and closes.
  const help = page.getByRole("button", { name: "Help: Cut-off" });
  await help.focus();
  await page.keyboard.press("Enter");
  const words = page.locator(`#${await help.getAttribute("aria-controls")}`);
  await words.locator("a").waitFor();
  assert.match(await words.innerText(), /^Cut-off: Grains finer than this diameter in mm.*More in the documents/);
  assert.equal(await help.getAttribute("aria-expanded"), "true");
  await accessible();
  await page.keyboard.press("Tab");
  assert.equal(await page.evaluate(() => document.activeElement?.id), "d_min");
  await page.keyboard.press("Tab");
  assert.equal(await page.evaluate(() => document.activeElement?.textContent), "More in the documents");
  await help.focus();
  await page.keyboard.press("Escape");
  assert.equal(await words.isVisible(), false);
  clean();
  await close();
});

test("an example fills the form, by keyboard, and by the address", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { width: 390 });
  await planned(page);
  await page.focus("#examples");
  await page.keyboard.press("Enter");
  await page.waitForSelector("dialog[open] .example");
  assert.ok((await page.locator(".example").count()) >= 24);
  await page.waitForFunction(() => {
    const picture = /** @type {HTMLImageElement | null} */ (document.querySelector(".example img"));
    return picture?.complete && picture.naturalWidth > 0;
  });
  await accessible();
  await page.getByLabel("Search the examples").fill("crushed");
  const crushed = page.locator('[data-example="crushed-rock"]');
  assert.ok((await page.locator(".example:visible").count()) < 6);
  await crushed.focus();
  await page.keyboard.press("Enter");
  await planned(page);
  const { mix } = await request(page);
  assert.deepEqual(mix.shape.ratios, { type: "triangle", k: 0.3 });
  assert.equal(await page.inputValue("#shape"), "polyhedron");
  assert.equal(await page.inputValue("#ratios"), "triangle");
  assert.equal(await page.inputValue("#least_ratio"), "0.3");
  assert.equal(await page.inputValue("#rounding"), "0.05");
  await page.goto(`${server.url}/?example=cylinder`);
  await planned(page);
  assert.equal((await request(page)).specimen.type, "cylinder");
  clean();
  await close();
});

test("every example shows in the form as it is", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  const gallery = await (await server.ask("/assets/gallery.json")).json();
  for (const example of gallery) {
    await page.fill("#json", JSON.stringify(example.request));
    await page.locator("#json").blur();
    assert.deepEqual(await request(page), example.request, example.name);
  }
  clean();
  await close();
});

test("shapes have their ratios, faces and rounding, and a picture that follows", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  assert.equal(await page.locator(".samples").count(), 0);
  await page.selectOption("#shape", "ellipsoid");
  const caption = page.locator(".samples figcaption");
  await caption.waitFor();
  assert.match(await caption.innerText(), /elongation 0\.8, flatness 0\.8/);
  assert.equal(await page.locator(".samples svg g").count(), 8);
  await page.fill("#flatness", "0.5");
  await page.waitForFunction(() =>
    /flatness 0\.5/.test(document.querySelector(".samples figcaption")?.textContent ?? ""),
  );
  await page.getByRole("button", { name: "Crushed" }).click();
  await planned(page);
  await page.waitForFunction(() => (document.querySelectorAll(".samples g:first-child polygon").length ?? 99) < 12);
  assert.equal(await page.inputValue("#faces"), "9");
  await page.fill("#faces", "30");
  await page.fill("#rounding", "0.1");
  await page.waitForFunction(() => document.querySelectorAll(".samples g:first-child polygon").length > 40);
  const { shape } = (await request(page)).mix;
  assert.deepEqual(shape, { type: "polyhedron", faces: 30, rounding: 0.1, ratios: { type: "triangle", k: 0.35 } });
  await page.selectOption("#template", "deformed_cuboid");
  assert.equal(await page.isVisible("#faces"), false);
  assert.ok(await page.isVisible("#displacement"));
  await planned(page);
  await accessible();
  // Each aggregate has its own.
  await page.click("#add-aggregate");
  await page.waitForFunction(() => document.querySelectorAll(".samples svg").length >= 2);
  clean();
  await close();
});

test("members that no field shows are listed, and are removed", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(
    browser,
    `${server.url}/#specimen=box&specimen.size_mm=60,60,60&mix.grading=standard&mix.grading.name=A16&mix.d_min_mm=4` +
      "&mix.volume_fraction=0.5&mix.shape=polyhedron&mix.shape.template_count=8&method=growth&method.stop.sweeps=5000" +
      "&labels.series=TB7",
  );
  await planned(page);
  await page.waitForSelector("#others li");
  assert.deepEqual(await page.locator("#others li code").allInnerTexts(), [
    'labels: {"series":"TB7"}',
    "mix.shape.template_count: 8",
    "method.stop.sweeps: 5000",
  ]);
  await accessible();
  await page.getByRole("button", { name: "Remove method.stop.sweeps" }).click();
  await page.waitForFunction(() => document.querySelectorAll("#others li").length === 2);
  assert.deepEqual((await request(page)).method, { type: "growth" });
  await page.getByRole("button", { name: "Remove all members without a field" }).click();
  await page.waitForSelector("#others", { state: "hidden" });
  assert.deepEqual(Object.keys(await request(page)), ["specimen", "mix", "method"]);
  clean();
  await close();
});

test("the last forecast stays while a field is wrong, and values that can be are offered", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  await page.fill("#volume_fraction", "65");
  const fault = page.locator("#volume_fraction-fault");
  await fault.getByRole("button", { name: "Use 0.65" }).waitFor();
  assert.ok(await page.locator("#answer dl.stale").first().isVisible());
  assert.match(await page.innerText("#answer"), /One field needs another value/);
  await accessible();
  await fault.getByRole("button", { name: "Use 0.65" }).click();
  await planned(page);
  assert.equal((await request(page)).mix.volume_fraction, 0.65);
  assert.equal(await page.locator("#answer .stale").count(), 0);
  // A proposal of the last forecast mends the field.
  await page.fill("#volume_fraction", "1.7");
  await fault.getByRole("button", { name: "Use 1", exact: true }).waitFor();
  const use = page.getByRole("button", { name: /^Use the volume fraction/ });
  const proposed = Number(/[\d.]+$/.exec((await use.getAttribute("aria-label")) ?? "")?.[0]);
  await use.click();
  await planned(page);
  assert.equal((await request(page)).mix.volume_fraction, proposed);
  // A length is understood with its unit; one beyond the bound is offered the bound.
  await page.fill("#size_x", "100 mm");
  await planned(page);
  assert.equal((await request(page)).specimen.size_mm[0], 100);
  await page.fill("#size_x", "1e9");
  await page.getByRole("button", { name: "Use 1000000 mm" }).waitFor();
  clean();
  await close();
});

test("the request is a script for five programs", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  const shown = async (/** @type {string} */ kind, /** @type {RegExp} */ words) => {
    await page.locator("#code label", { hasText: kind }).click();
    await page.waitForFunction(
      (pattern) => new RegExp(pattern, "s").test(document.querySelector("#code pre")?.textContent ?? ""),
      words.source,
    );
  };
  await shown("curl", /^curl -sS --fail-with-body .*\/v1\/jobs -d '/);
  await shown("Python", /client\.submit/);
  await shown("PowerShell", /"name": "A16".*\n'@\n.*Invoke-RestMethod .*packing\.vtp/);
  await shown("MATLAB", /""name"": ""A16"".*webwrite.*packing\.vtp/);
  const text = await page.innerText("#code pre");
  assert.doesNotMatch(text, /-sf/);
  clean();
  await close();
});
