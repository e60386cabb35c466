// A calibration: a folder of the server, its groups of frames, and the results.

import { finished, get, post, showError, tab } from "./api.js";
import { element, short, table } from "./dom.js";
import { jobBar } from "./jobview.js";
import { plot } from "./plots.js";

const STYLES = { R: "s1", G: "s2", B: "s0", M: "s0" };
let request = { folder: "", sensor: null, groups: [] };
let built = false, found = null;

export async function show(content) {
  const root = document.getElementById("view-calibrate");
  if (built && !content) return;
  built = true;
  if (content) request = { ...request, ...content };
  const [{ sensors }, folders, files, server] = await Promise.all([post("/api/form", {}), get("/api/files?kind=folder"), get("/api/files?kind=sensor"), get("/api/server")]);
  const head = [element("h2", { id: "calibrate-title" }, "Calibrate a sensor"),
    element("p", { class: "hint" }, "Dark frames and flat fields in a folder give the sensor's parameters with 95 % intervals. Frames are grouped by kind, exposure time and gain setting; change what was understood wrongly before you calibrate.")];
  if (!server.folder) {
    root.replaceChildren(...head, element("p", { class: "card" }, "No folder is served. Start the server with the folder that holds your frames: photosite serve FOLDER"));
    return;
  }
  const groups = element("div", { "aria-live": "polite" }), results = element("div", { "aria-live": "polite" });
  const { bar } = jobBar("calibration", "calibrate", () => request, (result) => draw(results, result), "Calibrate");
  const folder = element("select", { onchange: () => { request.folder = folder.value; request.groups = []; list(); } },
    element("option", { value: "" }, server.folder), ...folders.map((each) => element("option", { value: each.name }, each.name)));
  folder.value = request.folder;
  const known = [["", "that of the frames' protocol, or none"], ...sensors.map((name) => [name, name]), ...files.map((file) => [`file:${file.name}`, file.name])];
  const sensor = element("select", { onchange: () => { request.sensor = sensor.value ? { source: sensor.value } : null; } }, ...known.map(([value, text]) => element("option", { value }, text)));
  sensor.value = request.sensor?.source ?? "";
  async function list() {
    groups.replaceChildren(element("p", { class: "hint", role: "status" }, "Reading the names and headers of the frames …"));
    results.replaceChildren();
    try {
      const ended = await finished(await post(`/api/frames-of-folder?tab=${tab}`, { folder: request.folder }));
      if (ended.status !== "done") throw new Error(ended.error || "cancelled");
      showError("");
      found = ended.result;
      if (request.groups.length !== found.groups.length) request.groups = [];
      drawGroups(groups);
    } catch (error) {
      groups.replaceChildren(element("p", { class: "card" }, `No frames to calibrate: ${error.message}`));
    }
  }
  root.replaceChildren(...head,
    element("div", { class: "card" }, element("div", { class: "fields" }, element("label", {}, "Folder on this machine", folder), element("label", {}, "Sensor as known before", sensor)),
      element("p", { class: "hint" }, "Pixel size, volts and spectra come from a sensor file; without one the results are in DN and electrons.")),
    groups, bar, results);
  await list();
}

function drawGroups(root) {
  const edits = found.groups.map((each, k) => request.groups[k] ?? { kind: each.kind, exposure_s: each.exposure_s });
  const keep = () => { request.groups = edits.some((edit, k) => edit.kind !== found.groups[k].kind || edit.exposure_s !== found.groups[k].exposure_s) ? edits : []; };
  const rows = found.groups.map((each, k) => {
    const name = `group ${k + 1}`;
    const kind = element("select", { "aria-label": `Kind of ${name}`, onchange: () => { edits[k] = { ...edits[k], kind: kind.value }; keep(); } },
      ...[["dark", "dark frames"], ["light", "flat fields"], ["omit", "left out"]].map(([value, text]) => element("option", { value }, text)));
    kind.value = edits[k].kind;
    const time = element("input", { type: "number", step: "any", min: 1e-9, required: true, "aria-label": `Exposure time of ${name} in s`, onchange: () => { if (time.validity.valid) { edits[k] = { ...edits[k], exposure_s: Number(time.value) }; keep(); } } });
    time.value = edits[k].exposure_s;
    return [String(k + 1), kind, time, each.gain_setting === null ? "–" : short(each.gain_setting), String(each.frames), each.frames > 1 ? `${each.first} … ${each.last}` : each.first];
  });
  root.replaceChildren(element("div", { class: "card", tabindex: "0", role: "group", "aria-label": "Groups of frames" },
    element("h3", {}, `${found.groups.reduce((sum, each) => sum + each.frames, 0)} frames of ${found.rows} × ${found.cols} pixels, ${found.bits} bits`),
    table(found.sensor ? `The protocol names the sensor ${found.sensor}.` : "As understood from metadata and names.", ["Group", "Kind", "Exposure time (s)", "Gain setting", "Frames", "Files"], rows),
    ...(found.notes.length ? [element("ul", { class: "notes" }, ...found.notes.map((note) => element("li", {}, note)))] : [])));
}

function draw(root, result) {
  const row = (each) => [each.label, each.value === null ? "–" : short(each.value, 5), each.interval_95 ? `${short(each.interval_95[0], 5)} to ${short(each.interval_95[1], 5)}` : "–", each.unit || "1", each.value === null ? each.reason : ""];
  const heads = ["Parameter", "Value", "95 % interval", "Unit", "Why it is missing"];
  const downloads = Object.entries(result.files).map(([name, content]) => element("button", { type: "button", onclick: () => {
    const link = element("a", { href: URL.createObjectURL(new Blob([Uint8Array.from(atob(content), (c) => c.charCodeAt(0))])), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  } }, `Download ${name}`));
  const plots = element("div", { class: "plots" });
  for (const curve of result.curves) {
    const card = element("div", { class: "card" }), above = element("div"), below = element("div"), channels = Object.entries(curve.channels);
    const lines = channels.flatMap(([name, part], k) => {
      const style = STYLES[name] ?? `s${(k + 3) % 8}`, x = part.x.filter((_, i) => part.used[i]);
      const marks = { name, x: part.x, y: part.y, half: part.half_95, used: part.used, marks: true, style };
      if (part.slope === null || part.intercept === null || x.length < 2) return [marks];
      const ends = [Math.min(...x), Math.max(...x)];
      return [marks, { name: `${name} fitted`, x: ends, y: ends.map((value) => part.intercept + part.slope * value), style }];
    });
    card.append(element("h3", {}, curve.title || curve.kind.replaceAll("_", " ")), above, below);
    plot(above, { title: curve.title, lines, x: { label: curve.x_label }, y: { label: curve.y_label } });
    const left = channels.filter(([, part]) => part.residual.length).map(([name, part], k) => ({ name, x: part.x, y: part.residual.map((value, i) => part.used[i] ? value ?? NaN : NaN), marks: true, style: STYLES[name] ?? `s${(k + 3) % 8}` }));
    if (left.length) plot(below, { title: `Residuals of ${curve.title}`, lines: left, x: { label: curve.x_label }, y: { label: "residual (standard uncertainties)" } });
    plots.append(card);
  }
  const box = (title, rows) => element("div", { class: "card", tabindex: "0", role: "group", "aria-label": title }, element("h3", {}, title), table(result.title, heads, rows.map(row)));
  const lists = (title, entries) => entries.length ? [element("div", { class: "card" }, element("h3", {}, title), element("ul", { class: "notes" }, ...entries.map((text) => element("li", {}, text))))] : [];
  root.replaceChildren(element("div", { class: "toolbar" }, ...downloads), ...lists("Limits of the result", result.warnings), ...lists("Frames left out", result.rejected), box("Parameters", result.parameters), plots,
    ...Object.entries(result.channels).map(([name, rows]) => element("details", { class: "card" }, element("summary", {}, `Channel ${name}`), element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": `Parameters of channel ${name}` }, table("Of this channel alone.", heads, rows.map(row))))));
}
