// A server with API keys: a page asks for one once, knows whose it is, and asks again when it was withdrawn.
import assert from "node:assert/strict";
import { createHash, randomBytes } from "node:crypto";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { inBrowser, openPage, SMALL, startBrowser, startServer } from "./harness.js";

/** What Chromium itself says of answers that these tests ask for. */
const REFUSED = /status of 40[13]/;

const folder = mkdtempSync(join(tmpdir(), "packstone-keys-"));
const file = join(folder, "keys");
const keys = Object.fromEntries(
  ["anna", "berta", "guest"].map((name) => [name, `packstone_${randomBytes(24).toString("hex")}`]),
);
const roles = { anna: "role=admin", berta: "role=submit", guest: "role=read" };
const grant = (/** @type {string[]} */ names) =>
  writeFileSync(
    file,
    names.map((name) => `${createHash("sha256").update(keys[name]).digest("hex")} ${name} ${roles[name]}\n`).join(""),
  );

let server, browser;
before(async () => {
  if (inBrowser.skip) return;
  grant(["anna", "berta", "guest"]);
  [server, browser] = await Promise.all([startServer(["--api-keys-file", file]), startBrowser()]);
});
after(async () => {
  await browser?.close();
  await server?.end();
  rmSync(folder, { recursive: true, force: true });
});

/** Enters a key into the dialog. @param {import("playwright-core").Page} page @param {string} key */
async function enter(page, key) {
  await page.waitForSelector("dialog[open] #key-field");
  await page.fill("#key-field", key);
  await page.keyboard.press("Enter");
}

test("a page asks for a key once, refuses a wrong one, and shows what the key may see", inBrowser, async () => {
  const headers = { authorization: `Bearer ${keys.anna}`, "content-type": "application/json" };
  await server.ask("/v1/jobs", { method: "POST", headers, body: JSON.stringify({ ...SMALL, name: "of anna" }) });
  const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs`, { allow: REFUSED });
  await enter(page, "packstone_wrong");
  await page.waitForFunction(() => document.getElementById("key-fault")?.textContent?.includes("does not know"));
  await accessible();
  await enter(page, keys.anna);
  await page.waitForSelector("#jobs tr");
  assert.match(await page.innerText("#jobs"), /of anna/);
  assert.equal(await page.locator("th.owner").isVisible(), false, "there is one owner");
  await page.waitForFunction(() => document.getElementById("account")?.textContent?.includes("anna"));
  assert.equal(await page.locator("dialog").count(), 0);
  await page.goto(`${server.url}/service`);
  await page.waitForSelector("#key dd");
  assert.match(await page.innerText("#key"), /anna/);
  await page.waitForSelector("#figures:not([hidden])");
  assert.equal(
    await page.evaluate(
      (key) => JSON.stringify({ ...localStorage, ...sessionStorage, c: document.cookie }).includes(key),
      keys.anna,
    ),
    false,
    "no script can read the key",
  );
  clean();
  await close();
});

test("a mix is submitted by a session", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/`, { allow: REFUSED });
  await enter(page, keys.anna);
  await page.waitForSelector("#answer dl");
  await page.fill("#name", "by session");
  await page.click("#submit");
  await page.waitForURL(/\/jobs\/[0-9a-f-]{36}$/);
  clean();
  await close();
});

test("the list says whose each job is where there are several owners", inBrowser, async () => {
  for (const name of ["anna", "berta"]) {
    const headers = { authorization: `Bearer ${keys[name]}`, "content-type": "application/json" };
    await server.ask("/v1/jobs", { method: "POST", headers, body: JSON.stringify({ ...SMALL, name: `of ${name}` }) });
  }
  const owners = async (/** @type {string} */ name) => {
    const { page, clean, accessible, close } = await openPage(browser, `${server.url}/jobs`, { allow: REFUSED });
    await enter(page, keys[name] ?? "");
    await page.waitForSelector("#jobs tr");
    await accessible();
    const shown = await page.locator("td.owner:visible").allInnerTexts();
    clean();
    await close();
    return new Set(shown);
  };
  assert.deepEqual(await owners("anna"), new Set(["anna", "berta"]));
  assert.deepEqual(await owners("berta"), new Set(), "all that are seen are hers");
});

test("a key is withdrawn: the page asks for another, and the closed dialog leaves a problem", inBrowser, async () => {
  const { page, clean, close } = await openPage(browser, `${server.url}/jobs`, { allow: REFUSED });
  await enter(page, keys.guest);
  await page.waitForFunction(() => document.getElementById("account")?.textContent?.includes("guest"));
  grant(["anna"]);
  let refused = 0;
  while (refused !== 401) {
    refused = (await fetch(`${server.url}/v1/key`, { headers: { authorization: `Bearer ${keys.guest}` } })).status;
  }
  await page.fill("#name", "x");
  await page.waitForSelector("dialog[open] #key-field");
  await page.keyboard.press("Escape");
  await page.waitForSelector("#report .notice");
  await page.waitForTimeout(3500);
  assert.equal(await page.locator("dialog").count(), 0, "it is asked once");
  await page.reload();
  await enter(page, keys.anna);
  await page.waitForFunction(() => document.getElementById("account")?.textContent?.includes("anna"));
  await page.click("text=Sign out");
  await page.waitForSelector("dialog[open] #key-field");
  clean();
  await close();
});
