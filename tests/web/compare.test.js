// Packings beside each other: what differs, linked pictures and slices, and the ways that lead there.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { inBrowser, openPage, SMALL, startBrowser, startServer } from "./harness.js";

/** @type {any} */
let server;
/** @type {any} */
let browser;

before(async () => {
  if (inBrowser.skip) return;
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
});

test("two jobs that differ in one field show that field alone, chosen from the list", inBrowser, async () => {
  await server.pack({ ...SMALL, name: "first" });
  await server.pack({ ...SMALL, name: "second", mix: { ...SMALL.mix, volume_fraction: 0.4 } });
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs`);
  await page.waitForSelector("#jobs tr");
  for (const name of ["first", "second"]) await page.getByLabel(`Choose ${name}`).check();
  await page.click("[data-bulk=compare]");
  await page.waitForURL(/\/compare\?jobs=/);
  await page.waitForFunction(() => document.querySelectorAll(".side canvas[data-drawn]").length === 2);
  const rows = await page.locator("[aria-label=Field] tbody tr").allInnerTexts();
  assert.equal(rows.length, 1, rows.join());
  const [row = ""] = rows;
  assert.match(row, /^mix \u203a volume fraction\s+0\.[45]\s+0\.[45]$/);
  assert.match(await page.innerText("#compared"), /The requests differ in one field\./);
  const grains = await page.locator("[aria-label=Figure] tr", { hasText: "Grains" }).first().innerText();
  assert.match(grains, /Grains\s+\d+\s+\d+\s+[+\u2212]\d+ \([+\u2212]\d/);
  await accessible();
  clean();
  await close();
});

test("a shape that one of two requests has stands in words, beside the other column", inBrowser, async () => {
  const plain = await server.pack({ ...SMALL, name: "round" });
  const mix = { ...SMALL.mix, volume_fraction: 0.3, shape: { type: "polyhedron" } };
  const angular = await server.pack({ ...SMALL, name: "angular", mix });
  for (const width of [1280, 390]) {
    const { page, clean, close } = await openPage(browser, `${server.url}/compare?jobs=${plain.id},${angular.id}`, {
      width,
    });
    const table = page.locator("[aria-label=Field]");
    assert.match(await table.innerText(), /mix \u203a shape\s+\u2013\s+polyhedron, template cuts, faces 24/);
    const over = await table.evaluate((element) => element.scrollWidth - element.clientWidth);
    assert.ok(over <= 0, `${over} px are hidden at ${width} px`);
    clean();
    await close();
  }
});

test("cameras, cuts and slices of the seeds of a point are linked", inBrowser, async () => {
  const study = await (
    await server.ask("/v1/studies", {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify({ template: { specimen: SMALL.specimen, mix: SMALL.mix }, replicates: 3, seed: 1 }),
    })
  ).json();
  await server.ask(`/v1/studies/${study.id}`, { headers: { prefer: "wait=60" } });
  const { page, clean, close } = await openPage(browser, `${server.url}/studies/${study.id}`);
  await page.click("[aria-label='Jobs of point 0']");
  await page.click("dialog a:has-text('Compare')");
  await page.waitForURL(/\/compare\?jobs=/);
  await page.waitForFunction(() => document.querySelectorAll(".side canvas[data-drawn]").length === 3);
  assert.match(await page.innerText("#compared"), /The requests differ in one field\..*seed/s);
  // One picture is turned by keyboard: all are.
  const pictures = () =>
    page.$$eval(".side canvas", (all) => all.map((one) => /** @type {HTMLCanvasElement} */ (one).toDataURL().length));
  const before = await pictures();
  await page.locator(".side canvas").nth(1).focus();
  for (let i = 0; i < 5; i++) await page.keyboard.press("ArrowLeft");
  await page.waitForTimeout(1500);
  const turned = await pictures();
  assert.ok(
    turned.every((length, i) => length !== before[i]),
    `${before} ${turned}`,
  );
  await page.keyboard.press("c");
  await page.waitForFunction(() => /x below 20\s?mm/.test(document.querySelector("#views-words")?.textContent ?? ""));
  await page.focus("#slices-at");
  await page.keyboard.press("ArrowRight");
  await page.waitForFunction(
    () => [...document.querySelectorAll("#slices img")].filter((one) => /z = 20\.1/.test(one.alt)).length === 3,
  );
  clean();
  await close();
});

test("the comparison fits a phone in both schemes, and says what to do without jobs", inBrowser, async () => {
  const jobs = [];
  for (const seed of [1, 2])
    jobs.push(await server.pack({ ...SMALL, seed, distance: { type: "constant", gap_mm: 0.3 } }));
  for (const scheme of /** @type {const} */ (["light", "dark"])) {
    for (const width of [1280, 390]) {
      const address = `${server.url}/compare?jobs=${jobs.map(({ id }) => id).join(",")}`;
      const { page, clean, accessible, close } = await openPage(browser, address, { scheme, width });
      await page.waitForFunction(() => document.querySelectorAll(".side canvas[data-drawn]").length === 2);
      const over = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      assert.ok(over <= 0, `${over} px too wide at ${width}`);
      await accessible();
      clean();
      await close();
    }
  }
  const { page, clean, close } = await openPage(browser, `${server.url}/compare`);
  await page.getByText("Choose 2 to 4 packings").waitFor();
  clean();
  await close();
});
