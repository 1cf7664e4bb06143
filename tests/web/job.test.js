// The page of a job against the real service: while it runs, when it has ended, and by keyboard alone.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFile } from "node:fs/promises";
import { after, before, describe, test } from "node:test";
import { inBrowser, openPage, SMALL, startBrowser, startServer, chooseFile } from "./harness.js";

/** Grows grains for about the given time in s; a test cancels it or waits for its end. @param {number} seconds */
const growing = (seconds) => ({
  name: "growing",
  seed: 2,
  specimen: { type: "box", size_mm: [80, 80, 80] },
  mix: { grading: { type: "standard", name: "A16" }, d_min_mm: 2, volume_fraction: 0.5 },
  distance: { type: "maximize" },
  method: { type: "edmd", stop: { time_s: seconds } },
});
/** Cannot succeed: more grains than fit. */
const FAILING = { ...SMALL, name: "too full", method: { type: "rsa" }, mix: { ...SMALL.mix, volume_fraction: 0.95 } };
const NAME = '<img src=x onerror="alert(1)"> \u202E\u05E9\u05DC\u05D5\u05DD abc';

describe("page of a job", inBrowser, () => {
  /** @type {import("playwright-core").Browser} */
  let browser;
  /** @type {Awaited<ReturnType<typeof startServer>>} */
  let server;
  before(async () => {
    [browser, server] = await Promise.all([startBrowser(), startServer()]);
  });
  after(async () => {
    await browser?.close();
    await server?.end();
  });

  /** @param {any} job @param {Parameters<typeof openPage>[2]} [options] */
  const open = (job, options) => openPage(browser, `${server.url}/jobs/${job.id}`, options);
  /** @param {string} id */
  const jobOf = async (id) => (await server.ask(`/v1/jobs/${id}`)).json();

  /**
   * Presses Tab until something has the focus.
   * @param {import("playwright-core").Page} page
   * @param {string} selector
   */
  async function tabTo(page, selector) {
    for (let i = 0; i < 150; i++) {
      await page.keyboard.press("Tab");
      if (await page.evaluate((s) => document.activeElement?.matches(s), selector)) return;
    }
    assert.fail(`Tab does not reach ${selector}`);
  }

  for (const scheme of /** @type {("light" | "dark")[]} */ (["light", "dark"])) {
    test(`every state is clean and accessible, ${scheme}`, inBrowser, async () => {
      const done = await server.pack({ ...SMALL, name: NAME, labels: { [`<b>${scheme}`]: NAME } });
      const failed = await server.submit(FAILING);
      await server.ask(`/v1/jobs/${failed.id}`, { headers: { prefer: "wait=60" } });
      const running = await server.submit(growing(60));
      for (const [job, selector, width] of /** @type {[any, string, number][]} */ ([
        [done, "canvas[data-drawn]", 1280],
        [done, "canvas[data-drawn]", 390],
        [failed, ".notice[data-kind=error]", 1280],
        [running, ".growth svg", 1280],
      ])) {
        const opened = await open(job, { scheme, width });
        await opened.page.waitForSelector(selector);
        for (const tab of job === done ? ["plots", "files", "models", "request", "slices"] : []) {
          await opened.page.click(`#tab-${tab}`);
          await opened.page.waitForSelector(`#panel-${tab} section`);
          await opened.accessible();
        }
        await opened.page.waitForFunction(() => [...document.images].every((i) => i.loading === "lazy" || i.complete));
        await opened.accessible();
        opened.clean();
        const wide = await opened.page.evaluate(() => document.documentElement.scrollWidth);
        assert.ok(wide <= width, `${wide} pixels wide in a window of ${width}`);
        await opened.close();
      }
      await server.ask(`/v1/jobs/${running.id}/cancel`, { method: "POST" });
    });
  }

  test("names and labels of strangers are text", inBrowser, async () => {
    const job = await server.pack({ ...SMALL, name: NAME, labels: { "<b>": NAME } });
    const opened = await open(job);
    await opened.page.waitForSelector("canvas[data-drawn]");
    assert.equal(await opened.page.locator("#title bdi").textContent(), NAME);
    assert.equal(await opened.page.locator("main img[src=x], main b").count(), 0);
    assert.ok((await opened.page.title()).startsWith(NAME));
    opened.clean();
    await opened.close();
  });

  test("from the form to a turned and cut picture by keyboard alone", inBrowser, async () => {
    const opened = await openPage(
      browser,
      `${server.url}/#specimen=box&specimen.size_mm=40,40,40&mix.grading=standard` +
        "&mix.grading.name=A16&mix.d_min_mm=4&mix.volume_fraction=0.5&seed=1",
    );
    const { page } = opened;
    await tabTo(page, "#submit");
    await page.keyboard.press("Enter");
    await page.waitForURL(/\/jobs\/[0-9a-f-]{36}$/);
    await page.waitForSelector("canvas[data-drawn]");
    await tabTo(page, "canvas");
    const words = page.locator("#view-words");
    const start = await words.textContent();
    assert.match(start ?? "", /^All \d+ grains of .* in the matrix, without the octant of x above 20\s?mm/);
    await page.keyboard.press("ArrowLeft");
    await page.waitForFunction((old) => document.querySelector("#view-words")?.textContent !== old, start);
    await page.keyboard.press("c");
    await page.waitForFunction(() =>
      /cut: x below 20\s?mm is shown/.test(document.querySelector("#view-words")?.textContent ?? ""),
    );
    await page.waitForSelector("canvas[data-drawn]");
    await tabTo(page, "#cut-z");
    await page.keyboard.press("PageDown");
    await page.waitForFunction(() => /z below 36\s?mm/.test(document.querySelector("#view-words")?.textContent ?? ""));
    await tabTo(page, "#size-from");
    for (let i = 0; i < 3; i++) await page.keyboard.press("PageUp");
    await page.waitForFunction(() =>
      /^\d+ of \d+ grains/.test(document.querySelector("#view-words")?.textContent ?? ""),
    );
    await tabTo(page, "#slice-at");
    const slice = page.locator(".slice img");
    const before = await slice.getAttribute("src");
    await page.keyboard.press("ArrowRight");
    await page.waitForFunction((old) => document.querySelector(".slice img")?.getAttribute("src") !== old, before);
    await page.focus("#tab-slices");
    await page.keyboard.press("ArrowRight");
    await page.keyboard.press("ArrowRight");
    assert.ok(page.url().endsWith("#files"));
    await page.waitForSelector("#export-kind option", { state: "attached" });
    await tabTo(page, "#exports-title + * input");
    await page.keyboard.press("ArrowLeft");
    await tabTo(page, ".links a[href$='format=npy']");
    const [download] = await Promise.all([page.waitForEvent("download"), page.keyboard.press("Enter")]);
    const path = new URL(page.url()).pathname;
    const file = Buffer.from(await (await server.ask(`/v1${path}/result?format=npy`)).arrayBuffer());
    assert.ok(file.equals(await readFile(await download.path())));
    opened.clean();
    await opened.close();
  });

  test("an export is estimated, made, downloaded and deleted", inBrowser, async () => {
    const job = await server.pack(SMALL);
    const opened = await open(job);
    const { page } = opened;
    await chooseFile(page, "ParaView", "voxels vti");
    await page.locator("details summary", { hasText: "Options" }).click();
    await page.fill("#option-cells", "20");
    await page.waitForFunction(() => /^About .*\skB/.test(document.querySelector(".estimate")?.textContent ?? ""));
    await page.getByRole("button", { name: "Make the file" }).click();
    const row = page.locator(".files li", { hasText: "ParaView: Voxels" });
    await row.locator(".badge[data-state=succeeded]").waitFor();
    const kept = (await jobOf(job.id)).exports;
    assert.deepEqual(
      kept.map((/** @type {any} */ e) => [e.type, e.format]),
      [["voxels", "vti"]],
    );
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      row.getByRole("link", { name: "Download" }).click(),
    ]);
    assert.equal(download.suggestedFilename(), "small-seed1.cells-20.vti");
    assert.match((await row.textContent()) ?? "", /voxels20 × 20 × 20.*volume fraction of the labels/);
    await row.getByRole("button", { name: "Delete" }).click();
    await page.getByRole("dialog").getByRole("button", { name: "Delete file" }).click();
    await row.waitFor({ state: "detached" });
    assert.deepEqual((await jobOf(job.id)).exports, []);
    await chooseFile(page, "Gmsh", "mesh msh");
    await page.fill("#option-segments", "3");
    await page.waitForFunction(() => /6/.test(document.querySelector("#option-segments-fault")?.textContent ?? ""));
    await opened.close();
  });

  test("voxels are made for the program that reads them, with materials that are typed", inBrowser, async () => {
    const job = await server.pack(SMALL);
    const opened = await open(job);
    const { page } = opened;
    await chooseFile(page, "FFT", "voxels zip fans");
    await page.locator("details summary", { hasText: "Options" }).click();
    await page.fill("#option-cells", "12");
    await page.fill("#option-materials", "{");
    await page.waitForFunction(() => document.getElementById("option-materials-fault")?.textContent);
    const solid = { youngs_modulus_gpa: 25, poissons_ratio: 0.2 };
    const materials = { matrix: solid, aggregate: { ...solid, youngs_modulus_gpa: 70 } };
    await page.fill("#option-materials", JSON.stringify(materials));
    await page.waitForFunction(() => !document.getElementById("option-materials-fault")?.textContent);
    await page.getByRole("button", { name: "Make the file" }).click();
    const row = page.locator(".files li", { hasText: "FANS" });
    await row.locator(".badge[data-state=succeeded]").waitFor();
    const [made] = (await (await server.ask(`/v1/jobs/${job.id}/exports`)).json()).items;
    assert.deepEqual([made.options.for, made.options.materials], ["fans", materials]);
    await chooseFile(page, "FFT", "voxels vtk amitex");
    await page.fill("#option-cells", "12");
    await page.getByRole("button", { name: "Make the file" }).click();
    const amitex = page.locator(".files li", { hasText: "AMITEX" });
    await amitex.locator(".badge[data-state=succeeded]").waitFor();
    await opened.close();
  });

  test("files stand by program, and surfaces say what a solid mesh is", inBrowser, async () => {
    const job = await server.pack({ ...SMALL, name: undefined });
    const opened = await open(job);
    const { page } = opened;
    await page.click("#tab-files");
    await page.waitForSelector("#export-kind option", { state: "attached" });
    const programs = await page.locator("#exports-title + * label").allInnerTexts();
    assert.deepEqual(programs, ["Abaqus and CalculiX", "Gmsh", "ParaView", "Chrono", "FFT", "CAD", "Tables"]);
    await chooseFile(page, "CAD", "mesh stl");
    await page.click(".note button");
    assert.equal(await page.inputValue("#export-kind"), "mesh msh tetrahedra");
    assert.ok(await page.locator("[name=program][value=Gmsh]").isChecked());
    await page.waitForFunction(() => /tetrahedra/.test(document.querySelector(".estimate")?.textContent ?? ""));
    await chooseFile(page, "Gmsh", "mesh msh");
    await page.getByRole("button", { name: "Make the file" }).click();
    const row = page.locator(".files li", { hasText: "Gmsh: Surface mesh" });
    await row.locator(".badge[data-state=succeeded]").waitFor();
    assert.match((await row.textContent()) ?? "", /Surfaces alone.*gmsh -3/);
    assert.match((await row.locator(".quality").textContent()) ?? "", /triangles\d.*edges.*mm.*error of the grains/s);
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      row.getByRole("link", { name: "Download" }).click(),
    ]);
    assert.equal(download.suggestedFilename(), "A16-50pct-cube-40mm-seed1.msh");
    // The program that was chosen last is there again.
    await page.reload();
    await page.waitForSelector("#export-kind option", { state: "attached" });
    assert.ok(await page.locator("[name=program][value=Gmsh]").isChecked());
    opened.clean();
    await opened.close();
  });

  test("a click tells of a grain; views, matrix and an oblique plane are chosen", inBrowser, async () => {
    const job = await server.pack(SMALL);
    const opened = await open(job);
    const { page } = opened;
    await page.waitForSelector("canvas[data-drawn]");
    // The viewer is above the fold.
    const box = await page.locator("canvas").boundingBox();
    assert.ok(box && box.y + box.height < 900, JSON.stringify(box));
    await page.focus("canvas");
    for (let i = 0; i < 3; i++) await page.keyboard.press("+");
    await page.uncheck("#show-matrix");
    await page.focus("canvas");
    await page.keyboard.press("Enter");
    const card = page.locator(".grain");
    await card.waitFor();
    const words = (await card.textContent()) ?? "";
    const [, number, diameter, ...centre] =
      /Grain(\d+) of \d+.*Diameter([\d.]+)\smmSize class.*Centre([\d.]+), ([\d.]+), ([\d.]+)\smm/s.exec(words) ?? [];
    const rows = (await (await server.ask(`/v1/jobs/${job.id}/result?format=csv`)).text()).trim().split("\n");
    const row = (rows[Number(number)] ?? "").split(",").map(Number);
    const near = row.some((value) => Math.abs(value - Number(diameter)) < 0.01);
    assert.ok(
      near && centre.every((at) => row.some((value) => Math.abs(value - Number(at)) < 0.01)),
      `${words} ${row}`,
    );
    await opened.accessible();
    await card.getByRole("button", { name: "Close" }).click();
    assert.equal(await card.isVisible(), false);
    // At a corner there is no grain.
    await page.mouse.click((box?.x ?? 0) + 5, (box?.y ?? 0) + (box?.height ?? 0) - 150);
    await page.getByRole("button", { name: "Look along z" }).click();
    await page.waitForFunction(() => /90° above/.test(document.querySelector("#view-words")?.textContent ?? ""));
    await page.click("text=Oblique plane");
    await page.check("#plane-on");
    await page.waitForFunction(() => /oblique plane/.test(document.querySelector("#view-words")?.textContent ?? ""));
    await page.getByRole("button", { name: "Reset view" }).click();
    await page.waitForFunction(() => /in the matrix/.test(document.querySelector("#view-words")?.textContent ?? ""));
    assert.equal(await page.isChecked("#plane-on"), false);
    await page.getByRole("button", { name: "Full screen" }).click();
    await page.waitForFunction(() => document.fullscreenElement?.classList.contains("viewer"));
    await page.getByRole("button", { name: "Leave full screen" }).click();
    await page.waitForFunction(() => !document.fullscreenElement);
    assert.equal(await page.locator(".over text", { hasText: /^\d+\smm$/ }).count(), 1);
    opened.clean();
    await opened.close();
  });

  test("ticks of the legend keep apart", inBrowser, async () => {
    const job = await server.pack(SMALL);
    const opened = await open(job);
    await opened.page.waitForSelector("canvas[data-drawn]");
    const close = await opened.page.evaluate(async () => {
      const { legend } = await import(/** @type {any} */ ("/assets/job-legend.js"));
      const place = /** @type {HTMLElement} */ (document.querySelector(".legend"));
      const found = [];
      for (const dmin of [0.063, 0.9, 2, 3.84, 10, 15.9])
        for (const dmax of [1, 4.1, 16, 17.3, 25.9, 31.5, 130].filter((d) => d > dmin)) {
          place.replaceChildren(...legend({ classes: [] }, "size", { dmin, dmax }, "diameter"));
          const boxes = [...place.querySelectorAll(".ticks span")].map((one) => one.getBoundingClientRect());
          if (boxes.some((box, i) => i > 0 && box.left < (boxes[i - 1]?.right ?? 0) + 2)) found.push([dmin, dmax]);
        }
      return found;
    });
    assert.deepEqual(close, []);
    await opened.close();
  });

  test("a slice goes in steps of 0.1 mm and cuts the picture at the same place", inBrowser, async () => {
    const job = await server.pack(SMALL);
    const opened = await open(job);
    const { page } = opened;
    await page.waitForSelector("canvas[data-drawn]");
    assert.equal(await page.getAttribute("#slice-at", "step"), "0.1");
    await page.focus("#slice-at");
    await page.keyboard.press("ArrowRight");
    assert.equal(await page.inputValue("#slice-mm"), "20.1");
    await page.waitForFunction(() => /z below 20\.1/.test(document.querySelector("#view-words")?.textContent ?? ""));
    await page.fill("#slice-mm", "12,5");
    await page.waitForFunction(() => /z below 12\.5/.test(document.querySelector("#view-words")?.textContent ?? ""));
    // And the other way round.
    await page.focus("canvas");
    await page.keyboard.press("c");
    await page.keyboard.press("c");
    await page.waitForFunction(() => /x = 20/.test(document.querySelector(".slice img")?.getAttribute("alt") ?? ""));
    await page.click("#tab-plots");
    // The plot is of the whole aggregate, and so are its values.
    const row = page.locator("[aria-label='Values of the plot'] tr", { hasText: /^4/ });
    assert.match((await row.textContent()) ?? "", /^4\smm36\.0\s%3[56]\.\d\s%$/);
    opened.clean();
    await opened.close();
  });

  test("a picture is saved at the width that was chosen", inBrowser, async () => {
    const job = await server.pack(SMALL);
    const opened = await open(job);
    const { page } = opened;
    await page.waitForSelector("canvas[data-drawn]");
    await page.click("text=Picture as PNG");
    await page.selectOption("#png-width", "3200");
    await page.selectOption("#png-ground", "");
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      page.getByRole("button", { name: "Save picture" }).click(),
    ]);
    const file = await readFile(await download.path());
    assert.equal(file.toString("latin1", 1, 4), "PNG");
    assert.equal(file.readUInt32BE(16), 3200);
    await page.getByRole("button", { name: "Save picture" }).waitFor();
    opened.clean();
    await opened.close();
  });

  test(
    "progress moves, the quarters are announced, and the job is cancelled, retried and deleted",
    inBrowser,
    async () => {
      const job = await server.submit(growing(40));
      const opened = await open(job, { context: { reducedMotion: "reduce" } });
      const { page } = opened;
      await page.waitForSelector(".growth svg path");
      const first = await page.locator(".growth figcaption").textContent();
      await page.waitForFunction((old) => document.querySelector(".growth figcaption")?.textContent !== old, first);
      await page.waitForFunction(() => /^\d+ % done$/.test(document.querySelector("#announce")?.textContent ?? ""));
      // The run has a valid packing, which only gets better: what becomes of it is asked.
      await page.getByRole("button", { name: "Cancel" }).click();
      await page.getByRole("button", { name: "Go on" }).click();
      assert.equal((await jobOf(job.id)).state, "running");
      await page.getByRole("button", { name: "Cancel" }).click();
      await page.getByRole("button", { name: "Cancel and drop" }).click();
      await page.waitForSelector(".badge[data-state=cancelled]");
      assert.equal((await jobOf(job.id)).state, "cancelled");
      await page.getByRole("button", { name: "Retry" }).click();
      await page.waitForSelector(".badge[data-state=running]");
      assert.match((await page.locator("#lead").textContent()) ?? "", /attempt 2/);
      // The answer comes after the event that tells of the end.
      await page.route("**/cancel", async (route) => {
        const response = await route.fetch();
        await page.waitForSelector(".badge[data-state=cancelled]");
        await route.fulfill({ response });
      });
      const answered = page.waitForResponse("**/cancel");
      await page.waitForSelector(".growth svg path");
      await page.getByRole("button", { name: "Cancel" }).click();
      await page.getByRole("button", { name: "Cancel and drop" }).click();
      await (await answered).finished();
      await page.waitForSelector(".badge[data-state=cancelled]");
      await page.getByRole("button", { name: "Delete" }).click();
      await page.getByRole("dialog").waitFor();
      await page.keyboard.press("Escape");
      await page.getByRole("dialog").waitFor({ state: "detached" });
      assert.equal((await jobOf(job.id)).state, "cancelled");
      await page.getByRole("button", { name: "Delete" }).click();
      await page.getByRole("button", { name: "Delete job" }).click();
      await page.waitForURL(/\/jobs$/);
      assert.equal((await fetch(`${server.url}/v1/jobs/${job.id}`)).status, 404);
      opened.clean();
      await opened.close();
    },
  );

  test("the request can be copied and run again with changes", inBrowser, async () => {
    const job = await server.pack({ ...SMALL, name: 'it\'s "quoted" `$HOME`' });
    const opened = await open(job);
    const { page } = opened;
    await page.click("#tab-request");
    const pre = page.locator("#panel-request pre");
    const request = await (await server.ask(`/v1/jobs/${job.id}/request`)).json();
    assert.deepEqual(JSON.parse((await pre.textContent()) ?? ""), request);
    await page.locator("#panel-request label", { hasText: "curl" }).click();
    const answer = JSON.parse(execFileSync("sh", ["-c", (await pre.textContent()) ?? ""], { encoding: "utf8" }));
    assert.equal(answer.name, 'it\'s "quoted" `$HOME`');
    assert.equal(answer.seed, job.seed);
    // A click of a script comes without hover and focus before it.
    await page.getByRole("link", { name: "Run again with changes" }).evaluate((link) => link.click());
    await page.waitForURL(/\/#/);
    assert.match(page.url(), /mix\.volume_fraction=0\.5/);
    await page.goBack();
    await page.getByRole("link", { name: "Run again with changes" }).click();
    await page.waitForURL(/\/#/);
    opened.clean();
    await opened.close();
  });

  test("the page hears of the job again when the server is back", inBrowser, async () => {
    const job = await server.submit(growing(12));
    const opened = await open(job, {
      allow: /ERR_CONNECTION_REFUSED|ERR_INCOMPLETE_CHUNKED_ENCODING|ERR_CONNECTION_RESET|ERR_EMPTY_RESPONSE/,
    });
    const { page } = opened;
    await page.waitForSelector(".growth svg path");
    await server.stop();
    await server.start();
    await page.waitForSelector("canvas[data-drawn]", { timeout: 90_000 });
    assert.equal(await page.locator("#view-title").count(), 1);
    assert.equal(await page.locator(".badge[data-state=succeeded]").first().textContent(), "succeeded");
    opened.clean();
    await opened.close();
  });

  test("an unknown job is said to be unknown", inBrowser, async () => {
    const opened = await openPage(browser, `${server.url}/jobs/01a20842-7063-70b8-9264-5da11c30fd78`, { allow: /404/ });
    await opened.page.locator("h1", { hasText: "No such job" }).waitFor();
    await opened.accessible();
    opened.clean();
    await opened.close();
  });

  test("the page computes the stiffness, and makes a model for CalculiX", inBrowser, async () => {
    const job = await server.pack(SMALL);
    const { page, clean, accessible, close } = await open(job);
    await page.click("#tab-models");
    await page.fill("#material-matrix-0", "20");
    await page.click("button:text-is('Stiffness')");
    const young = await page.textContent('[data-of=stiffness] div:has(dt:text-is("Young\'s modulus")) dd');
    const value = Number((young ?? "").split("\u202f")[0]);
    assert.ok(value > 20 && value < 70, young ?? "");
    await accessible();
    // The materials of the file stand in its row, which fits.
    await page.click("#tab-files");
    await page.locator(".files li", { hasText: "materials (" }).filter({ hasText: "youngs_modulus_gpa 20" }).waitFor();
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth - innerWidth), 0);
    await page.click("#tab-models");
    await page.click("button:has-text('Model for CalculiX')");
    const [model] = await Promise.all([page.waitForEvent("download"), page.click("text=Download the model")]);
    assert.match(model.suggestedFilename(), /deck.*\.zip$/);
    await page.reload();
    await page.waitForSelector("[data-of=stiffness]");
    clean();
    await close();
  });
});
