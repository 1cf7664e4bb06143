/** The controls of the viewer that save its picture as PNG. */
import { h, number, text } from "./dom.js";

/**
 * Width, background, and the button that saves.
 * @param {import("./viewer/viewer.js").Viewer} viewer
 * @param {string} name of the file, without its end
 */
export function picturePart(viewer, name) {
  const width = h(
    "select",
    { id: "png-width" },
    [1600, 3200, 6400, 12800].map((w) => h("option", { value: w }, `${number(w)} px`)),
  );
  const ground = h(
    "select",
    { id: "png-ground" },
    h("option", { value: "white" }, "white"),
    h("option", { value: "" }, "transparent"),
  );
  const fault = h("p", { class: "fault", role: "alert" });
  const save = h(
    "button",
    {
      type: "button",
      id: "save-picture",
      onclick: async () => {
        const w = Number(width.value);
        save.disabled = true;
        text(save, "Drawing");
        text(fault, "");
        try {
          const height = Math.round((w * viewer.canvas.clientHeight) / viewer.canvas.clientWidth);
          const blob = await viewer.png(w, height, ground.value ? [255, 255, 255] : undefined);
          const link = h("a", { href: URL.createObjectURL(blob), download: `${name}.png` });
          link.click();
          setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
        } catch (error) {
          text(fault, /** @type {Error} */ (error).message);
        }
        save.disabled = false;
        text(save, "Save picture");
      },
    },
    "Save picture",
  );
  return h(
    "fieldset",
    { class: "stack tight", "aria-label": "Picture as PNG" },
    h(
      "div",
      { class: "row" },
      h("div", { class: "field" }, h("label", { for: "png-width" }, "Width"), width),
      h("div", { class: "field" }, h("label", { for: "png-ground" }, "Background"), ground),
    ),
    h("div", { class: "actions" }, save),
    fault,
  );
}
