// Gradings of standards and laws in the form, and the curve over the band that it is compared with.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { inBrowser, openPage, startBrowser, startServer } from "./harness.js";

let server, browser;
before(async () => {
  if (inBrowser.skip) return;
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
});

/** The grading of the request as the page shows it. @param {import("playwright-core").Page} page */
const grading = async (page) => JSON.parse(await page.inputValue("#json")).mix.grading;
/** Waits until the plan of what the fields say is shown. @param {import("playwright-core").Page} page */
const planned = (page) => page.waitForSelector(".answer:not([aria-busy]) #answer dl");

test("a band of a standard is chosen by its name, and the curve is drawn over it", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  await page.waitForFunction(() => document.querySelectorAll("#standard option").length > 5);
  assert.equal(await page.isVisible("#limit"), false, "A16 is one curve");
  await page.selectOption("#standard", "ASTM C33");
  const names = await page.locator("#curve option").allInnerTexts();
  assert.ok(names.includes("57") && !names.includes("A16"), names.join());
  await page.selectOption("#curve", "57");
  await page.fill("#d_min", "4.75");
  await planned(page);
  assert.deepEqual(await grading(page), { type: "standard", standard: "ASTM C33", name: "57" });
  assert.equal(await page.locator(".answer svg.chart path.band").count(), 1);
  assert.match(await page.innerText(".answer"), /Within the limits of ASTM C33 57\./);
  await page.selectOption("#limit", "lower");
  await planned(page);
  assert.equal((await grading(page)).curve, "lower");
  await page.selectOption("#compared", "IS 383 graded 20 mm");
  await page.waitForFunction(() => /Outside of IS 383/.test(document.querySelector(".answer")?.textContent ?? ""));
  assert.match(await page.innerText(".answer"), /at \d of 4 sieves, by [\d.]+\u202f% of the mass at \d+\u202fmm/);
  await accessible();
  // The choice stays with the next plan.
  await page.fill("#d_min", "5");
  await planned(page);
  assert.equal(await page.inputValue("#compared"), "IS 383 graded 20 mm");
  await page.selectOption("#compared", "");
  assert.equal(await page.locator(".answer svg.chart path.band").count(), 0);
  // Back to a curve without limits.
  await page.selectOption("#standard", "DIN 1045-2");
  await planned(page);
  assert.deepEqual(await grading(page), { type: "standard", name: "A8" });
  assert.equal(await page.isVisible("#limit"), false);
  clean();
  await close();
});

test("a law is typed by its parameters, and drawn", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: /status of 422/ });
  await planned(page);
  await page.selectOption("#grading", "lognormal");
  await page.fill("#d_max", "");
  await planned(page);
  assert.deepEqual(await grading(page), { type: "lognormal", median_mm: 8, sigma: 0.4 });
  assert.match(await page.innerText(".answer"), /d_max_mm, 27\.\d+ mm, which 99\.9 % of the mass is finer than/);
  assert.equal(await page.locator(".answer svg.chart path.main").count(), 1);
  await page.selectOption("#by", "number");
  await page.fill("#sigma", "9");
  await page.waitForFunction(() => document.getElementById("sigma-fault")?.textContent);
  assert.match(await page.innerText("#sigma-fault"), /at most 3/);
  await page.fill("#sigma", "0.2");
  await planned(page);
  assert.deepEqual(await grading(page), { type: "lognormal", median_mm: 8, sigma: 0.2, by: "number" });
  await page.selectOption("#grading", "dreux_gorisse");
  await page.fill("#d_max", "16");
  await planned(page);
  assert.deepEqual(await grading(page), { type: "dreux_gorisse", d_max_mm: 16, k_percent: 0 });
  await accessible();
  clean();
  await close();
});

test("a mix has a number of grains in place of a volume fraction", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: /status of 422/ });
  await planned(page);
  await page.check('[name="content"][value="count"]');
  await planned(page);
  const { mix } = JSON.parse(await page.inputValue("#json"));
  assert.deepEqual([mix.count, mix.volume_fraction], [1000, undefined]);
  assert.match(await page.innerText("#forecast"), /^1\u202f?000 grains/);
  await page.fill("#count", "10000000");
  await page.waitForFunction(() =>
    /must be at most \d+/.test(document.getElementById("count-fault")?.textContent ?? ""),
  );
  await page.fill(
    "#json",
    JSON.stringify({ specimen: { type: "box", size_mm: [60, 60, 60] }, mix: { ...mix, count: 50 } }),
  );
  await planned(page);
  assert.equal(await page.inputValue("#count"), "50");
  assert.equal(await page.isVisible("#volume_fraction"), false);
  clean();
  await close();
});

test(
  "the shares of aggregates are set to meet a band, and the figures of the aggregate are told",
  inBrowser,
  async () => {
    const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`);
    await planned(page);
    const grading = (points) => ({ type: "sieves", points });
    const aggregates = [
      {
        name: "sand",
        share: 0.2,
        grading: grading([
          [0.15, 0.02],
          [0.6, 0.4],
          [2, 0.85],
          [5, 1],
        ]),
      },
      {
        name: "gravel",
        share: 0.4,
        grading: grading([
          [2, 0],
          [5, 0.1],
          [10, 0.5],
          [20, 1],
        ]),
      },
      {
        name: "stone",
        share: 0.4,
        grading: grading([
          [20, 0.0],
          [40, 1],
        ]),
      },
    ];
    const mix = { aggregates, d_min_mm: 5, volume_fraction: 0.3 };
    await page.fill("#json", JSON.stringify({ specimen: { type: "box", size_mm: [150, 150, 150] }, mix }));
    await planned(page);
    await page.click("#blend");
    await page.waitForFunction(() => /Choose a grading/.test(document.querySelector(".answer")?.textContent ?? ""));
    await page.selectOption("#compared", "BS 882 all-in 20 mm");
    await page.click("#blend");
    await page.waitForFunction(() => /Shares set/.test(document.querySelector(".answer")?.textContent ?? ""));
    assert.match(await page.innerText(".answer"), /Within the limits of BS 882 all-in 20 mm\./);
    const found = JSON.parse(await page.inputValue("#json")).mix.aggregates;
    const sum = found.reduce((all, one) => all + one.share, 0);
    assert.ok(Math.abs(sum - 1) < 1e-5 && found[0].share > 0.3, JSON.stringify(found));
    await page.click("summary:has-text('Figures of the aggregate')");
    await page.waitForSelector(".figures-of-aggregate tbody");
    const figures = await page.innerText(".figures-of-aggregate");
    for (const words of [
      /Fineness modulus, ASTM C125\s+\d\.\d/,
      /Paste film on the grains/,
      /residual packing density 0\.64/,
    ])
      assert.match(figures, words);
    await accessible();
    // A curve is met, too, and what has no share goes.
    await page.selectOption("#compared", "DIN 1045-2 C8");
    await page.click("#blend");
    await page.waitForFunction(() => /Removed/.test(document.querySelector(".answer")?.textContent ?? ""));
    assert.match(await page.innerText(".answer"), /Differs from DIN 1045-2 C8 by up to/);
    clean();
    await close();
  },
);

test("the smallest specimen for a number of grains is proposed and used", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  await page.check('[name="content"][value="count"]');
  await planned(page);
  const before = JSON.parse(await page.inputValue("#json")).specimen.size_mm[0];
  const use = page.locator('button[aria-label^="Use the specimen of"]');
  await use.click();
  await planned(page);
  const after = JSON.parse(await page.inputValue("#json")).specimen.size_mm[0];
  assert.ok(after < before && after > 0.1 * before, `${before} ${after}`);
  assert.match(await page.innerText(".answer"), /Success\s+(?:9\d|100)/);
  clean();
  await close();
});
