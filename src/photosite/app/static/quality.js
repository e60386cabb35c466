// Image quality: frames of a chart, simulated with a camera or taken by one, are measured: values and figures.

import { DELETED, get, showError, upload } from "./api.js";
import { element, short, table } from "./dom.js";
import { dropped } from "./drop.js";
import { field, jobBar } from "./jobview.js";
import { lightField, lights } from "./lights.js";
import { offers, sensorPick, withoutUpload } from "./sensors.js";

let request = { sensor: { source: "google-pixel-4a" }, lens: { f_number: 2.8, focal_length_mm: 4 }, chart: "slanted-edge", frames: 4, luminance_cd_m2: 200, illuminant: "D65", measured: [], in_electrons: false, detect: false };
let built = false;
const uploaded = new Map();

window.addEventListener(DELETED, ({ detail }) => {
  uploaded.delete(detail);
  if (built && (offers(document.getElementById("view-quality"), detail) || JSON.stringify(request).includes(detail))) show(withoutUpload(request, detail));
});

// `run` is whether the measurement begins at once.
export async function show(content, run = true) {
  const root = document.getElementById("view-quality");
  if (built && !content) return;
  built = true;
  if (content) request = { ...request, ...content };
  const [pick, charts, known, raws, folders] = await Promise.all([sensorPick("Sensor", request.sensor, (sensor) => { request.sensor = sensor; }), get("/api/charts"), lights(), get("/api/files?kind=raw"), get("/api/files?kind=folder")]);
  const results = element("div", { "aria-live": "polite" });
  const { bar, start } = jobBar("quality", "quality", () => request, (found) => draw(results, found), "Measure");
  const chart = element("select", { onchange: () => { request.chart = chart.value; } }, ...charts.map((name) => element("option", { value: name }, name)));
  chart.value = request.chart;
  const choice = (name, text) => {
    const box = element("input", { type: "checkbox", checked: request[name], onchange: () => { request[name] = box.checked; } });
    return element("label", { class: "choice" }, box, ` ${text}`);
  };
  const served = [...folders.map((each) => [`file:${each.name}`, `${each.name}/`]), ...raws.map((each) => [`file:${each.name}`, each.name]), ...uploaded];
  const first = request.measured[0] ?? "";
  if (first && !served.some(([value]) => value === first)) served.push([first, first.replace("file:", "")]);
  const frames = element("select", { onchange: () => take(frames.value ? [frames.value] : []) },
    element("option", { value: "" }, "simulated with the camera below"), ...served.map(([value, text]) => element("option", { value }, text)));
  frames.value = first;
  const take = (measured) => show({ measured, luminance_cd_m2: measured.length ? null : request.luminance_cd_m2 ?? 200 }, false);
  const add = async (files) => {
    try {
      showError("");
      const stored = await Promise.all(files.map((file) => upload(file, "raw")));
      for (const each of stored) uploaded.set(each.name, each.file_name);
      take(stored.map((each) => each.name));
    } catch (error) { showError(error.message); }
  };
  const file = element("input", { type: "file", multiple: true, class: "hidden", tabindex: "-1", "aria-hidden": "true", onchange: () => add([...file.files]) });
  const source = element("div", { class: "card" },
    element("div", { class: "fields" }, element("label", {}, "Frames", frames), element("div", {}, element("button", { type: "button", onclick: () => file.click() }, "Upload …"), file)),
    element("p", { class: "hint" }, request.measured.length > 1 ? `${request.measured.length} frames, one stack of one scene and setting.` : "Or drop raw frames of one scene and setting here; the frames of a folder are one stack."));
  dropped(source, add);
  const simulated = !request.measured.length;
  root.replaceChildren(
    element("h2", { id: "quality-title" }, "Image quality of a camera"),
    element("p", { class: "hint" }, "Frames of a chart are measured with 95 % intervals, as photosite measure does. Simulated ones are exposed to just below saturation."),
    source,
    element("div", { class: "card" }, element("div", { class: "fields" }, element("label", {}, "Chart", chart), pick,
      ...(simulated ? [
        field("f-number", "", { type: "number", min: 0.5 }, request.lens.f_number, (value) => { request.lens = { ...request.lens, f_number: value }; }),
        field("Focal length", "mm", { type: "number", min: 0.2 }, request.lens.focal_length_mm, (value) => { request.lens = { ...request.lens, focal_length_mm: value }; }),
        field("Number of frames", "0: no noise", { type: "number", min: 0, max: 64, step: 1 }, request.frames, (value) => { request.frames = value; }),
      ] : []),
      field("Mean luminance", simulated ? "cd/m²" : "cd/m², if known", { type: "number", min: 1e-6, max: 1e9, required: simulated, oninput: (event) => { if (event.target.value === "") request.luminance_cd_m2 = null; } }, request.luminance_cd_m2 ?? "", (value) => { request.luminance_cd_m2 = value; }),
      ...lightField("Illuminant", known, request.illuminant, (value) => { request.illuminant = value; })),
      ...(simulated ? [] : [choice("in_electrons", "This sensor took them: values in electrons"), choice("detect", "Find the chart (ColorChecker, slanted squares); else it fills the frames")])),
    bar, results);
  if (run) start();
}

function draw(root, { chart, missing, sections }) {
  const row = ([quantity, part, value, low, high, unit, reason]) => {
    return [quantity, part || "–", value === null ? `missing: ${reason}` : short(value), low === null ? "–" : `${short(low)} to ${short(high)}`, unit];
  };
  root.replaceChildren(
    ...missing.map(([name, reason]) => element("p", { class: "hint" }, `${name}: not measured. ${reason}`)),
    ...sections.map((each) => element("section", { class: "card" }, element("h3", {}, each.title), element("p", { class: "hint" }, each.standard),
      ...each.diagnostics.map((text) => element("p", {}, text)),
      element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": `Values: ${each.title}` },
        table(`${each.title} on ${chart}`, ["Quantity", "Part", "Value", "95 % interval", "Unit"], each.rows.map(row))),
      ...each.figures.map((png, k) => element("img", { class: "figure", src: URL.createObjectURL(new Blob([Uint8Array.from(atob(png), (c) => c.charCodeAt(0))], { type: "image/png" })), alt: `Figure ${k + 1}: ${each.title}` })))));
}
