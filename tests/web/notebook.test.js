// `Packing.view()` in JupyterLab: a notebook is opened and run in a browser. PACKSTONE_JUPYTER names `jupyter-lab` of an
// environment with the Python package; without it the test is skipped.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { inBrowser, startBrowser } from "./harness.js";

const JUPYTER = process.env.PACKSTONE_JUPYTER;
const skip = inBrowser.skip || (JUPYTER ? false : "no JupyterLab here: set PACKSTONE_JUPYTER");

/**
 * Starts JupyterLab.
 * @param {string} folder with the notebooks; its settings lie there, too
 */
async function startJupyter(folder) {
  const child = spawn(
    JUPYTER ?? "",
    [
      "--no-browser",
      "--allow-root",
      "--ip=127.0.0.1",
      "--port=0",
      `--ServerApp.root_dir=${folder}`,
      // It asks the internet for nothing.
      "--LabApp.news_url=None",
      "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
    ],
    {
      stdio: ["ignore", "ignore", "pipe"],
      env: { ...process.env, HOME: folder, JUPYTER_CONFIG_DIR: folder, JUPYTER_DATA_DIR: folder, IPYTHONDIR: folder },
    },
  );
  let log = "";
  const url = await new Promise((resolve, reject) => {
    child.stderr.on("data", (part) => {
      log += part;
      const found = /http:\/\/127\.0\.0\.1:\d+\/lab\?token=\w+/.exec(log);
      if (found) resolve(new URL(found[0]));
    });
    child.on("error", reject);
    child.on("exit", (code) => reject(new Error(`JupyterLab ended with ${code}: ${log}`)));
  });
  const end = async () => {
    const ended = new Promise((resolve) => child.on("exit", resolve));
    child.kill("SIGTERM");
    await ended;
  };
  return { url, end };
}

test("a notebook of JupyterLab shows a packing in the viewer", { ...inBrowser, skip }, async () => {
  const folder = mkdtempSync(join(tmpdir(), "packstone-jupyter-"));
  // One cell: JupyterLab keeps cells out of the page that are far from what is shown.
  const source =
    "import packstone\n" +
    'packing = packstone.pack(specimen=packstone.Box(50), mix=packstone.Mix("A16", 0.7, d_min_mm=2), seed=1)\n' +
    "print(len(packing))\n" +
    "packing.view()";
  const cell = { cell_type: "code", id: "view", metadata: {}, execution_count: null, outputs: [], source };
  const kernelspec = { name: "python3", display_name: "Python 3 (ipykernel)", language: "python" };
  const notebook = { nbformat: 4, nbformat_minor: 5, metadata: { kernelspec }, cells: [cell] };
  writeFileSync(join(folder, "first.ipynb"), JSON.stringify(notebook));
  const [jupyter, browser] = await Promise.all([startJupyter(folder), startBrowser()]);
  try {
    const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
    await page.goto(`${jupyter.url.origin}/lab/tree/first.ipynb${jupyter.url.search}`);
    // Cells that are run before the kernel is there are not run at all.
    await page.waitForSelector("#jp-main-statusbar >> text=| Idle", { timeout: 120_000 });
    await page.getByRole("menuitem", { name: "Run", exact: true }).click();
    await page.getByRole("menuitem", { name: "Run All Cells", exact: true }).click();
    const frame = page.frameLocator(".jp-OutputArea iframe[title=Packing]");
    await frame.locator("canvas[data-drawn]").waitFor({ timeout: 100_000 });
    const drawn = await frame.locator("canvas").getAttribute("data-drawn");
    assert.equal(drawn, (await page.innerText(".jp-OutputArea pre")).trim());
    await frame.locator("canvas").focus();
    await page.keyboard.press("c");
    await frame.locator("#view-words", { hasText: /cut: x below 25\smm/ }).waitFor();
  } finally {
    await browser.close();
    await jupyter.end();
    rmSync(folder, { recursive: true, force: true });
  }
});
