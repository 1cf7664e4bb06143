// The form: by keyboard alone, faults at their fields, sieves from a spreadsheet, the address, JSON, studies.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { inBrowser, openPage, startBrowser, startServer } from "./harness.js";

/** What Chromium itself says of a plan that was refused: the answer 422 is what these tests ask for. */
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
/**
 * Moves by the tab key until an element has the focus.
 * @param {import("playwright-core").Page} page
 * @param {string} id
 */
async function tabTo(page, id) {
  for (let step = 0; step < 80; step += 1) {
    if (await page.evaluate((wanted) => document.activeElement?.id === wanted, id)) return;
    await page.keyboard.press("Tab");
  }
  assert.fail(`the tab key does not reach ${id}`);
}

test("a mix is typed by keyboard alone, with a fault at its field, corrected, and submitted", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  await tabTo(page, "d_min");
  await page.keyboard.type("4");
  for (const id of ["size_x", "size_y", "size_z"]) {
    await tabTo(page, id);
    await page.keyboard.type(id === "size_y" ? "-60" : "60");
  }
  await page.waitForFunction(() => document.getElementById("size_y-fault")?.textContent);
  const field = page.locator("#size_y");
  assert.equal(await field.getAttribute("aria-invalid"), "true");
  assert.ok((await field.getAttribute("aria-describedby"))?.split(" ").includes("size_y-fault"));
  assert.match(await page.innerText("#size_y-fault"), /-60 is out of range/);
  await tabTo(page, "submit");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => document.activeElement?.id === "size_y");
  await page.keyboard.press("Control+A");
  await page.keyboard.type("60");
  await planned(page);
  assert.equal(await field.getAttribute("aria-invalid"), null);
  assert.equal(await page.innerText("#size_y-fault"), "");
  assert.match(await page.innerText("#forecast"), /^\d+ grains/);
  await tabTo(page, "name");
  await page.keyboard.type("typed");
  await page.keyboard.press("Enter");
  await page.waitForURL(/\/jobs\/[0-9a-f-]{36}$/);
  const id = new URL(page.url()).pathname.split("/").at(-1);
  const job = await (await server.ask(`/v1/jobs/${id}?include=request`)).json();
  assert.equal(job.name, "typed");
  assert.deepEqual(job.request.specimen.size_mm, [60, 60, 60]);
  assert.equal(job.request.mix.d_min_mm, 4);
  clean();
  await close();
});

test("sieves pasted from a spreadsheet, falling, with a head, decimal commas and percent", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  await page.selectOption("#grading", "sieves");
  await page.fill("#points", "Sieve in mm\tPassing in %\n16\t100\n8\t60,5\n4\t36\n2\t21\n");
  await page.waitForFunction(() => /** @type {any} */ (document.getElementById("points")).value.startsWith("2\t21\n"));
  await planned(page);
  const { mix } = await request(page);
  assert.deepEqual(mix.grading, {
    type: "sieves",
    points: [
      [2, 0.21],
      [4, 0.36],
      [8, 0.605],
      [16, 1],
    ],
  });
  await page.fill("#points", "16\t100\n8\tsixty\n4\t30\n2\t12\n");
  await page.waitForFunction(() => document.getElementById("points-fault")?.textContent?.includes("Row 2"));
  assert.equal(await page.getAttribute("#points", "aria-invalid"), "true");
  clean();
  await close();
});

test("points are typed by hand without the service", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  /** @type {string[]} */
  const read = [];
  page.on("request", (sent) => void (sent.url().includes("/v1/mixes/") && read.push(sent.url())));
  await page.selectOption("#grading", "sieves");
  await page.focus("#points");
  await page.keyboard.press("Control+A");
  await page.keyboard.type("16 100\n4 36,5\n8;60\n2");
  await page.waitForFunction(() => document.getElementById("points-fault")?.textContent?.includes("Row 4"));
  await page.keyboard.type(" 21");
  await planned(page);
  assert.deepEqual((await request(page)).mix.grading.points, [
    [2, 0.21],
    [4, 0.365],
    [8, 0.6],
    [16, 1],
  ]);
  await page.keyboard.press("Backspace");
  await page.keyboard.press("Backspace");
  await page.keyboard.type("99");
  await page.waitForFunction(() => document.getElementById("points-fault")?.textContent?.includes("not fall"));
  assert.deepEqual(read, []);
  clean();
  await close();
});

test("the address restores the form, and keeps what the form does not know", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  const given = {
    name: 'a "b", & <i>100 %</i>',
    labels: { "series.1": "TB 7", plus: "1+1=2" },
    specimen: { type: "cylinder", diameter_mm: 80, height_mm: 120 },
    mix: {
      grading: { type: "classes", classes: [{ d_min_mm: 4, d_max_mm: 8, mass_fraction: 1 }] },
      proportions: { cement_kg_m3: 350, water_cement: 0.45 },
      shape: { type: "ellipsoid", ratios: { type: "triangle", k: 0.6 } },
    },
    distance: { type: "constant", gap_mm: 0.05, wall_gap_mm: 0 },
    method: { type: "monte_carlo", stop: { sweeps: 5000, time_s: 20 } },
    seed: 7,
  };
  await page.fill("#json", JSON.stringify(given));
  await planned(page);
  const hash = new URL(page.url()).hash;
  assert.match(hash, /specimen=cylinder&specimen\.diameter_mm=80/);
  await page.goto("about:blank");
  await page.goto(`${server.url}/${hash}`);
  await planned(page);
  assert.deepEqual(await request(page), given);
  assert.equal(await page.inputValue("#width"), "80");
  assert.equal(await page.inputValue("#cement"), "350");
  assert.equal(await page.inputValue("#grading"), "~given");
  await page.fill("#stop", "30");
  await planned(page);
  const changed = { ...given, method: { type: "monte_carlo", stop: { sweeps: 5000, time_s: 30 } } };
  assert.deepEqual(await request(page), changed, "only what was changed has changed");
  clean();
  await close();
});

test("several aggregates are fields of the form", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  const given = JSON.parse(readFileSync(new URL("../../examples/aggregates.json", import.meta.url), "utf8"));
  await page.fill("#json", JSON.stringify(given));
  await planned(page);
  assert.deepEqual(await request(page), given, "the fields say what was given");
  assert.equal(await page.inputValue("#aggregate-1-name"), "gravel 2/8");
  assert.equal(await page.isVisible("#shape"), false, "each aggregate has its shape");
  await page.fill("#aggregate-0-share", "0.3");
  await page.fill("#aggregate-2-share", "0.45");
  await page.fill("#aggregate-2-points", "4\t0\n8\t20\n16\t100");
  await page.selectOption("#aggregate-0-shape", "ellipsoid");
  await page.selectOption("#aggregate-1-grading", "standard");
  await page.selectOption("#aggregate-1-curve", "B8");
  await planned(page);
  const { aggregates } = (await request(page)).mix;
  const [sand, gravel, rock] = given.mix.aggregates;
  assert.deepEqual(aggregates, [
    {
      ...sand,
      share: 0.3,
      shape: { type: "ellipsoid", ratios: { type: "constant", elongation: 0.8, flatness: 0.8 } },
    },
    { ...gravel, grading: { type: "standard", name: "B8" } },
    {
      ...rock,
      share: 0.45,
      grading: {
        type: "sieves",
        points: [
          [4, 0],
          [8, 0.2],
          [16, 1],
        ],
      },
    },
  ]);
  await accessible();
  await page.fill("#aggregate-0-share", "-1");
  await page.waitForSelector("#aggregate-0-share[aria-invalid=true]");
  await page.selectOption("#grading", "standard");
  assert.deepEqual((await request(page)).mix.grading, { type: "standard", name: "A16" });
  assert.equal((await request(page)).mix.aggregates, undefined);
  clean();
  await close();
});

test("aggregates are added and removed by keyboard, and submitted", inBrowser, async () => {
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  for (const id of ["size_x", "size_y", "size_z"]) await page.fill(`#${id}`, "50");
  await page.fill("#d_min", "4");
  await tabTo(page, "add-aggregate");
  await page.keyboard.press("Enter");
  assert.equal(await page.evaluate(() => document.activeElement?.id), "aggregate-1-share");
  await page.keyboard.press("Control+A");
  await page.keyboard.type("0.4");
  await page.waitForFunction(() =>
    /sum to 0\.9/.test(document.getElementById("aggregate-0-share-fault")?.textContent ?? ""),
  );
  await tabTo(page, "aggregate-1-name");
  await page.keyboard.type("angular");
  await page.selectOption("#aggregate-1-grading", "fuller");
  await page.selectOption("#aggregate-1-shape", "polyhedron");
  await page.fill("#aggregate-0-share", "0.7");
  await page.fill("#aggregate-1-share", "0.3");
  await page.fill("#volume_fraction", "0.3");
  await planned(page);
  const grading = { type: "standard", name: "A16" };
  assert.deepEqual((await request(page)).mix.aggregates, [
    { share: 0.7, grading },
    {
      name: "angular",
      share: 0.3,
      grading: { type: "fuller", d_max_mm: 16, exponent: 0.5 },
      shape: { type: "polyhedron", ratios: { type: "constant", elongation: 0.8, flatness: 0.8 } },
    },
  ]);
  assert.equal(await page.locator(".answer svg.chart path.main").count(), 1, "the curve of the whole mix");
  await accessible();
  await page.click("#add-aggregate");
  await page.fill("#aggregate-2-name", "more");
  await planned(page);
  /** The shares of the aggregates. */
  const shares = async () => (await request(page)).mix.aggregates.map((/** @type {any} */ one) => one.share);
  assert.deepEqual(await shares(), [0.7, 0.15, 0.15]);
  await page.click("[data-remove='0']");
  await planned(page);
  assert.deepEqual(await shares(), [0.85, 0.15]);
  await page.reload();
  await planned(page);
  assert.deepEqual(await shares(), [0.85, 0.15]);
  await page.click("#submit");
  await page.waitForURL(/\/jobs\/[0-9a-f-]{36}$/);
  await page.goBack();
  await planned(page);
  await page.click("[data-remove='0']");
  await planned(page);
  const { mix } = await request(page);
  const { type, d_max_mm } = mix.grading;
  assert.deepEqual([mix.aggregates, type, d_max_mm, mix.shape?.type], [undefined, "fuller", 16, "polyhedron"]);
  assert.equal(await page.inputValue("#shape"), "polyhedron");
  clean();
  await close();
});

test("an address that is no request is reported, and the form can be used", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/#specimen.size_mm=[1,2`);
  await planned(page);
  await page.waitForSelector("#report .notice");
  clean();
  await close();
});

test("what is proposed can be taken, and each method has its forecast", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  await page.click("text=Use >> nth=1");
  await planned(page);
  const { distance } = await request(page);
  assert.equal(distance.type, "constant");
  assert.ok(distance.gap_mm > 0.1 && distance.gap_mm < 5, String(distance.gap_mm));
  assert.equal(await page.evaluate(() => document.activeElement?.id), "gap");
  const heads = await page.locator(".answer tbody th").allInnerTexts();
  assert.ok(heads.includes("Random sequential addition") && heads.includes("Growth"), heads.join());
  assert.equal(await page.locator(".answer svg.chart path.other").count(), 3, "the curves A, B and C");
  clean();
  await close();
});

test("answers that are overtaken are dropped", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: /ERR_FAILED|net::/ });
  await planned(page);
  /** @type {((value?: any) => void) | undefined} */
  let release;
  const held = new Promise((resolve) => (release = resolve));
  let first = true;
  await page.route("**/v1/plans", async (route) => {
    const isFirst = first;
    first = false;
    if (isFirst) await held;
    await route.continue().catch(() => {});
  });
  const sent = page.waitForRequest("**/v1/plans");
  await page.fill("#size_x", "50");
  await sent;
  await page.fill("#size_x", "200");
  await planned(page);
  const shown = await page.innerText("#forecast");
  release?.();
  await page.waitForTimeout(300);
  assert.equal(await page.innerText("#forecast"), shown);
  clean();
  await close();
});

test("a study of two fields and seeds is described and submitted", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  for (const id of ["size_x", "size_y", "size_z"]) await page.fill(`#${id}`, "40");
  await page.fill("#d_min", "4");
  await page.check("[name=runs][value=study]");
  await page.selectOption("#vary-0", "/mix/volume_fraction");
  await page.fill("#values-0", "0.4 to 0.6 step 0.1");
  await page.selectOption("#vary-1", "/method");
  await page.fill("#values-1", "rsa, edmd");
  await page.fill("#seeds", "two");
  await page.waitForFunction(() => document.getElementById("seeds-fault")?.textContent);
  await page.fill("#seeds", "2");
  await planned(page);
  assert.match(await page.innerText("#study"), /6 points, 12 jobs/);
  const made = await request(page);
  assert.deepEqual(made.grid, {
    "/mix/volume_fraction": { from: 0.4, to: 0.6, step: 0.1 },
    "/method": [{ type: "rsa" }, { type: "edmd" }],
  });
  await page.reload();
  await planned(page);
  assert.deepEqual(await request(page), made, "the address holds the study");
  await page.fill("#values-1", "rsa, nothing");
  await page.click("#submit");
  await page.waitForFunction(() => document.getElementById("values-1-fault")?.textContent);
  await page.fill("#values-1", "rsa, edmd");
  await planned(page);
  await page.click("#submit");
  await page.waitForURL(/\/studies\/[0-9a-f-]{36}$/);
  clean();
  await close();
});

test("materials are typed in a folded table, and members that it does not show stay", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  assert.equal((await request(page)).materials, undefined, "empty fields give none");
  assert.equal(await page.locator("#matrix-youngs_modulus_gpa").isVisible(), false, "folded away");
  await page.click("#materials summary");
  await page.getByLabel("Matrix: Young's modulus, GPa").fill("25");
  await page.getByLabel("Matrix: Poisson's ratio").fill("0,2");
  await page.getByLabel("Aggregate: Poisson's ratio").fill("0.7");
  await page.waitForFunction(() => document.getElementById("aggregate-poissons_ratio-fault")?.textContent);
  assert.match(await page.innerText("#aggregate-poissons_ratio-fault"), /0\.7 is out of range/);
  await page.getByLabel("Aggregate: Poisson's ratio").fill("");
  await page.getByLabel("Aggregate: Expansion, 1/K").fill("8e-6");
  await planned(page);
  const materials = {
    matrix: { youngs_modulus_gpa: 25, poissons_ratio: 0.2 },
    aggregate: { expansion_1_k: 8e-6 },
  };
  assert.deepEqual((await request(page)).materials, materials);
  // A request with more: it opens the table and keeps what the table does not show.
  const more = { ...materials, matrix: { ...materials.matrix, diffusivity_m2_s: 1e-12 } };
  await page.fill("#json", JSON.stringify({ ...(await request(page)), materials: more }));
  await page.getByLabel("Matrix: Young's modulus, GPa").fill("30");
  await planned(page);
  const kept = (await request(page)).materials;
  assert.deepEqual(kept, { ...more, matrix: { ...more.matrix, youngs_modulus_gpa: 30 } });
  await page.reload();
  await planned(page);
  assert.equal(await page.inputValue("#matrix-youngs_modulus_gpa"), "30");
  assert.equal(await page.locator("#matrix-youngs_modulus_gpa").isVisible(), true, "open where there are some");
  clean();
  await close();
});

test("the commands of the page do what the page does", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  await page.fill("#name", 'it\'s "quoted" $HOME `x`');
  await planned(page);
  await page.check("[name=code][value=curl]");
  const command = await page.innerText("#code pre");
  const { execFileSync } = await import("node:child_process");
  const job = JSON.parse(execFileSync("bash", ["-c", command], { encoding: "utf8" }));
  assert.equal(job.name, 'it\'s "quoted" $HOME `x`');
  await page.check("[name=code][value=python]");
  assert.match(await page.innerText("#code pre"), /client\.submit\(\{/);
  clean();
  await close();
});

test("an address changes nothing but the request", inBrowser, async () => {
  const start =
    "specimen=box&specimen.size_mm=60,60,60&mix.grading=standard&mix.grading.name=A8&mix.volume_fraction=0.4";
  const address = `/#${start}&__proto__.job=1&vary.__proto__.study=1,2&study.replicates=2`;
  const { page, close } = await openPage(browser, server.url + address, { allow: REFUSED });
  await page.waitForSelector(".answer:not([aria-busy])");
  const found = await page.evaluate(() => [/** @type {any} */ ({}).job, /** @type {any} */ ({}).study]);
  assert.deepEqual(found, [undefined, undefined]);
  await close();
});
