// The uploaded files, in a dialog from which a person deletes them.

import { DELETED, UPLOADED, get, remove, showError } from "./api.js";
import { element, sizeText, table } from "./dom.js";

const KINDS = { scene: "scene", sensor: "sensor", lens: "lens", raw: "raw frame", lamp: "spectrum of a light", frames: "folder of frames" };
const button = document.getElementById("uploads-open"), dialog = document.getElementById("uploads"), list = document.getElementById("uploads-list");
let later = null;

async function refresh() {
  const found = await get("/api/uploads").catch(() => []);
  button.hidden = !found.length;
  button.textContent = `Uploads (${found.length})`;
  if (!found.length) dialog.close();
  list.replaceChildren(table("Deleted when the server ends.", ["File", "Kind", "Holds", "Size", ""], found.map((each) => [
    each.file_name, KINDS[each.kind], each.holds, sizeText(each.bytes),
    element("button", { type: "button", "aria-label": `Delete ${each.file_name}`, onclick: () => deleteUpload(each.name) }, "Delete"),
  ]), { class: "stacked uploads" }));
}

async function deleteUpload(name) {
  try {
    await remove(`/api/uploads/${name.replace("upload:", "")}`);
    showError("");
  } catch (error) { showError(error.message); } // another tab has deleted it
  window.dispatchEvent(new CustomEvent(DELETED, { detail: name }));
  await refresh();
  (list.querySelector("button") ?? document.getElementById("main")).focus();
}

button.addEventListener("click", async () => { await refresh(); dialog.showModal(); });
document.getElementById("uploads-close").addEventListener("click", () => dialog.close());
window.addEventListener(UPLOADED, () => { // frames of a folder arrive one after the other
  clearTimeout(later);
  later = setTimeout(refresh, 200);
});
refresh();
