/** The dialog that asks for an API key, and the exchange of the key for a session. Loaded where a key is needed. */
import { Problem, send } from "./api.js";
import { h, replace } from "./dom.js";

/**
 * Shows the dialog until the server has accepted a key.
 * @returns {Promise<void>} rejects with the problem 401 where the dialog is closed without a key
 */
export function ask() {
  return new Promise((resolve, reject) => {
    const fault = h("p", { class: "fault", id: "key-fault", role: "alert" });
    const field = h("input", {
      id: "key-field",
      type: "password",
      autocomplete: "current-password",
      required: true,
      spellcheck: "false",
      "aria-describedby": "key-hint key-fault",
    });
    const form = h(
      "form",
      { class: "stack" },
      h("h2", { id: "key-title" }, "API key"),
      h(
        "p",
        { id: "key-hint" },
        "This server asks for an API key. It is exchanged for a session of 12 hours, and not stored.",
      ),
      // Password managers keep the key under this name.
      h("input", { type: "text", autocomplete: "username", value: "packstone", readonly: true, hidden: true }),
      h("div", { class: "field" }, h("label", { for: "key-field" }, "Key"), field, fault),
      h(
        "div",
        { class: "actions" },
        h("button", { type: "submit", class: "primary" }, "Sign in"),
        h("button", { type: "button", onclick: () => dialog.close() }, "Not now"),
      ),
    );
    const dialog = h("dialog", { "aria-labelledby": "key-title", class: "small" }, form);
    let accepted = false;
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      replace(fault);
      try {
        await send("POST", "/session", { key: field.value.trim() }, { quiet: true });
        accepted = true;
        dialog.close();
      } catch (error) {
        const known = error instanceof Problem && error.status === 401;
        replace(fault, known ? "The server does not know this key." : /** @type {Error} */ (error).message);
        field.setAttribute("aria-invalid", "true");
        field.select();
      }
    });
    dialog.addEventListener("close", () => {
      dialog.remove();
      if (!accepted) return reject(new Problem(401, { title: "Unauthorized", detail: "This needs an API key." }));
      document.dispatchEvent(new Event("session"));
      resolve();
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
