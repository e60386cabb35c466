// Names of lights: illuminants, CSV files of the served folder, and uploaded ones.

import { DELETED, get, showError, upload } from "./api.js";
import { element } from "./dom.js";

const ILLUMINANTS = ["A", "D50", "D65", "3200K", "daylight 5600", "led 4000", "FL2", "FL11", "sunlight"];
const uploaded = [];
window.addEventListener(DELETED, ({ detail }) => {
  const at = uploaded.findIndex(([name]) => name === detail);
  if (at >= 0) uploaded.splice(at, 1);
});

// All names with what they are called.
export async function lights() {
  const files = await get("/api/files?kind=lamp").catch(() => []);
  return [...ILLUMINANTS.map((name) => [name, name]), ...files.map(({ name }) => [`file:${name}`, name]), ...uploaded];
}

// A button that uploads a spectrum; `done` gets its name.
export function spectrumUpload(done) {
  const box = element("input", { type: "file", hidden: true, "aria-label": "Upload the spectrum of a light", onchange: async () => {
    try {
      for (const file of box.files) {
        const found = await upload(file, "lamp");
        uploaded.push([found.name, found.file_name]);
        showError("");
        done(found.name);
      }
    } catch (error) { showError(error.message); }
  } });
  return [element("button", { type: "button", onclick: () => box.click() }, "Upload a spectrum …"), box];
}

let count = 0;

// A field for the name of a light, with the known names and an upload. `changed` gets the name.
export function lightField(label, known, value, changed) {
  const list = element("datalist", { id: `lights-${++count}` }, ...known.map(([name, text]) => element("option", { value: name, label: text === name ? null : text })));
  const box = element("input", { type: "text", list: list.id, required: true });
  box.value = value;
  box.addEventListener("change", () => { if (box.value.trim()) changed(box.value.trim()); });
  const [button, file] = spectrumUpload((name) => { box.value = name; changed(name); });
  return [element("label", {}, label, box), button, file, list];
}
