// A folder of frames that a person drops or chooses: its files are uploaded one after the other.

import { upload } from "./api.js";
import { element } from "./dom.js";
import { dropped } from "./drop.js";

const FRAMES = /\.(dng|tiff?|png|h5|hdf5?|fits?|fts|3fr|arw|cr[23w]|dcr|erf|fff|iiq|kdc|mef|mos|mrw|ne[fx]|nrw|orf|pef|ra[fw]|rw2|rwl|sr[2fw]|srf|x3f)$/i;

async function filesOf(entry, path = "") {
  if (entry.isFile) {
    const file = await new Promise((done, failed) => entry.file(done, failed));
    return [{ file, name: `${path}${file.name}` }];
  }
  const reader = entry.createReader(), found = [];
  for (;;) { // a reader returns its entries in parts
    const part = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!part.length) break;
    for (const each of part) found.push(...await filesOf(each, `${path}${entry.name}/`));
  }
  return found;
}

// A place for a folder. `taken(name, label)` gets the name of the uploaded folder.
export function folderDrop(taken) {
  let stop = false, busy = false;
  const text = element("span", { role: "status" });
  const cancel = element("button", { type: "button", hidden: true, onclick: () => { stop = true; } }, "Cancel");
  const chooser = element("input", { type: "file", id: "frames-folder", class: "hidden", tabindex: "-1", "aria-hidden": "true", webkitdirectory: true, multiple: true });
  const button = element("button", { type: "button", onclick: () => chooser.click() }, "Choose a folder …");
  async function send(found) {
    const frames = found.filter(({ name }) => FRAMES.test(name) && !name.split("/").some((part) => part.startsWith("."))).sort((a, b) => (a.name < b.name ? -1 : 1));
    if (busy) return;
    if (!frames.length) { text.textContent = "There are no raw frames in it."; return; }
    const label = frames[0].name.split("/")[0], depth = frames.every(({ name }) => name.startsWith(`${label}/`)) ? label.length + 1 : 0;
    const others = found.length - frames.length;
    busy = true;
    stop = false;
    cancel.hidden = false;
    let folder = "";
    try {
      for (const [k, { file, name }] of frames.entries()) {
        if (stop) break;
        text.textContent = `Uploading and checking ${k + 1} of ${frames.length} frames`;
        folder = (await upload(file, "frames", { folder, name: name.slice(depth) })).name;
      }
      text.textContent = stop ? "Upload cancelled." : `${frames.length} frames of ${label} uploaded${others ? `, ${others} other ${others > 1 ? "files" : "file"} left out` : ""}.`;
      if (!stop) taken(folder, label);
    } catch (error) { text.textContent = `Upload failed: ${error.message}`; }
    busy = false;
    cancel.hidden = true;
  }
  chooser.addEventListener("change", () => send([...chooser.files].map((file) => ({ file, name: file.webkitRelativePath || file.name }))));
  const box = element("div", { class: "drop-here" }, element("span", {}, "Drop a folder of frames here, or"), button, chooser, text, cancel);
  dropped(box, async (entries) => {
    const lists = await Promise.all(entries.map((entry) => (entry instanceof File ? [{ file: entry, name: entry.name }] : filesOf(entry))));
    send(lists.flat());
  }, { folders: true });
  return box;
}
