// The file that `packstone run --format html` writes: one page with a packing, opened from the disk.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { pathToFileURL } from "node:url";
import { BINARY, inBrowser, openPage, SMALL, startBrowser } from "./harness.js";

const NAME = "</script><img src=x onerror=alert(1)> & <b>";
const ELLIPSOIDS = { type: "ellipsoid", ratios: { type: "constant", b_over_a: 0.8, c_over_a: 0.667 } };

for (const [kind, mix] of /** @type {[string, any][]} */ ([
  ["spheres", SMALL.mix],
  ["ellipsoids", { ...SMALL.mix, shape: ELLIPSOIDS }],
  ["polyhedra", { ...SMALL.mix, shape: { type: "polyhedron" }, volume_fraction: 0.3 }],
])) {
  test(`a file with ${kind} is turned and cut without a server`, inBrowser, async () => {
    const folder = mkdtempSync(join(tmpdir(), "packstone-file-"));
    const browser = await startBrowser();
    try {
      writeFileSync(join(folder, "job.json"), JSON.stringify({ ...SMALL, name: NAME, mix }));
      const ran = spawnSync(BINARY, ["run", "job.json", "--format", "html"], { cwd: folder, encoding: "utf8" });
      assert.equal(ran.status, 0, ran.stderr);
      const grains = Number(/placed (\d+) grains/.exec(ran.stderr)?.[1]);
      const url = pathToFileURL(join(folder, "result.html")).href;
      for (const scheme of /** @type {("light" | "dark")[]} */ (["light", "dark"])) {
        const { page, clean, accessible, close } = await openPage(browser, url, { scheme });
        await page.waitForSelector(`canvas[data-drawn="${grains}"]`);
        assert.equal(await page.textContent("h1"), NAME, "the name is a text");
        // Each size is named: of spheres there is one.
        const words = (await page.textContent("main")) ?? "";
        for (const named of ["enclosing sphere", "sieve size", "spheres of equal volume"])
          assert.equal(words.includes(named), kind !== "spheres", named);
        await page.focus("canvas");
        await page.keyboard.press("c");
        await page.locator("#view-words", { hasText: /cut: x below 20\smm/ }).waitFor();
        assert.match((await page.textContent("pre")) ?? "", /"volume_fraction": 0\.[35]/);
        await page.click("text=Picture as PNG");
        const [picture] = await Promise.all([page.waitForEvent("download"), page.click("text=Save picture")]);
        assert.match(picture.suggestedFilename(), /^packing-.*\.png$/);
        await accessible();
        clean();
        await close();
      }
    } finally {
      await browser.close();
      rmSync(folder, { recursive: true, force: true });
    }
  });
}

test("in a frame without rights, as of a notebook, the viewer comes first", inBrowser, async () => {
  const folder = mkdtempSync(join(tmpdir(), "packstone-frame-"));
  const browser = await startBrowser();
  try {
    writeFileSync(join(folder, "job.json"), JSON.stringify(SMALL));
    const ran = spawnSync(BINARY, ["run", "job.json", "--format", "html"], { cwd: folder, encoding: "utf8" });
    assert.equal(ran.status, 0, ran.stderr);
    const packing = readFileSync(join(folder, "result.html"), "utf8");
    const escaped = packing.replaceAll("&", "&amp;").replaceAll('"', "&quot;");
    const around = `<!doctype html><html lang="en"><title>Notebook</title>
      <iframe title="Packing" sandbox="allow-scripts allow-downloads" srcdoc="${escaped}"></iframe>`;
    writeFileSync(join(folder, "notebook.html"), around);
    const { page, clean, close } = await openPage(browser, pathToFileURL(join(folder, "notebook.html")).href);
    const frame = page.frameLocator("iframe");
    await frame.locator("#result > :first-child canvas[data-drawn]").waitFor();
    clean();
    await close();
  } finally {
    await browser.close();
    rmSync(folder, { recursive: true, force: true });
  }
});
