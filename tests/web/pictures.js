// Makes the pictures of the page in docs/pictures: node pictures.js
// Those of the repository have 256 colours: Image.open(path).convert("RGB").quantize(256).save(path) of Pillow.
import { readFileSync } from "node:fs";
import { startBrowser, startServer } from "./harness.js";

const PICTURES = new URL("../../docs/pictures/", import.meta.url).pathname;
const CUBE =
  "/#specimen=box&specimen.size_mm=150,150,150&mix.grading=standard&mix.grading.name=A16&mix.d_min_mm=2" +
  "&mix.volume_fraction=0.7&distance=constant&distance.gap_mm=0.3";

const [server, browser] = await Promise.all([startServer(), startBrowser()]);
/**
 * The page with a mix and its plan.
 * @param {import("playwright-core").BrowserContextOptions} options
 * @param {string} [mix] the address of the mix
 */
async function form(options, mix = CUBE) {
  const page = await (await browser.newContext({ deviceScaleFactor: 1, ...options })).newPage();
  await page.goto(server.url + mix);
  await planned(page);
  return page;
}
/** @param {import("playwright-core").Page} page */
const planned = (page) => page.waitForSelector(".answer:not([aria-busy]) #answer svg.chart");

const tall = await form({ viewport: { width: 1280, height: 2400 } });
await tall.fill("#json", readFileSync(new URL("../../examples/aggregates.json", import.meta.url), "utf8"));
await planned(tall);
await tall.locator("#aggregates").screenshot({ path: `${PICTURES}page-aggregates.png` });
const wide = await form({ viewport: { width: 1280, height: 1000 } });
await wide.screenshot({ path: `${PICTURES}page-form.png` });
const first = await form(
  { viewport: { width: 1280, height: 1000 } },
  "/#specimen=box&specimen.size_mm=50,50,50&mix.grading=standard&mix.grading.name=A16&mix.d_min_mm=2&mix.volume_fraction=0.7",
);
await first.screenshot({ path: `${PICTURES}tutorial-form.png` });
const phone = await form({ viewport: { width: 390, height: 760 }, colorScheme: "dark" });
await phone.screenshot({ path: `${PICTURES}page-phone.png` });

const read = (/** @type {string} */ path) =>
  JSON.parse(readFileSync(new URL(`../../examples/${path}`, import.meta.url), "utf8"));
const demo = await server.pack(read("a16.json"));
for (const name of ["crushed-rock", "cylinder", "three-shapes", "gap-for-meshing"]) {
  await server.pack(read(`gallery/${name}/request.json`));
}
await server.submit({ ...read("gallery/fuller-curve/request.json"), name: "RSA at 0.70", method: { type: "rsa" } });
/** @param {string} path @param {string} ready @param {number} height */
async function open(path, ready, height) {
  const page = await (await browser.newContext({ viewport: { width: 1280, height } })).newPage();
  await page.goto(server.url + path);
  await page.waitForSelector(ready);
  return page;
}
const job = await open(`/jobs/${demo.id}`, "canvas[data-drawn]", 1100);
await job.locator("#cut-x").fill("75");
await job.locator("canvas[data-drawn]").scrollIntoViewIfNeeded();
await job.waitForTimeout(5000);
await job.screenshot({ path: `${PICTURES}page-job.png` });
const jobs = await open("/jobs", "tbody tr", 480);
await jobs.screenshot({ path: `${PICTURES}page-jobs.png` });
const study = await (
  await server.ask("/v1/studies", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: readFileSync(new URL("../../docs/tutorial/study.json", import.meta.url), "utf8"),
  })
).json();
while (!(await (await server.ask(`/v1/studies/${study.id}`, { headers: { prefer: "wait=60" } })).json()).finished_at);
const points = await open(`/studies/${study.id}`, "tbody tr", 1000);
await points.waitForTimeout(3000);
await points.screenshot({ path: `${PICTURES}page-study.png` });
await browser.close();
await server.end();
