// The deletion of many finished jobs, and jobs that say why they wait.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { inBrowser, openPage, SMALL, startBrowser, startServer } from "./harness.js";

/** @type {any} */
let server;
/** @type {any} */
let browser;

before(async () => {
  if (inBrowser.skip) return;
  const options = ["--workers", "1", "--max-running-per-key", "1"];
  [server, browser] = await Promise.all([startServer(options), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
});

test("finished jobs of a list are deleted together, after their number was shown", inBrowser, async () => {
  for (const seed of [1, 2]) await server.pack({ ...SMALL, seed, labels: { series: "a" } });
  await server.pack({ ...SMALL, name: "stays", labels: { series: "b" } });
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs`);
  await page.waitForSelector("tbody tr");
  assert.equal(await page.locator("[data-do=delete-all]").count(), 0, "without a filter it would delete all");
  await page.goto(`${server.url}/jobs?label=series%3Da&state=succeeded`);
  await page.click("[data-do=delete-all]");
  assert.equal(await page.textContent("dialog h2"), "Delete 2 finished jobs?");
  assert.match((await page.textContent("dialog p")) ?? "", /\d+\skB become free\. This cannot be undone\.$/);
  await accessible();
  await page.click("dialog .danger");
  await page.waitForSelector("#empty:not([hidden])");
  const left = await (await server.ask("/v1/jobs")).json();
  assert.deepEqual(
    left.items.map((/** @type {any} */ job) => job.name),
    ["stays"],
  );
  clean();
  await close();
});

test("a job beyond the quota of its owner says why it waits", inBrowser, async () => {
  const long = { ...SMALL, specimen: { type: "box", size_mm: [150, 150, 150] }, distance: { type: "maximize" } };
  const running = await server.submit(long);
  const waiting = await server.submit({ ...SMALL, seed: 3 });
  const words = "as many jobs of its owner run as may: 1 of 1";
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs/${waiting.id}`);
  await page.waitForFunction((words) => document.body.textContent.includes(words), words);
  await accessible();
  await page.goto(`${server.url}/jobs`);
  await page.waitForFunction((words) => document.body.textContent.includes(words), words);
  await server.ask(`/v1/jobs/${running.id}/cancel`, { method: "POST" });
  clean();
  await close();
});
