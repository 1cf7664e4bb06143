// Makes the pictures of the form in docs/pictures anew: node pictures.js
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
 */
async function form(options) {
  const page = await (await browser.newContext({ deviceScaleFactor: 1, ...options })).newPage();
  await page.goto(server.url + CUBE);
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
const phone = await form({ viewport: { width: 390, height: 760 }, colorScheme: "dark" });
await phone.screenshot({ path: `${PICTURES}page-phone.png` });
await browser.close();
await server.end();
