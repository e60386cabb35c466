// A calibration: a folder of the server or an uploaded one, its groups of frames, and the results.

import { DELETED, finished, get, post, showError, tab } from "./api.js";
import { element, short, table } from "./dom.js";
import { folderDrop } from "./folder.js";
import { jobBar } from "./jobview.js";
import { drawResults } from "./results.js";

const unstated = [["bits", "Bit depth", "12"], ["cfa", "Color filter array", "rggb"], ["black_level_dn", "Black level (DN)", "64"], ["exposure_s", "Exposure time (s)", "0.02"], ["region", "Pixels with light", "0:1080,0:1920"], ["layout", "Layout of headerless files", "3280x2464,packed=mipi10"], ["where", "One of several settings", "filter=R"]];
const numbers = { bits: { min: 1, max: 16, step: 1 }, black_level_dn: { min: 0, max: 65535, step: "any" }, exposure_s: { min: 1e-9, max: 1e6, step: "any" } };
const fresh = { groups: [], each_setting: false, maps: false, pixel_gain: false, captures: [], bits: null, cfa: "", black_level_dn: null, exposure_s: null, region: "", layout: "", where: "" };
let request = { folder: "", sensor: null, ...fresh };
let built = false, found = null, listing = 0, forget = () => {};
window.addEventListener(DELETED, ({ detail }) => forget(detail));

export async function show(content) {
  const root = document.getElementById("view-calibrate");
  if (built && !content) return;
  built = true;
  if (content) request = { ...request, ...content };
  const [{ sensors }, folders, files, server] = await Promise.all([post("/api/form", {}), get("/api/files?kind=folder"), get("/api/files?kind=sensor"), get("/api/server")]);
  const groups = element("div", { "aria-live": "polite" }), results = element("div", { "aria-live": "polite" });
  const { bar } = jobBar("calibration", "calibrate", () => request, (result) => { drawResults(results, result); bar.scrollIntoView(); }, "Calibrate");
  const folder = element("select", { onchange: () => open(folder.value) },
    ...(server.folder ? [element("option", { value: "" }, server.folder)] : []), ...folders.map((each) => element("option", { value: each.name }, each.name)));
  function open(name, label = name) {
    if (![...folder.options].some((option) => option.value === name)) folder.append(element("option", { value: name }, label));
    folder.value = name;
    request = { ...request, folder: name, ...fresh };
    for (const [each, box] of boxes) box.value = request[each] ?? "";
    list();
  }
  const noFolder = () => groups.replaceChildren(element("p", { class: "hint" }, "No folder is served. Drop one above, or start the server with one: photosite serve FOLDER"));
  forget = (name) => {
    [...folder.options].find((option) => option.value === name)?.remove();
    if (request.folder !== name) return;
    request = { ...request, folder: "", ...fresh };
    listing++; // of the deleted folder
    results.replaceChildren();
    if (server.folder) open(""); else noFolder();
  };
  const known = [["", "that of the frames' protocol, or none"], ...sensors.map((name) => [name, name]), ...files.map((file) => [`file:${file.name}`, file.name])];
  const sensor = element("select", { onchange: () => { request.sensor = sensor.value ? { source: sensor.value } : null; } }, ...known.map(([value, text]) => element("option", { value }, text)));
  sensor.value = request.sensor?.source ?? "";
  const boxes = new Map(unstated.map(([name, , example]) => {
    const box = element("input", { type: name in numbers ? "number" : "text", placeholder: example, ...numbers[name], onchange: () => {
      if (!box.validity.valid) return;
      request = { ...request, groups: [], [name]: name in numbers ? (box.value ? Number(box.value) : null) : box.value.trim() };
      if (server.folder || request.folder) list();
    } });
    box.value = request[name] ?? "";
    return [name, box];
  }));
  async function list() {
    const mine = ++listing;
    groups.replaceChildren(element("p", { class: "hint", role: "status" }, "Reading the names and headers of the frames …"));
    results.replaceChildren();
    try {
      const ended = await finished(await post(`/api/frames-of-folder?tab=${tab}`, { folder: request.folder, ...Object.fromEntries(unstated.map(([name]) => [name, request[name]])) }));
      if (mine !== listing) return; // another folder was chosen
      if (ended.status !== "done") throw new Error(ended.error || "cancelled");
      showError("");
      found = ended.result;
      request.each_setting = found.settings.length > 1;
      if (request.groups.length !== found.groups.length) request.groups = [];
      if (request.each_setting) drawSettings(groups, (name) => { boxes.get("where").value = request.where = name; list(); });
      else drawGroups(groups);
    } catch (error) {
      if (mine !== listing) return;
      groups.replaceChildren(element("p", { class: "card" }, `No frames to calibrate: ${error.message}`));
    }
  }
  root.replaceChildren(
    element("h2", { id: "calibrate-title" }, "Calibrate a sensor"),
    element("p", { class: "hint" }, "Dark frames and flat fields in a folder give the sensor's parameters with 95 % intervals. Frames are grouped by kind, exposure time and gain setting; change what was understood wrongly before you calibrate."),
    element("div", { class: "card" }, element("div", { class: "fields" }, element("label", {}, "Folder on this machine", folder), element("label", {}, "Sensor as known before", sensor)),
      element("p", { class: "hint" }, "Pixel size, volts and spectra come from a sensor file; without one the results are in DN and electrons."),
      element("details", {}, element("summary", {}, "What the files do not state"), element("div", { class: "fields" }, ...unstated.map(([name, label]) => element("label", {}, label, boxes.get(name))))),
      folderDrop(open)),
    groups, bar, results);
  if (server.folder || request.folder) {
    folder.value = request.folder;
    await list();
  } else noFolder();
}

// What may be measured beside the parameters. The gain of each pixel comes with the maps.
function mapChoices(fixed = () => false) {
  const choice = (name, text) => {
    const box = element("input", { type: "checkbox", id: `calibrate-${name}`, onchange: () => { request[name] = box.checked; update(); } });
    return [box, element("p", {}, element("label", { class: "choice" }, box, ` ${text}`))];
  };
  const [maps, mapsLine] = choice("maps", "Maps of the chip: DSNU, PRNU, dark current, read noise, defects");
  const [gain, gainLine] = choice("pixel_gain", "Also the gain of each pixel (sCMOS), which takes a hundred flat fields or more");
  const update = () => {
    maps.disabled = fixed();
    if (maps.disabled) request.maps = false;
    gain.disabled = !request.maps;
    if (gain.disabled) request.pixel_gain = false;
    [maps.checked, gain.checked] = [request.maps, request.pixel_gain];
  };
  update();
  return { lines: [mapsLine, gainLine], update };
}

const notes = () => (found.notes.length ? [element("ul", { class: "notes" }, ...found.notes.map((text) => element("li", {}, text)))] : []);

// Settings that the files state: each is calibrated, or one is chosen.
function drawSettings(root, choose) {
  const rows = found.settings.map((each) => [each.name, String(each.frames), element("button", { type: "button", "aria-label": `Choose ${each.name}`, onclick: () => choose(each.name) }, "Choose")]);
  root.replaceChildren(element("div", { class: "card" },
    element("h3", {}, `${found.settings.length} settings`),
    element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": "Settings" },
      table("The files state these. Each is calibrated by itself, and the results are compared.", ["Setting", "Frames", "Only this one"], rows, { class: "numbered stacked" })),
    ...notes(), ...mapChoices().lines));
}

function drawGroups(root) {
  const edits = found.groups.map((each, k) => request.groups[k] ?? { kind: each.kind, exposure_s: each.exposure_s, gain_setting: each.gain_setting });
  const note = element("p", { class: "hint" });
  const keep = () => {
    request.groups = edits.some((edit, k) => ["kind", "exposure_s", "gain_setting"].some((name) => edit[name] !== found.groups[k][name])) ? edits : [];
    const gains = new Set(edits.filter((edit) => edit.kind !== "omit").map((edit) => edit.gain_setting));
    note.textContent = gains.size > 1 ? `${gains.size} gain settings: each is calibrated by itself, then all together.` : "";
    several = gains.size > 1;
    maps.update();
  };
  let several = false;
  const maps = mapChoices(() => several);
  const number = (k, name, label, attributes) => {
    const box = element("input", { type: "number", step: "any", "aria-label": `${label} of group ${k + 1}`, ...attributes, onchange: () => {
      if (box.validity.valid) { edits[k] = { ...edits[k], [name]: box.value === "" ? null : Number(box.value) }; keep(); }
    } });
    box.value = edits[k][name] === null ? "" : Number(edits[k][name].toPrecision(6));
    return box;
  };
  const rows = found.groups.map((each, k) => {
    const kind = element("select", { "aria-label": `Kind of group ${k + 1}`, onchange: () => { edits[k] = { ...edits[k], kind: kind.value }; keep(); } },
      ...[["dark", "dark frames"], ["light", "flat fields"], ["omit", "left out"]].map(([value, text]) => element("option", { value }, text)));
    kind.value = edits[k].kind;
    return [String(k + 1), kind, number(k, "exposure_s", "Exposure time in s", { min: 1e-9, required: true }), number(k, "gain_setting", "Gain setting", { min: 0, placeholder: "none" }), String(each.frames), { content: each.frames > 1 ? `${each.first} … ${each.last}` : each.first, class: "files" }];
  });
  keep();
  root.replaceChildren(element("div", { class: "card" },
    element("h3", {}, `${found.groups.reduce((sum, each) => sum + each.frames, 0)} frames of ${found.rows} × ${found.cols} pixels, ${found.bits} bits${found.black_level_dn ? `, black level ${short(found.black_level_dn)} DN` : ""}`),
    element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": "Groups of frames" },
      table(found.sensor ? `The protocol names the sensor ${found.sensor}.` : "As understood from metadata and names.", ["Group", "Kind", "Exposure time (s)", "Gain setting", "Frames", "Files"], rows, { class: "numbered stacked" })),
    note,
    ...notes(), ...maps.lines,
    ...(found.subfolders.length > 1 ? [captureNames()] : [])));
}

// The order of the subfolders matters, so that they are named in a text field.
function captureNames() {
  const box = element("input", { type: "text", id: "calibrate-captures", "aria-describedby": "calibrate-captures-hint", onchange: () => {
    const names = box.value.split(",").map((name) => name.trim()).filter(Boolean);
    request = { ...request, captures: names };
  } });
  box.value = request.captures.join(", ");
  return element("div", {}, element("label", { for: box.id }, "Captures of one exposure "), box,
    element("p", { class: "hint", id: "calibrate-captures-hint" }, `Where each subfolder holds the frames of a capture: their names from the most to the least sensitive, of ${found.subfolders.join(", ")}. Empty: all frames are of one capture.`));
}
