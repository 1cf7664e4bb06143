// The picture of the viewer against the picture that it must be, and what it costs.
import assert from "node:assert/strict";
import { after, before, describe, test } from "node:test";
import { inBrowser, openPage, SMALL, startBrowser, startServer } from "./harness.js";
import { bodyFile, expected, hitsOfBodies, hitsOfSpheres, manySpheres, sphereFile } from "./view.js";

const SIZE = [40, 40, 40];
/** Three spheres: the first covers part of the second as seen from the front. */
const SPHERES = [22, 18, 21, 20, 8, 12, 24, 12, 30, 33, 12, 6];
const CLASSES = [4, 10, 16];
const turn = (/** @type {number[]} */ q) => q.map((x) => x / Math.hypot(...q));
/** An ellipsoid and two cubes. */
const BODIES = [
  { at: [22, 18, 21], size: 24, axes: [1, 0.7, 0.35], turn: turn([0.3, -0.5, 0.2, 0.8]) },
  { at: [9, 30, 12], size: 16, axes: [], turn: turn([0.1, 0.4, -0.3, 0.9]) },
  { at: [31, 31, 33], size: 9, axes: [], turn: turn([0, 0, 0, 1]) },
];
const FAR = 1e9;

describe("viewer", inBrowser, () => {
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

  /**
   * A page with a canvas and a viewer that has loaded a file, which the browser gets from the test.
   * @param {Buffer} file
   * @param {{width: number, height: number, pointLimit?: number}} options
   */
  async function show(file, options) {
    const opened = await openPage(browser, `${server.url}/jobs/none`, { allow: /404/ });
    await opened.page.route("**/file.view", (route) => route.fulfill({ body: file }));
    await opened.page.evaluate(async ({ width, height, pointLimit }) => {
      const { Viewer } = await import(/** @type {any} */ ("/assets/viewer/viewer.js"));
      document.body.replaceChildren();
      const canvas = document.createElement("canvas");
      Object.assign(canvas.style, {
        width: `${width}px`,
        height: `${height}px`,
        color: "rgb(0 0 0 / 0)",
        display: "block",
        touchAction: "none",
      });
      document.body.append(canvas);
      const viewer = new Viewer(canvas, { pointLimit });
      const page = /** @type {any} */ (window);
      page.viewer = viewer;
      page.frames = 0;
      viewer.addEventListener("frame", () => page.frames++);
      page.rest = () => new Promise((done) => viewer.addEventListener("rest", done, { once: true }));
      const rest = page.rest();
      await viewer.load(async () => (await fetch("/file.view")).body);
      await rest;
    }, options);
    return opened;
  }

  /**
   * The pixels of the canvas as they must be classed: the ground, a sphere by its colour, or a flat section of it.
   * @param {import("playwright-core").Page} page
   * @param {object} change
   */
  const seen = (page, change) =>
    page.evaluate(async (change) => {
      const { viewer, rest } = /** @type {any} */ (window);
      const { aggregates, classes } = await import(/** @type {any} */ ("/assets/viewer/colours.js"));
      const done = rest();
      Object.assign(viewer.pose, change.pose);
      viewer.set(change.set);
      await done;
      const { width, height } = viewer.canvas;
      const { gl } = viewer;
      const pixels = new Uint8Array(4 * width * height);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      // Classes ascend, spheres descend.
      const palette = (viewer.colour === "class" ? classes(3).slice(0, 3).reverse() : aggregates.slice(0, 3)).map(
        (/** @type {number[]} */ c) => c.map((x) => 255 * x),
      );
      const out = new Array(width * height).fill(0);
      for (let i = 0; i < out.length; i++) {
        const at = 4 * ((height - 1 - Math.floor(i / width)) * width + (i % width));
        const p = [...pixels.subarray(at, at + 3)];
        if (pixels[at + 3] === 0) continue;
        const norm = Math.hypot(...p);
        const near = palette.map((c) => Math.hypot(...c.map((x, k) => x / Math.hypot(...c) - p[k] / norm)));
        const which = near.indexOf(Math.min(...near));
        const flat = Math.max(...palette[which].map((x, k) => Math.abs(x - p[k]))) < 1.5;
        out[i] = (flat ? 101 : 1) + which;
      }
      return { out, width, height };
    }, change);

  /**
   * Asserts that each pixel shows what it or one of its neighbours must show. A surface that is as bright as a section
   * may be taken for one.
   * @param {{out: number[], width: number, height: number}} picture
   * @param {Uint8Array} wanted
   */
  function alike({ out, width, height }, wanted) {
    let drawn = 0;
    for (let y = 1; y < height - 1; y++) {
      for (let x = 1; x < width - 1; x++) {
        const found = out[y * width + x];
        if (found) drawn++;
        const around = [-1, 0, 1].flatMap((j) => [-1, 0, 1].map((i) => wanted[(y + j) * width + x + i]));
        const fits = around.some((w) => w === found || (found > 100 && w === found - 100));
        assert.ok(fits, `pixel ${x}, ${y} shows ${found}, not ${around}`);
      }
    }
    const due = wanted.filter((w) => w > 0).length;
    assert.ok(Math.abs(drawn - due) < 0.02 * due, `${drawn} pixels drawn, ${due} are due`);
  }

  test(
    "a grain that crosses a face of a periodic box is cut there and enters at the opposite one",
    inBrowser,
    async () => {
      for (const pointLimit of [512, 8]) {
        // Over an edge: a quarter at each of four places, as seen along that edge.
        const opened = await show(sphereFile(SIZE, [1, 20, 2, 16]), { width: 300, height: 300, pointLimit });
        const pose = { az: Math.PI / 2, el: 0, zoom: 1, pan: [0, 0] };
        const places = async (/** @type {boolean} */ periodic) => {
          await opened.page.evaluate(
            (is) => Object.assign(/** @type {any} */ (window).viewer, { periodic: is }),
            periodic,
          );
          const { out, width, height } = await seen(opened.page, { pose, set: { colour: "size" } });
          const quarters = [0, 0, 0, 0];
          out.forEach((what, i) => {
            if (what) quarters[(i % width < width / 2 ? 0 : 1) + (i < (width * height) / 2 ? 0 : 2)] += 1;
          });
          return quarters.map((count) => count > 100);
        };
        // Seen from y, x grows to the left: the sphere itself is at the lower right.
        assert.deepEqual(await places(false), [false, false, false, true]);
        assert.deepEqual(await places(true), [true, true, true, true]);
        opened.clean();
        await opened.close();
      }
    },
  );

  for (const [name, pointLimit] of /** @type {[string, number][]} */ ([
    ["points", 512],
    ["quads", 8],
  ])) {
    test(`three spheres to a pixel, as ${name}`, inBrowser, async () => {
      const opened = await show(sphereFile(SIZE, SPHERES), { width: 420, height: 320, pointLimit });
      const home = { az: 0.6, el: 0.4, zoom: 1, pan: [0, 0] };
      const near = { az: -2, el: -0.7, zoom: 4, pan: [0.4, -0.9] };
      const loaded = await opened.page.evaluate(() => performance.getEntriesByType("resource").map(({ name }) => name));
      assert.ok(loaded.some((name) => name.endsWith("/viewer/draw.js")));
      assert.ok(!loaded.some((name) => /\/viewer\/(bodies|picture)\.js$/.test(name)), "what spheres do not need");
      for (const [pose, cut] of /** @type {[typeof home, number[]][]} */ ([
        [home, [FAR, FAR, FAR]],
        [home, [20, FAR, FAR]],
        [home, [FAR, 14, 23]],
        [near, [FAR, FAR, FAR]],
        [{ ...home, zoom: 9 }, [FAR, FAR, FAR]],
      ])) {
        const picture = await seen(opened.page, { pose, set: { cut, colour: "class", classes: CLASSES } });
        alike(picture, expected(SIZE, hitsOfSpheres(SPHERES), pose, cut, picture.width, picture.height));
      }
      opened.clean();
      await opened.close();
    });
  }

  test("an ellipsoid and two cubes to a pixel", inBrowser, async () => {
    const opened = await show(bodyFile(SIZE, BODIES), { width: 420, height: 320 });
    const home = { az: 0.6, el: 0.4, zoom: 1, pan: [0, 0] };
    for (const [pose, cut] of /** @type {[typeof home, number[]][]} */ ([
      [home, [FAR, FAR, FAR]],
      [home, [23, FAR, FAR]],
      [home, [FAR, 29, 31]],
      [{ az: -2, el: -0.7, zoom: 3, pan: [0.2, 0.1] }, [FAR, FAR, FAR]],
    ])) {
      for (const colour of ["aggregate", "class"]) {
        const picture = await seen(opened.page, { pose, set: { cut, colour, classes: CLASSES } });
        alike(picture, expected(SIZE, hitsOfBodies(BODIES), pose, cut, picture.width, picture.height));
      }
    }
    opened.clean();
    await opened.close();
  });

  test("the section at a cut is flat and the grains beyond it are gone", inBrowser, async () => {
    const opened = await show(sphereFile(SIZE, SPHERES), { width: 400, height: 400 });
    const pose = { az: 0, el: 0, zoom: 1, pan: [0, 0] };
    const cut = [22, FAR, FAR];
    const picture = await seen(opened.page, { pose, set: { cut, colour: "class", classes: CLASSES } });
    const wanted = expected(SIZE, hitsOfSpheres(SPHERES), pose, cut, 400, 400);
    const count = (/** @type {ArrayLike<number>} */ list, /** @type {number} */ value) =>
      Array.from(list).filter((v) => v === value).length;
    const disc = count(wanted, 101);
    assert.ok(disc > 5000, `the section has ${disc} pixels`);
    assert.ok(Math.abs(count(picture.out, 101) - disc) <= 0.01 * disc);
    assert.equal(count(picture.out, 3) + count(picture.out, 103), 0);
    await opened.close();
  });

  test("an octant and what lies beyond an oblique plane are removed", inBrowser, async () => {
    const opened = await show(sphereFile(SIZE, SPHERES), { width: 400, height: 400 });
    const pose = { az: 0.6, el: 0.4, zoom: 1, pan: [0, 0] };
    const n = turn([0.7, 0.5, -0.4]);
    for (const [cut, octant, plane] of /** @type {[number[], boolean, number[] | null][]} */ ([
      [[20, 17, 19], true, null],
      [[FAR, FAR, FAR], false, [...n, 14]],
      [[20, 17, 19], true, [...n, 18]],
    ])) {
      const set = { cut, octant, plane, colour: "class", classes: CLASSES };
      const picture = await seen(opened.page, { pose, set });
      const wanted = expected(SIZE, hitsOfSpheres(SPHERES), pose, cut, 400, 400, { octant, plane: plane ?? undefined });
      // The three faces of an octant differ in their light.
      alike(
        { ...picture, out: picture.out.map((w) => w % 100) },
        wanted.map((w) => w % 100),
      );
      assert.ok(wanted.some((w) => w > 100));
    }
    await opened.close();
  });

  test(
    "the matrix hides what is in it and shows the sections; a grain is picked where it is seen",
    inBrowser,
    async () => {
      for (const [name, file] of /** @type {[string, Buffer][]} */ ([
        ["spheres", sphereFile(SIZE, SPHERES)],
        ["bodies", bodyFile(SIZE, BODIES)],
      ])) {
        const opened = await show(file, { width: 400, height: 400 });
        const pose = { az: 0.6, el: 0.4, zoom: 1, pan: [0, 0] };
        const hits = name === "spheres" ? hitsOfSpheres(SPHERES) : hitsOfBodies(BODIES);
        const cut = [20, 17, 19];
        const wanted = expected(SIZE, hits, pose, cut, 400, 400, { octant: true });
        const picked = await opened.page.evaluate(
          async ({ pose, cut }) => {
            const { viewer, rest } = /** @type {any} */ (window);
            const done = rest();
            viewer.set({ pose, cut, octant: true, matrix: true });
            await done;
            const found = [];
            for (let y = 4; y < 400; y += 12)
              for (let x = 4; x < 400; x += 12) found.push([x, y, (await viewer.grainAt(x, y))?.index ?? -1]);
            return found;
          },
          { pose, cut },
        );
        let seenGrains = 0;
        for (const [x = 0, y = 0, index = -1] of picked) {
          const around = [-1, 0, 1].flatMap((j) => [-1, 0, 1].map((i) => wanted[(y + j) * 400 + x + i] ?? 0));
          // In the matrix only the sections are seen.
          const shown = around.map((w) => (w > 100 ? w - 101 : -1));
          assert.ok(shown.includes(index), `${name}: at ${x}, ${y} grain ${index}, not ${shown}`);
          if (index >= 0) seenGrains++;
        }
        assert.ok(seenGrains > 10, `${seenGrains} grains were picked`);
        const facts = await opened.page.evaluate(async () => {
          const { viewer } = /** @type {any} */ (window);
          const done = /** @type {any} */ (window).rest();
          viewer.set({ cut: [1e9, 1e9, 1e9], octant: false, matrix: false });
          await done;
          return viewer.grainAt(200, 200);
        });
        const [x = 0, y = 0, z = 0, size = 0] = name === "spheres" ? SPHERES : [...BODIES[0].at, BODIES[0].size];
        assert.equal(facts.index, 0);
        for (const [value, due] of [
          ...facts.at.map((/** @type {number} */ v, /** @type {number} */ i) => [v, [x, y, z][i]]),
          [facts.size, size],
        ])
          assert.ok(Math.abs(value - due) < 0.01, `${value} ${due}`);
        await opened.close();
      }
    },
  );

  test("sizes that are hidden are not drawn, and are counted", inBrowser, async () => {
    const opened = await show(sphereFile(SIZE, SPHERES), { width: 300, height: 300 });
    const pose = { az: 0.6, el: 0.4, zoom: 1, pan: [0, 0] };
    const cut = [FAR, FAR, FAR];
    const [, middle] = [SPHERES.slice(0, 4), SPHERES.slice(4, 8)];
    const picture = await seen(opened.page, { pose, set: { cut, show: [7, 19], colour: "class", classes: CLASSES } });
    const wanted = expected(SIZE, hitsOfSpheres(middle), pose, cut, 300, 300).map((w) => (w ? w + 1 : 0));
    alike(picture, wanted);
    const ranges = await opened.page.evaluate(() => {
      const { viewer } = /** @type {any} */ (window);
      return [
        [0, 1e9],
        [7, 19],
        [12, 12],
        [0, 5.9],
        [20, 30],
      ].map((show) => {
        viewer.show = show;
        return viewer.range();
      });
    });
    assert.deepEqual(ranges, [
      [0, 3],
      [1, 2],
      [1, 2],
      [3, 3],
      [0, 1],
    ]);
    await opened.close();
  });

  test("keys, mouse and wheel turn, move and magnify; nothing is drawn at rest", inBrowser, async () => {
    const opened = await show(sphereFile(SIZE, SPHERES), { width: 300, height: 300 });
    const { page } = opened;
    const pose = () =>
      page.evaluate(() =>
        structuredClone({ .../** @type {any} */ (window).viewer.pose, cut: /** @type {any} */ (window).viewer.cut }),
      );
    await page.evaluate(() => {
      /** @type {any} */ (window).viewer.canvas.tabIndex = 0;
    });
    await page.locator("canvas").focus();
    const start = await pose();
    await page.keyboard.press("ArrowLeft");
    await page.keyboard.press("ArrowUp");
    const turned = await pose();
    assert.ok(turned.az < start.az && turned.el > start.el);
    await page.keyboard.press("+");
    assert.ok((await pose()).zoom > start.zoom);
    await page.keyboard.press("c");
    assert.deepEqual((await pose()).cut, [20, 1e9, 1e9]);
    await page.keyboard.press("c");
    assert.deepEqual((await pose()).cut, [1e9, 20, 1e9]);
    await page.keyboard.press("Home");
    assert.deepEqual(await pose(), start);
    await page.mouse.move(150, 150);
    await page.mouse.down();
    await page.mouse.move(190, 170, { steps: 3 });
    await page.mouse.up();
    const dragged = await pose();
    assert.ok(dragged.az < start.az && dragged.el > start.el);
    await page.mouse.wheel(0, -200);
    await page.waitForFunction((zoom) => /** @type {any} */ (window).viewer.pose.zoom > zoom, start.zoom);
    const wheeled = await pose();
    const touch = await page.context().newCDPSession(page);
    const fingers = (/** @type {string} */ type, /** @type {number[][]} */ points) =>
      touch.send("Input.dispatchTouchEvent", {
        type: /** @type {any} */ (type),
        touchPoints: points.map(([x, y], id) => ({ x, y, id })),
      });
    await fingers("touchStart", [
      [100, 150],
      [200, 150],
    ]);
    await fingers("touchMove", [
      [80, 150],
      [220, 150],
    ]);
    await fingers("touchEnd", []);
    await page.waitForFunction((zoom) => /** @type {any} */ (window).viewer.pose.zoom > 1.3 * zoom, wheeled.zoom);
    const pinched = await pose();
    assert.equal(pinched.az, wheeled.az);
    const rest = page.evaluate(() => /** @type {any} */ (window).rest());
    await fingers("touchStart", [[100, 150]]);
    await fingers("touchMove", [[140, 150]]);
    await fingers("touchEnd", []);
    await page.waitForFunction((az) => /** @type {any} */ (window).viewer.pose.az < az, pinched.az);
    await rest;
    const frames = () => page.evaluate(() => /** @type {any} */ (window).frames);
    const atRest = await frames();
    await page.evaluate(
      () =>
        new Promise((done) => {
          // thirty frames of the screen
          let left = 30;
          const next = () => (left-- ? requestAnimationFrame(next) : done(null));
          next();
        }),
    );
    assert.equal(await frames(), atRest);
    opened.clean();
    await opened.close();
  });

  for (const [kind, file, hits] of /** @type {[string, Buffer, import("./view.js").Hit[]][]} */ ([
    ["spheres", sphereFile(SIZE, SPHERES), hitsOfSpheres(SPHERES)],
    ["other grains", bodyFile(SIZE, BODIES), hitsOfBodies(BODIES)],
  ])) {
    test(`a lost context with ${kind} is survived`, inBrowser, async () => {
      const opened = await show(file, { width: 300, height: 300 });
      const pose = { az: 0.6, el: 0.4, zoom: 1, pan: [0, 0] };
      await opened.page.evaluate(async () => {
        const { viewer, rest } = /** @type {any} */ (window);
        const lose = viewer.gl.getExtension("WEBGL_lose_context");
        // A context can be restored once its event has been handled.
        const lost = new Promise((done) =>
          viewer.canvas.addEventListener("webglcontextlost", () => setTimeout(done), { once: true }),
        );
        lose.loseContext();
        await lost;
        const done = rest();
        lose.restoreContext();
        await done;
      });
      const picture = await seen(opened.page, { pose, set: { colour: "class", classes: CLASSES } });
      alike(picture, expected(SIZE, hits, pose, [FAR, FAR, FAR], 300, 300));
      await opened.close();
    });
  }

  test("a picture of tiles is the picture of the canvas", inBrowser, async () => {
    const opened = await show(sphereFile(SIZE, SPHERES), { width: 600, height: 400 });
    const result = await opened.page.evaluate(async () => {
      const { viewer } = /** @type {any} */ (window);
      const blob = await viewer.png(4800, 3200, [255, 255, 255]);
      const image = await createImageBitmap(blob, { resizeWidth: 600, resizeHeight: 400, resizeQuality: "high" });
      const flat = Object.assign(document.createElement("canvas"), { width: 600, height: 400 }).getContext("2d");
      flat.drawImage(image, 0, 0);
      const saved = flat.getImageData(0, 0, 600, 400).data;
      const shown = new Uint8Array(4 * 600 * 400);
      viewer.gl.readPixels(0, 0, 600, 400, viewer.gl.RGBA, viewer.gl.UNSIGNED_BYTE, shown);
      let sum = 0;
      for (let y = 0; y < 400; y++) {
        for (let x = 0; x < 600; x++) {
          for (let k = 0; k < 3; k++) {
            const at = 4 * ((399 - y) * 600 + x);
            const here = shown[at + 3] ? shown[at + k] : 255;
            sum += Math.abs(here - saved[4 * (y * 600 + x) + k]);
          }
        }
      }
      return { type: blob.type, mean: sum / 600 / 400 / 3 / 255 };
    });
    assert.equal(result.type, "image/png");
    assert.ok(result.mean < 0.01, `mean difference ${result.mean}`);
    opened.clean();
    await opened.close();
  });

  test("what is no view is refused, and a stream that ends early", inBrowser, async () => {
    const opened = await show(sphereFile(SIZE, SPHERES), { width: 300, height: 300 });
    const faults = await opened.page.evaluate(async () => {
      const { viewer } = /** @type {any} */ (window);
      const bytes = new Uint8Array(await (await fetch("/file.view")).arrayBuffer());
      const open = (/** @type {Uint8Array<ArrayBuffer>} */ b) => async () => new Blob([b]).stream();
      const wrong = bytes.slice();
      wrong[12] = 2;
      const found = [];
      for (const b of [wrong, bytes.slice(0, 70)]) {
        found.push(
          await viewer.load(open(b)).then(
            () => "",
            (/** @type {Error} */ e) => e.message,
          ),
        );
      }
      return found;
    });
    assert.deepEqual(faults, ["This is not a view of version 1.", "The view ended early."]);
    await opened.close();
  });

  for (const [count, length] of [
    [44_000, 150],
    [2_000_000, 530],
  ]) {
    test(`${count} grains: drawn as they arrive, a turn, a cut`, inBrowser, async (context) => {
      const opened = await show(sphereFile([length, length, length], manySpheres(count, length)), {
        width: 900,
        height: 700,
      });
      const figures = await opened.page.evaluate(async () => {
        const { viewer, rest } = /** @type {any} */ (window);
        const { performance: clock } = window;
        // The file again, as it comes at 100 Mbit/s.
        const file = new Uint8Array(await (await fetch("/file.view")).arrayBuffer());
        const begin = clock.now();
        let sent = 0;
        const slow = () =>
          new ReadableStream({
            async pull(controller) {
              const due = (/** @type {number} */ bytes) => begin + (bytes / 12.5e6) * 1000 - clock.now();
              const part = file.slice(sent, sent + 65536);
              sent += part.length;
              while (due(sent) > 0) await new Promise((done) => setTimeout(done, due(sent)));
              if (part.length) controller.enqueue(part);
              if (sent >= file.length) controller.close();
            },
          });
        const firstFrame = new Promise((done) =>
          viewer.addEventListener(
            "frame",
            () => done({ ms: Math.round(clock.now() - begin), grains: viewer.frame.grains }),
            { once: true },
          ),
        );
        const whole = rest();
        await viewer.load(async () => slow());
        const arrivedAt = Math.round(clock.now() - begin);
        await whole;
        const load = { first: await firstFrame, arrived: arrivedAt, drawn: Math.round(clock.now() - begin) };
        const turn = [];
        for (let i = 0; i < 40; i++) {
          const frame = new Promise((done) => viewer.addEventListener("frame", done, { once: true }));
          viewer.turn(0.02, 0.005);
          await frame;
          if (viewer.frame.moving) turn.push(viewer.frame.ms);
        }
        const last = viewer.frame;
        const start = clock.now();
        const done = rest();
        viewer.set({ cut: [viewer.head.size[0] / 2, 1e9, 1e9] });
        await done;
        const cut = clock.now() - start;
        let pixels = 0;
        const { width, height } = viewer.canvas;
        const all = new Uint8Array(4 * width * height);
        viewer.gl.readPixels(0, 0, width, height, viewer.gl.RGBA, viewer.gl.UNSIGNED_BYTE, all);
        for (let i = 3; i < all.length; i += 4) if (all[i]) pixels++;
        turn.sort((a, b) => a - b);
        const buffer = file.length;
        return {
          load,
          buffer,
          arrived: viewer.arrived,
          drawn: viewer.drawn,
          pixels,
          size: width * height,
          moving: last,
          turn: {
            median: turn[Math.floor(turn.length / 2)],
            p95: turn[Math.floor(turn.length * 0.95)],
            frames: turn.length,
          },
          cut,
          heap: /** @type {any} */ (clock).memory.usedJSHeapSize,
        };
      });
      context.diagnostic(JSON.stringify(figures));
      assert.equal(figures.arrived, count);
      assert.equal(figures.drawn, count);
      assert.ok(figures.pixels > 0.1 * figures.size, `${figures.pixels} of ${figures.size} pixels drawn`);
      const memory = figures.heap + figures.buffer;
      assert.ok(memory < 100e6, `${memory} bytes of heap and buffers`);
      opened.clean();
      await opened.close();
    });
  }

  test("the grains of a result arrive as the interface has them", inBrowser, async () => {
    const job = await server.pack(SMALL);
    const file = Buffer.from(await (await server.ask(`/v1/jobs/${job.id}/result?format=view`)).arrayBuffer());
    const { columns, rows } = (await (await server.ask(`/v1/jobs/${job.id}/result`)).json()).grains;
    const opened = await show(file, { width: 300, height: 300 });
    const read = await opened.page.evaluate(() => {
      const { head, arrived } = /** @type {any} */ (window).viewer;
      return { ...head, arrived };
    });
    assert.deepEqual(columns.slice(0, 4), ["x_mm", "y_mm", "z_mm", "d_mm"]);
    assert.equal(read.arrived, rows.length);
    // The viewer relies on it.
    const sizes = rows.map((/** @type {any} */ _, /** @type {number} */ i) => file.readUInt16LE(64 + 8 * i + 6));
    assert.deepEqual(
      sizes,
      sizes.toSorted((/** @type {number} */ a, /** @type {number} */ b) => b - a),
    );
    assert.deepEqual(read.size, [40, 40, 40]);
    assert.ok(Math.abs(read.dmax - rows[0][3]) < 1e-4);
    await opened.close();
  });
});
