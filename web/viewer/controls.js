// Mouse, touch, wheel and keys of the viewer. One finger or the left button turns, two fingers zoom and move, the right
// button or Shift moves.
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
  canvas.addEventListener("pointerdown", (e) => {
    down.set(e.pointerId, [e.clientX, e.clientY]);
    canvas.setPointerCapture(e.pointerId);
  });
  canvas.addEventListener("pointermove", (e) => {
    const was = down.get(e.pointerId);
    if (!was) return;
    const now = [e.clientX, e.clientY];
    const [dx, dy] = [now[0] - was[0], now[1] - was[1]];
    const other = [...down].find(([id]) => id !== e.pointerId)?.[1];
    down.set(e.pointerId, now);
    if (other) {
      const apart = (/** @type {number[]} */ p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      const middle = place((now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      if (apart(was) > 0) viewer.magnify(apart(now) / apart(was), middle);
      viewer.move(dx / 2 / half(), -dy / 2 / half());
    } else if (e.shiftKey || e.buttons & 6) viewer.move(dx / half(), -dy / half());
    else viewer.turn((-2 * dx) / half(), (2 * dy) / half());
  });
  for (const type of /** @type {("pointerup" | "pointercancel")[]} */ (["pointerup", "pointercancel"])) {
    canvas.addEventListener(type, (e) => down.delete(e.pointerId));
  }
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener(
    "wheel",
    (e) => {
      e.preventDefault();
      const lines = e.deltaMode === 1 ? 30 : 1;
      viewer.magnify(Math.exp(-0.0015 * lines * Math.max(-200, Math.min(200, e.deltaY))), place(e.clientX, e.clientY));
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    const arrow = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
    if (arrow && e.shiftKey) viewer.move(-arrow[0] / 10, arrow[1] / 10);
    else if (arrow) viewer.turn(-arrow[0] / 10, arrow[1] / 10);
    else if (e.key === "+" || e.key === "=") viewer.magnify(1.2);
    else if (e.key === "-") viewer.magnify(1 / 1.2);
    else if (e.key === "Home") viewer.reset();
    else if (e.key.toLowerCase() === "c") viewer.cycleCut();
    else return;
    e.preventDefault();
  });
}
