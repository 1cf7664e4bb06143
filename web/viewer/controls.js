// Mouse, touch, wheel and keys of the viewer. One finger or the left button turns, two fingers zoom and move, the right
// button or Shift moves. A click, or Enter for the middle, asks for a grain.
// @ts-check

/** @param {import("./viewer.js").Viewer} viewer */
export function controls(viewer) {
  const { canvas } = viewer;
  /** @type {Map<number, number[]>} */
  const down = new Map();
  const half = () => Math.min(canvas.clientWidth, canvas.clientHeight) / 2;
  /** A place on the screen in halves of the shorter side from the middle, y upwards. */
  const place = (/** @type {number} */ x, /** @type {number} */ y) => {
    const box = canvas.getBoundingClientRect();
    return [(x - box.left - box.width / 2) / half(), (box.top + box.height / 2 - y) / half()];
  };
  /** Where the pointer went down, while it has hardly moved. @type {number[] | undefined} */
  let pressed;
  canvas.onpointerdown = (e) => {
    pressed = down.size || e.button ? undefined : [e.clientX, e.clientY];
    down.set(e.pointerId, [e.clientX, e.clientY]);
    canvas.setPointerCapture(e.pointerId);
  };
  canvas.onpointerup = (e) => {
    if (!pressed) return;
    const box = canvas.getBoundingClientRect();
    viewer.dispatchEvent(new CustomEvent("pick", { detail: [e.clientX - box.left, e.clientY - box.top] }));
  };
  canvas.onlostpointercapture = (e) => down.delete(e.pointerId);
  canvas.onpointermove = (e) => {
    const was = down.get(e.pointerId);
    if (!was) return;
    const now = [e.clientX, e.clientY];
    if (pressed && Math.hypot(now[0] - pressed[0], now[1] - pressed[1]) > 4) pressed = undefined;
    const [dx, dy] = [0, 1].map((i) => (now[i] - was[i]) / half());
    const other = [...down].find(([id]) => id !== e.pointerId)?.[1];
    down.set(e.pointerId, now);
    if (other) {
      const apart = (/** @type {number[]} */ p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      if (apart(was)) viewer.magnify(apart(now) / apart(was), place((now[0] + other[0]) / 2, (now[1] + other[1]) / 2));
      viewer.move(dx / 2, -dy / 2);
    } else if (e.shiftKey || e.buttons & 6) viewer.move(dx, -dy);
    else viewer.turn(-2 * dx, 2 * dy);
  };
  canvas.oncontextmenu = (e) => e.preventDefault();
  canvas.onwheel = (e) => {
    e.preventDefault();
    const lines = e.deltaMode === 1 ? 30 : 1;
    viewer.magnify(Math.exp(-0.0015 * lines * Math.max(-200, Math.min(200, e.deltaY))), place(e.clientX, e.clientY));
  };
  canvas.onkeydown = (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    const arrow = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
    if (arrow && e.shiftKey) viewer.move(-arrow[0], arrow[1]);
    else if (arrow) viewer.turn(-arrow[0], arrow[1]);
    else if (e.key === "+" || e.key === "=") viewer.magnify(1.2);
    else if (e.key === "-") viewer.magnify(1 / 1.2);
    else if (e.key === "Home") viewer.reset();
    else if (e.key.toLowerCase() === "c") viewer.cycleCut();
    else if (e.key === "Enter")
      viewer.dispatchEvent(
        new CustomEvent("pick", { detail: [canvas.clientWidth, canvas.clientHeight].map((l) => l / 2) }),
      );
    else return;
    e.preventDefault();
  };
}
