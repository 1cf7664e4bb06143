// Numbers: no digit is lost between a person and the service, decimal commas are understood in every field, and what is
// wrong is said at its field, in view.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { faultOf, listOf, numberOf, offersOf, parse } from "../../web/numbers.js";
import { inBrowser, openPage, SMALL, startBrowser, startServer, chooseFile } from "./harness.js";

const REFUSED = /status of 4(00|22)/;
/** A seed that a service draws: it has 16 digits. */
const SEED = 8649633981916693;

let server, browser;
before(async () => {
  if (inBrowser.skip) return;
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
});

/** @param {import("playwright-core").Page} page */
const request = async (page) => JSON.parse(await page.inputValue("#json"));
/** @param {import("playwright-core").Page} page */
const planned = (page) => page.waitForSelector(".answer:not([aria-busy]) #answer dl");
/** Whether an element lies in the window. @param {import("playwright-core").Page} page @param {string} selector */
const inView = (page, selector) =>
  page.locator(selector).evaluate((element) => {
    const { top, bottom, height } = element.getBoundingClientRect();
    const bar = /** @type {Element} */ (document.querySelector(".submit")).getBoundingClientRect();
    return height > 0 && top >= 0 && bottom <= Math.min(innerHeight, bar.top);
  });

test("numbers are read with points and commas, and whole numbers exactly", () => {
  for (const [words, value] of /** @type {[string, number | string][]} */ ([
    ["0.4", 0.4],
    ["0,4", 0.4],
    [" ,4 ", 0.4],
    ["-1,5e-3", -0.0015],
    ["\u22122", -2],
    ["9007199254740991", 9007199254740991],
    ["1.000,5", "1.000,5"],
    ["1,2,3", "1,2,3"],
    ["four", "four"],
    ["", ""],
    ["1e999", "1e999"],
  ]))
    assert.equal(numberOf(words), value, words);
  for (const [words, unit, value] of /** @type {[string, string, number | string][]} */ ([
    ["100 mm", "mm", 100],
    ["100mm", "mm", 100],
    ["0,4 mm", "mm", 0.4],
    ["1e2 mm", "mm", 100],
    ["15 cm", "mm", 150],
    ["0.15 m", "mm", 150],
    ["63 \u00b5m", "mm", 0.063],
    ["50 %", "", 0.5],
    ["65,5\u202f%", "", 0.655],
    ["12 %", "%", 12],
    ["10 min", "s", 600],
    ["320 kg/m3", "kg/m\u00b3", 320],
    // What is no unit of the field is refused by the server.
    ["50 %", "mm", "50 %"],
    ["100 mm", "", "100 mm"],
    ["100 in", "mm", "100 in"],
    ["1 constructor", "mm", "1 constructor"],
    ["1.000,5 mm", "mm", "1.000,5 mm"],
    ["mm", "mm", "mm"],
  ]))
    assert.equal(numberOf(words, unit), value, `${words} in ${unit}`);
  assert.equal(faultOf(String(SEED)), "");
  assert.match(faultOf("9007199254740993"), /^9007199254740993 is out of range/);
  assert.equal(parse(`{"seed": ${SEED}, "__proto__": 1}`).seed, SEED);
  assert.deepEqual(Object.keys(parse('{"__proto__": 1}')), ["__proto__"]);
});

test("values that can be are offered in place of those that cannot", () => {
  for (const [words, fault, unit, offers] of /** @type {[string, string, string, string[]][]} */ ([
    ["65", "65 is out of range: must be at least 1e-9 and at most 1", "", ["0.65", "1"]],
    ["1,2", "1.2 is out of range: must be at least 1e-9 and at most 1", "", ["0.012", "1"]],
    ["165", "165 is out of range: must be at least 1e-9 and at most 1", "", ["1"]],
    ["165 %", "1.65 is out of range: must be at least 1e-9 and at most 1", "", ["0.0165", "1"]],
    ["100 in", "a text is not a number", "mm", []],
    ["20 mm", "20 is out of range: must be a number from 0 to 16", "mm", ["16"]],
    ["-60", "-60 is out of range: must be at least 1e-6 and at most 1000000 mm", "mm", ["0.000001"]],
    ["0.1", "0.1 is out of range: must be at least 0.25 mm, below which the grading says nothing", "mm", ["0.25"]],
    ["3", "3 is out of range: must be a whole number from 6 to 60", "", ["6"]],
    ["99", "99 is out of range: must be a whole number from 6 to 60", "", ["60"]],
    ["10", "10 mm is too small: the largest grain is 16 mm, and must fit", "mm", ["16"]],
    ["10", "10 mm is too small: the largest grain is 16 mm (17 mm with its distance), and must fit", "mm", ["17"]],
    ["0.9", "the grains to place have a volume fraction of 0.4500: spheres fill at most 0.3; lower it", "", ["0.6"]],
    ["20", "20 is out of range: must be less than the largest diameter 16 mm", "mm", []],
    ["", "is missing", "mm", []],
    ["0.5", "", "", []],
  ])) {
    assert.deepEqual(offersOf(words, fault, unit), offers, `${words}: ${fault}`);
  }
});

test("lists are read with decimal commas, or refused where they can be read in two ways", () => {
  for (const [words, parts] of /** @type {[string, string[]][]} */ ([
    ["0,4; 0,5; 0,6", ["0,4", "0,5", "0,6"]],
    ["0,4;0,5", ["0,4", "0,5"]],
    ["0,4\t0,5", ["0,4", "0,5"]],
    ["0,4\n0,5\n", ["0,4", "0,5"]],
    ["1; 2,5", ["1", "2,5"]],
    ["0,4 0,5 0,6", ["0,4", "0,5", "0,6"]],
    ["0,4, 0,5, 0,6", ["0,4", "0,5", "0,6"]],
    ["0.4, 0.5", ["0.4", "0.5"]],
    ["0.4,0.5", ["0.4", "0.5"]],
    ["0.6,0.4,0.5", ["0.6", "0.4", "0.5"]],
    ["0.4 0.5", ["0.4", "0.5"]],
    ["1, 2", ["1", "2"]],
    ["10,20,30", ["10", "20", "30"]],
    ["30,20,10", ["30", "20", "10"]],
    ["4", ["4"]],
    ["rsa, edmd", ["rsa", "edmd"]],
    ["A16,B16,C16", ["A16", "B16", "C16"]],
    ["rsa edmd", ["rsa", "edmd"]],
    ["", []],
  ]))
    assert.deepEqual(listOf(words), { parts, fault: "" }, words);
  for (const words of ["0,4", "2,4", "0,4,0,5", "0,4,0,5,0,6", "1,2 3", "1,2, 3,4", "1,2 3,4", "0.4,0,5", "0.4 0,5"])
    assert.match(listOf(words).fault, /can be read in two ways/, words);
});

test("a seed is shown with all its digits, and is never sent as another", inBrowser, async () => {
  const job = await server.pack({ ...SMALL, seed: SEED });
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs/${job.id}`);
  await page.waitForSelector("#result section dl");
  const seed = page.locator("#result dt", { hasText: "Seed" }).locator("xpath=following-sibling::dd");
  assert.equal(await seed.textContent(), String(SEED));
  await page.click("#tab-request");
  assert.match((await page.textContent("#panel-request pre")) ?? "", new RegExp(`"seed": ${SEED}\\b`));
  clean();
  await close();
  const study = await (
    await server.ask("/v1/studies", {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify({
        template: { specimen: SMALL.specimen, mix: SMALL.mix },
        grid: { "/seed": [SEED, SEED + 1] },
        seed: SEED,
      }),
    })
  ).json();
  const opened = await openPage(browser, `${server.url}/studies/${study.id}`);
  await opened.page.waitForSelector("#points tbody tr");
  assert.match(await opened.page.innerText("#facts"), new RegExp(`\\b${SEED}\\b`));
  assert.match(await opened.page.innerText("#points"), new RegExp(`\\b${SEED}\\b[^]*\\b${SEED + 1}\\b`));
  opened.clean();
  await opened.close();
});

test("a whole number that would become another one is a fault", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  await page.fill("#seed", String(SEED));
  await planned(page);
  assert.equal((await request(page)).seed, SEED);
  await page.fill("#seed", "9007199254740993");
  await page.waitForSelector("#seed[aria-invalid=true]");
  assert.match(await page.innerText("#seed-fault"), /9007199254740993 is out of range/);
  await page.fill("#seed", "1");
  await planned(page);
  const given = JSON.stringify(await request(page));
  await page.fill("#json", given.replace('"seed":1', '"seed":9007199254740993'));
  assert.match(await page.innerText("#json-fault"), /9007199254740993 is out of range/);
  assert.equal(await page.inputValue("#seed"), "1", "the form stays as it was");
  await page.goto("about:blank");
  await page.goto(
    `${server.url}/#specimen=box&specimen.size_mm=40,40,40&mix.volume_fraction=0.5&seed=9007199254740993`,
  );
  await page.waitForSelector("#report .notice");
  assert.match(await page.innerText("#report"), /9007199254740993 is out of range/);
  clean();
  await close();
});

test("a number may be typed with its unit", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  await page.fill("#volume_fraction", "50 %");
  await page.fill("#size_x", "8 cm");
  await page.fill("#size_y", "100 mm");
  await planned(page);
  const made = await request(page);
  assert.deepEqual([made.mix.volume_fraction, made.specimen.size_mm], [0.5, [80, 100, 100]]);
  // A field that is left has the number in its own unit.
  await page.locator("#size_y").blur();
  assert.deepEqual(await Promise.all(["#volume_fraction", "#size_x", "#size_y"].map((id) => page.inputValue(id))), [
    "0.5",
    "80",
    "100",
  ]);
  clean();
  await close();
});

test("values of a study have decimal commas, and their faults stand at their field, in view", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED, height: 700 });
  await planned(page);
  for (const id of ["size_x", "size_y", "size_z"]) await page.fill(`#${id}`, "40,5");
  await page.fill("#d_min", "4,5");
  await page.check("[name=runs][value=study]");
  await page.selectOption("#vary-0", "/mix/volume_fraction");
  for (const [words, values] of /** @type {[string, any][]} */ ([
    ["0,4; 0,5; 0,6", [0.4, 0.5, 0.6]],
    ["0,4 to 0,6 step 0,1", { from: 0.4, to: 0.6, step: 0.1 }],
  ])) {
    await page.fill("#values-0", words);
    await planned(page);
    const made = await request(page);
    assert.deepEqual(made.grid["/mix/volume_fraction"], values, words);
    assert.deepEqual(made.template.specimen.size_mm, [40.5, 40.5, 40.5]);
    assert.equal(made.template.mix.d_min_mm, 4.5);
    assert.match(await page.innerText("#study"), /3 points/);
  }
  // Of the values, of the first point, and of a point that only the submission looks at.
  for (const [words, says] of /** @type {[string, RegExp][]} */ ([
    ["0,4", /two ways/],
    ["1,5; 0,5", /1\.5/],
    ["half; 0,5", /half/],
    ["0,5; 1,5", /1\.5/],
  ])) {
    await page.fill("#values-0", words);
    await page.evaluate(() => scrollTo(0, 0));
    await page.click("#submit");
    await page.waitForFunction(() => document.activeElement?.id === "values-0");
    assert.match(await page.innerText("#values-0-fault"), says, words);
    assert.equal(await page.innerText("#volume_fraction-fault"), "", words);
    assert.ok(await inView(page, "#values-0-fault"), `the fault of ${words} is in view`);
  }
  // While the values are not touched, the count of faults leads to the field.
  await page.fill("#values-0", "1,5; 0,5");
  await page.waitForSelector("#forecast button");
  await page.evaluate(() => scrollTo(0, 0));
  await page.click("#forecast button");
  assert.ok(await inView(page, "#values-0-fault"));
  clean();
  await close();
});

test("options of exports have decimal commas, and their faults stand at their fields", inBrowser, async () => {
  const job = await server.pack(SMALL);
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs/${job.id}`, {
    allow: REFUSED,
  });
  await chooseFile(page, "FFT", "voxels raw");
  await page.locator("details summary", { hasText: "Options" }).click();
  await page.fill("#option-voxel_mm", "0");
  await page.waitForFunction(() => document.getElementById("option-voxel_mm-fault")?.textContent);
  assert.equal(await page.getAttribute("#option-voxel_mm", "aria-invalid"), "true");
  await accessible();
  await page.fill("#option-voxel_mm", "two");
  await page.waitForFunction(() => /two/.test(document.getElementById("option-voxel_mm-fault")?.textContent ?? ""));
  await page.fill("#option-voxel_mm", "2,5");
  await page.waitForFunction(() => document.getElementById("option-voxel_mm-fault")?.textContent === "");
  await page.getByRole("button", { name: "Make the file" }).click();
  await page.locator(".files li", { hasText: "Voxels as raw bytes" }).locator(".badge[data-state=succeeded]").waitFor();
  const [made] = (await (await server.ask(`/v1/jobs/${job.id}/exports`)).json()).items;
  assert.equal(made.options.voxel_mm, 2.5);
  assert.deepEqual(made.report.shape, [16, 16, 16]);
  clean();
  await close();
});

test("what the service decides is drawn as the service has it", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await planned(page);
  /** The left end of what is shaded, as a diameter: the axis is that of the labels of 0.5 and 8 mm. */
  const shadedFrom = () =>
    page.locator(".answer svg.chart").evaluate((svg) => {
      const x = (/** @type {string} */ label) =>
        Number([...svg.querySelectorAll("text")].find((text) => text.textContent === label)?.getAttribute("x"));
      const slope = (x("8") - x("0.5")) / Math.log(8 / 0.5);
      const left = Number(svg.querySelector("rect.area")?.getAttribute("x"));
      return 8 * Math.exp((left - x("8")) / slope);
    });
  const near = async (/** @type {number} */ mm) => {
    const from = await shadedFrom();
    assert.ok(Math.abs(from / mm - 1) < 0.02, `${from} mm, not ${mm} mm`);
  };
  await page.fill("#d_min", "");
  await planned(page);
  await near(2);
  assert.equal(await page.getAttribute("#d_min", "placeholder"), "2");
  await page.fill("#d_min", "4");
  await planned(page);
  await near(4);
  // Sieves have no grains below the finest of them.
  await page.fill("#d_min", "");
  await page.selectOption("#grading", "sieves");
  await page.fill("#points", "0.5 0\n1 0\n8 60\n16 100");
  await planned(page);
  await near(1);
  // In a study the plan is that of the first point, and so is the curve.
  await page.selectOption("#grading", "standard");
  await page.fill("#d_min", "4");
  await page.check("[name=runs][value=study]");
  await page.selectOption("#vary-0", "/mix/d_min_mm");
  await page.fill("#values-0", "8; 4");
  await planned(page);
  await near(8);
  // The largest grain of a grading that the page does not draw.
  await page.check("[name=runs][value=job]");
  const given = { ...SMALL, mix: { grading: { type: "diameters", diameters_mm: [10, 8] } } };
  await page.fill("#json", JSON.stringify(given));
  await planned(page);
  await page.waitForSelector("#drawing .grain");
  assert.match((await page.getAttribute("#drawing svg", "aria-label")) ?? "", /largest grain 10 mm/);
  clean();
  await close();
});

test("defaults that the page states are those of the interface", inBrowser, async () => {
  const { components } = await (await server.ask("/openapi.json")).json();
  const { exports } = await (await server.ask("/v1/capabilities")).json();
  const { page, clean, close } = await openPage(browser, `${server.url}/`);
  await planned(page);
  const stated = await page.evaluate(async () => {
    const { fields } = await import(/** @type {any} */ ("/assets/export-options.js"));
    const air = document.getElementById("air")?.getAttribute("placeholder");
    return { air, known: Object.keys(fields([], () => {})) };
  });
  assert.match(components.schemas.MixProportions.properties.air.description, new RegExp(`\\b${stated.air}\\b`));
  /** @type {string[]} */
  const wrong = [];
  for (const { type, formats } of exports)
    for (const { name: format, options } of formats) {
      const shown = await page.evaluate(async (/** @type {string[]} */ names) => {
        const { fields } = await import(/** @type {any} */ ("/assets/export-options.js"));
        const made = fields(names, () => {});
        const value = (/** @type {string} */ name) => {
          for (const part of made.elements) {
            const field = part.querySelector(`#option-${name}`);
            if (field)
              return field.type === "checkbox" ? field.checked : field.placeholder || field.options?.[0]?.value || null;
          }
          return undefined;
        };
        return names.map((name) => [name, value(name)]);
      }, options);
      const form = components.schemas.ExportRequest.oneOf.find(
        (/** @type {any} */ { properties: { type: kind, format: forms } }) =>
          kind.enum[0] === type && (!forms.enum || forms.enum[0] === format),
      );
      for (const [name, value] of shown) {
        const { default: standard = null } = form.properties[name];
        if (String(value) !== String(standard)) wrong.push(`${type} ${format} ${name}: ${value}, not ${standard}`);
      }
    }
  // Fields that several types share have the defaults of the others in their hints, or an empty first choice.
  assert.deepEqual(wrong, [
    "mesh geo segments: null, not 16",
    "deck zip elements: null, not voxels",
    "properties json cells: null, not 128",
    "properties vti cells: null, not 128",
  ]);
  clean();
  await close();
});

test("a mesh is handed out with the script that fills it", inBrowser, async () => {
  const job = await server.pack({ ...SMALL, name: "Würfel" });
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs/${job.id}`);
  await chooseFile(page, "Gmsh", "mesh msh");
  await page.getByRole("button", { name: "Make the file" }).click();
  const row = page.locator(".files li", { hasText: "Gmsh: Surface mesh" });
  await row.locator(".badge[data-state=succeeded]").waitFor();
  const [mesh] = await Promise.all([page.waitForEvent("download"), row.getByText("Download").click()]);
  const [script] = await Promise.all([page.waitForEvent("download"), row.getByText("Script for Gmsh").click()]);
  assert.equal(script.suggestedFilename(), `${mesh.suggestedFilename()}.geo`);
  const { readFile } = await import("node:fs/promises");
  const text = await readFile(await script.path(), "utf8");
  assert.equal(text.split("\n")[0], `Merge "${mesh.suggestedFilename()}";`);
  clean();
  await close();
});
