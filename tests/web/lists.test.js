// Jobs, studies, one study and the service: live lists, actions, hostile names, many items, and what axe-core finds.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { inBrowser, openPage, SMALL, startBrowser, startServer } from "./harness.js";

const HOSTILE = '<img src=x onerror="document.title=1">';
const ARABIC = "خرسانة عالية الأداء";
const LONG = {
  specimen: { type: "box", size_mm: [150, 150, 150] },
  distance: { type: "maximize" },
  mix: { grading: { type: "standard", name: "A16" }, d_min_mm: 2, volume_fraction: 0.75 },
};

const TEMPLATE = { specimen: SMALL.specimen, mix: SMALL.mix };

let server, browser, study;
const post = async (path, body) =>
  (
    await server.ask(path, {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify(body),
    })
  ).json();

before(async () => {
  if (inBrowser.skip) return;
  [server, browser] = await Promise.all([startServer(["--workers", "2"]), startBrowser()]);
  await server.pack({ ...SMALL, name: HOSTILE });
  await server.pack({ ...SMALL, name: ARABIC });
  study = await post("/v1/studies", {
    name: HOSTILE,
    template: TEMPLATE,
    replicates: 3,
    grid: {
      "/mix/volume_fraction": [0.3, 0.4, 0.5],
      "/method": [{ type: "rsa" }, { type: "edmd", stop: { time_s: 5 } }],
    },
  });
  await server.ask(`/v1/studies/${study.id}`, { headers: { prefer: "wait=60" } });
});
after(async () => {
  await browser?.close();
  await server?.end();
});

test("each page in both schemes and at both widths", inBrowser, async () => {
  for (const path of ["/", "/jobs", "/studies", `/studies/${study.id}`, "/service"]) {
    for (const scheme of /** @type {const} */ (["light", "dark"])) {
      for (const width of [1280, 390]) {
        const { page, clean, accessible, close } = await openPage(browser, server.url + path, { scheme, width });
        await page.waitForSelector({ "/": "#answer dl", "/service": "#limits dd" }[path] ?? "tbody tr");
        if (path.startsWith("/studies/")) await page.waitForSelector("#plot:not([hidden])");
        const over = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
        assert.ok(over <= 0, `${path} at ${width} px is ${over} px too wide`);
        await accessible();
        clean();
        await close();
      }
    }
  }
});

test("names of strangers are text, in their own direction", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs`);
  await page.waitForSelector("tbody tr");
  const names = await page.locator("#jobs bdi").allInnerTexts();
  assert.ok(names.includes(HOSTILE) && names.includes(ARABIC), names.join());
  assert.equal(await page.locator("main img").count(), 0);
  const arabic = page.locator("bdi", { hasText: ARABIC });
  assert.equal(await arabic.evaluate((element) => getComputedStyle(element).unicodeBidi), "isolate");
  await page.goto(`${server.url}/studies/${study.id}`);
  await page.waitForSelector("#points tbody tr");
  assert.equal(await page.innerText("h1"), HOSTILE);
  assert.equal(await page.title(), `${HOSTILE} - Packstone`);
  clean();
  await close();
});

test("filters are in the address, and back takes the last one back", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs`);
  await page.waitForSelector("tbody tr");
  await page.fill("#name", "خرسانة");
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 1);
  assert.equal(new URL(page.url()).searchParams.get("name"), "خرسانة");
  await page.reload();
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 1);
  assert.equal(await page.inputValue("#name"), "خرسانة");
  await page.selectOption("#state", "failed");
  await page.waitForSelector("#empty:not([hidden])");
  await page.goBack();
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 1);
  assert.equal(await page.inputValue("#state"), "");
  await page.goto(`${server.url}/jobs?study=${study.id}`);
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 18);
  clean();
  await close();
});

test("a job is seen as it comes, runs, is cancelled, retried, and deleted after one question", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs?name=seen`);
  await page.waitForSelector("#empty:not([hidden])");
  const job = await server.submit({ ...LONG, name: "seen" });
  const state = (wanted) => page.waitForSelector(`#jobs [data-state=${wanted}]`);
  await state("running");
  await page.waitForSelector("#jobs progress");
  // Whether the packing that is there is kept is asked once there is one.
  const cancel = async () => {
    await page.click("[data-do=cancel]");
    if (await page.locator("dialog[open]").count()) await page.click("dialog .danger");
  };
  await cancel();
  await state("cancelled");
  await page.focus("[data-do=retry]");
  await page.keyboard.press("Enter");
  await page.waitForSelector("#jobs :is([data-state=queued], [data-state=running])");
  await cancel();
  await state("cancelled");
  await page.click("[data-do=delete]");
  await page.waitForSelector("dialog[open]");
  await page.keyboard.press("Escape");
  await page.waitForSelector("dialog", { state: "detached" });
  await page.click("[data-do=delete]");
  await page.click("dialog .danger");
  await page.waitForSelector("#empty:not([hidden])");
  const gone = await fetch(`${server.url}/v1/jobs/${job.id}`);
  assert.equal(gone.status, 404);
  clean();
  await close();
});

test("jobs are called by their mix, found in any case, and have labels, totals and an expiry", inBrowser, async () => {
  const labels = { series: "overview" };
  await server.pack({ ...SMALL, name: undefined, labels, expires_at: "2999-01-02T00:00:00Z" });
  const rock = { ...SMALL.mix, volume_fraction: 0.3, shape: { type: "polyhedron" } };
  const gap = { type: "constant", gap_mm: 0.2 };
  await server.pack({ ...SMALL, name: "Gebrochenes Gestein", labels, mix: rock, distance: gap });
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs?label=series%3Doverview`);
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 2);
  const cells = (/** @type {string | RegExp} */ has) =>
    page.locator("#jobs tr", { hasText: has }).locator("td.wide").allInnerTexts();
  const plain = await cells(/A16, 50\s%, cube 40\smm/);
  assert.deepEqual(plain.slice(0, 5), ["A16", "cube 40\u202fmm", "50\u202f%", "spheres", "none"]);
  assert.match(plain[6] ?? "", /^\d{4}-\d\d-\d\d \d\d:\d\d\ntook .*\nexpires 2999-01-0/s);
  assert.deepEqual((await cells("Gebrochenes Gestein")).slice(0, 5), [
    "A16",
    "cube 40\u202fmm",
    "30\u202f%",
    "angular",
    "0.2\u202fmm",
  ]);
  assert.match(await page.innerText("#totals"), /^2 jobs, results of \d+.*kB$/);
  assert.equal(await page.locator(".tag", { hasText: "series = overview" }).count(), 2);
  await page.fill("#name", "GESTEIN");
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 1);
  await page.waitForFunction(() => /^1 job,/.test(document.getElementById("totals")?.textContent ?? ""));
  assert.equal(await page.locator("th.owner").isVisible(), false, "there is one owner");
  await accessible();
  // A job without a name by the title that it is listed with, as it was copied.
  const title = page.locator("#jobs .name", { hasText: "50" });
  await page.fill("#name", "a16, 50\u202f%, CUBE");
  await title.waitFor();
  assert.equal(await page.locator("#jobs tr").count(), 1);
  clean();
  await close();
});

test("chosen jobs are cancelled and deleted together, with their number and size", inBrowser, async () => {
  for (const seed of [1, 2]) await server.pack({ ...SMALL, name: "bulk", seed });
  const open = await server.submit({ ...LONG, name: "bulk" });
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs?name=bulk`);
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 3);
  await page.focus("#all");
  await page.keyboard.press("Space");
  assert.match(await page.innerText("#chosen"), /3 chosen.*Cancel 1.*Delete 2/s);
  await accessible();
  await page.click("[data-bulk=cancel]");
  if (await page.locator("dialog[open]").count()) await page.click("dialog .danger");
  await page.waitForSelector("#jobs [data-state=cancelled]");
  assert.equal((await (await server.ask(`/v1/jobs/${open.id}`)).json()).state, "cancelled");
  await page.check("#all");
  await page.click("[data-bulk=delete]");
  assert.equal(await page.textContent("dialog h2"), "Delete 3 jobs?");
  assert.match((await page.textContent("dialog p")) ?? "", /\d\skB become free\. This cannot be undone\.$/);
  await page.click("dialog .danger");
  await page.waitForSelector("#empty:not([hidden])");
  assert.equal((await (await server.ask("/v1/jobs?name=bulk")).json()).items.length, 0);
  clean();
  await close();
});

test("a job is run again with changes: the form has its request", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs?name=img`);
  await page.waitForSelector("tbody tr");
  await page.click("[data-do=change] >> nth=0");
  await page.waitForURL(/\/#.*specimen=box/);
  await page.waitForSelector("#answer dl");
  assert.equal(await page.inputValue("#name"), HOSTILE);
  assert.equal(await page.inputValue("#size_x"), "40");
  clean();
  await close();
});

test("one study: plots, sorting, the jobs of a point, CSV", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/studies/${study.id}`);
  await page.waitForSelector("#points tbody tr");
  await page.waitForSelector("#plot:not([hidden])");
  await page.waitForFunction(() => /** @type {HTMLImageElement} */ (document.getElementById("plot")).naturalWidth > 0);
  await page.selectOption("#kind", "time");
  await page.waitForFunction(() =>
    /** @type {HTMLImageElement} */ (document.getElementById("plot")).alt.startsWith("Time"),
  );
  const column = () => page.locator("#points tbody tr td:nth-child(2)").allInnerTexts();
  assert.deepEqual(await column(), ["0.3", "0.3", "0.4", "0.4", "0.5", "0.5"]);
  const head = page.locator("th button", { hasText: "Volume fraction" });
  await head.press("Enter");
  await head.press("Enter");
  assert.deepEqual(await column(), ["0.5", "0.5", "0.4", "0.4", "0.3", "0.3"]);
  assert.equal(await page.locator("th[aria-sort=descending]").count(), 1);
  await page.click("[aria-label='Jobs of point 4']");
  await page.waitForFunction(() => document.querySelectorAll("dialog li a").length === 3);
  const job = await (await server.ask(`/v1${await page.getAttribute("dialog li a", "href")}`)).json();
  assert.deepEqual([job.study_id, job.point], [study.id, 4]);
  await page.keyboard.press("Escape");
  const [download] = await Promise.all([page.waitForEvent("download"), page.click("#csv")]);
  const { readFileSync } = await import("node:fs");
  const csv = await (await server.ask(`/v1/studies/${study.id}/table?format=csv`)).text();
  assert.equal(readFileSync(await download.path(), "utf8"), csv);
  clean();
  await close();
});

test("a study has the plots of its properties and the representative volume", inBrowser, async () => {
  const solid = { youngs_modulus_gpa: 25, poissons_ratio: 0.2 };
  const sizes = [12, 18].map((edge) => [edge, edge, edge]);
  const made = await (
    await server.ask("/v1/studies", {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify({
        seed: 3,
        replicates: 3,
        template: {
          specimen: { type: "box", size_mm: sizes[0], boundary: "periodic" },
          mix: { grading: { type: "monodisperse", diameter_mm: 5 }, volume_fraction: 0.25, allow_coarse: true },
          materials: { matrix: solid, aggregate: { ...solid, youngs_modulus_gpa: 70 } },
          postprocess: [{ type: "properties", cells: 8, kinds: "stiffness" }],
        },
        zip: { "/specimen/size_mm": sizes, "/postprocess/0/cells": [8, 12] },
      }),
    })
  ).json();
  const { page, clean, close } = await openPage(browser, `${server.url}/studies/${made.id}`);
  await page.locator("#kind option[value=representative_volume]").waitFor({ state: "attached" });
  await page.selectOption("#kind", "representative_volume");
  await page.waitForFunction(() => /Representative volume over/.test(document.getElementById("plot")?.alt ?? ""));
  assert.equal(await page.locator("#x-field").isVisible(), false);
  await page.selectOption("#kind", "youngs_modulus");
  await page.waitForFunction(() => /Young's modulus over/.test(document.getElementById("plot")?.alt ?? ""));
  await page.getByRole("columnheader", { name: "Young's modulus" }).waitFor();
  // The page looks again until the properties of all runs are there, although the study has finished.
  await page.waitForFunction(() => !document.querySelector("th")?.textContent?.includes("Properties waiting"));
  clean();
  await close();
});

test("a study is cancelled, retried and deleted from its page", inBrowser, async () => {
  const long = await post("/v1/studies", { name: "long", template: LONG, replicates: 4 });
  const { page, clean, close } = await openPage(browser, `${server.url}/studies/${long.id}`);
  await page.click("text=Cancel");
  await page.click("dialog .danger");
  await page.waitForSelector("#state [data-state=finished]");
  await page.click("text=Retry cancelled");
  await page.waitForSelector("#state [data-state=open]");
  await page.click("#buttons >> text=Cancel");
  await page.click("dialog .danger");
  await page.waitForSelector("#state [data-state=finished]");
  await page.click("#buttons >> text=Delete");
  await page.click("dialog .danger");
  await page.waitForURL(`${server.url}/studies`);
  assert.equal((await fetch(`${server.url}/v1/studies/${long.id}`)).status, 404);
  clean();
  await close();
});

test("a hidden page asks nothing, and is up to date when it is shown again", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs?name=hidden`);
  await page.waitForSelector("#empty:not([hidden])");
  const hide = (/** @type {boolean} */ hidden) =>
    page.evaluate((value) => {
      Object.defineProperty(document, "hidden", { value, configurable: true });
      document.dispatchEvent(new Event("visibilitychange"));
    }, hidden);
  await hide(true);
  let asked = 0;
  page.on("request", () => (asked += 1));
  await server.pack({ ...SMALL, name: "hidden" });
  await page.waitForTimeout(3500);
  assert.equal(asked, 0);
  await hide(false);
  await page.waitForSelector("#jobs tr");
  clean();
  await close();
});

test("ten thousand jobs and a study of ten thousand points stay usable", inBrowser, async () => {
  const many = await post("/v1/studies", {
    name: "many",
    template: {
      specimen: { type: "box", size_mm: [20, 20, 20] },
      mix: { grading: { type: "monodisperse", diameter_mm: 5 }, volume_fraction: 0.1, allow_coarse: true },
    },
    grid: { "/mix/volume_fraction": Array.from({ length: 10_000 }, (_, i) => 0.1 + i / 1e5) },
  });
  const { page, clean, close } = await openPage(browser, `${server.url}/studies/${many.id}`);
  await page.waitForSelector("#points tbody tr", { timeout: 60_000 });
  await page.waitForFunction(() => document.getElementById("points")?.textContent?.includes("10"));
  assert.equal(await page.locator("#points tbody tr").count(), 100);
  const took = await page.evaluate(() => {
    const start = performance.now();
    /** @type {HTMLElement} */ (document.querySelectorAll("#points th button")[1]).click();
    return performance.now() - start;
  });
  console.log(`  a study of 10 000 points is sorted and shown in ${Math.round(took)} ms`);
  await page.click("#points >> text=Next");
  assert.match(await page.innerText("#points"), /101 to 200 of 10\s000 points/);
  const nodes = await page.evaluate(() => document.querySelectorAll("*").length);
  assert.ok(nodes < 5000, `${nodes} elements`);
  await page.goto(`${server.url}/jobs`);
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 50);
  await page.click("text=Next page");
  await page.waitForURL(/cursor=/);
  await page.waitForFunction(() => document.querySelectorAll("#jobs tr").length === 50);
  await page.goBack();
  await page.waitForURL(/\/jobs$/);
  clean();
  await close();
});
