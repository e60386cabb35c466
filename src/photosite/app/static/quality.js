// Image quality: frames of a chart are simulated with a camera and measured, as values and figures.

import { DELETED, get } from "./api.js";
import { element, short, table } from "./dom.js";
import { field, jobBar } from "./jobview.js";
import { lightField, lights } from "./lights.js";
import { offers, sensorPick, withoutUpload } from "./sensors.js";

let request = { sensor: { source: "google-pixel-4a" }, lens: { f_number: 2.8, focal_length_mm: 4 }, chart: "slanted-edge", frames: 4, luminance_cd_m2: 200, illuminant: "D65" };
let built = false;

window.addEventListener(DELETED, ({ detail }) => {
  if (built && (offers(document.getElementById("view-quality"), detail) || JSON.stringify(request).includes(detail))) show(withoutUpload(request, detail));
});

export async function show(content) {
  const root = document.getElementById("view-quality");
  if (built && !content) return;
  built = true;
  if (content) request = { ...request, ...content };
  const [pick, charts, known] = await Promise.all([sensorPick("Sensor", request.sensor, (sensor) => { request.sensor = sensor; }), get("/api/charts"), lights()]);
  const results = element("div", { "aria-live": "polite" });
  const { bar, start } = jobBar("quality", "quality", () => request, (found) => draw(results, found), "Measure");
  const chart = element("select", { onchange: () => { request.chart = chart.value; } }, ...charts.map((name) => element("option", { value: name }, name)));
  chart.value = request.chart;
  root.replaceChildren(
    element("h2", { id: "quality-title" }, "Image quality of a camera"),
    element("p", { class: "hint" }, "Frames of a chart are simulated, exposed to just below saturation, and measured with 95 % intervals, as photosite measure does."),
    element("div", { class: "card" }, element("div", { class: "fields" }, element("label", {}, "Chart", chart), pick,
      field("f-number", "", { type: "number", min: 0.5 }, request.lens.f_number, (value) => { request.lens = { ...request.lens, f_number: value }; }),
      field("Focal length", "mm", { type: "number", min: 0.2 }, request.lens.focal_length_mm, (value) => { request.lens = { ...request.lens, focal_length_mm: value }; }),
      field("Frames", "0: no noise", { type: "number", min: 0, max: 64, step: 1 }, request.frames, (value) => { request.frames = value; }),
      field("Mean luminance", "cd/m²", { type: "number", min: 1e-6, max: 1e9 }, request.luminance_cd_m2, (value) => { request.luminance_cd_m2 = value; }),
      ...lightField("Illuminant", known, request.illuminant, (value) => { request.illuminant = value; }))),
    bar, results);
  start();
}

function draw(root, { chart, missing, sections }) {
  const row = ([quantity, part, value, low, high, unit]) => {
    const number = (each) => (typeof each === "number" ? short(each) : each ?? "–");
    return [quantity, part || "–", number(value), low === null ? "–" : `${short(low)} to ${short(high)}`, unit];
  };
  root.replaceChildren(
    ...missing.map(([name, reason]) => element("p", { class: "hint" }, `${name}: not measured. ${reason}`)),
    ...sections.map((each) => element("section", { class: "card" }, element("h3", {}, each.title), element("p", { class: "hint" }, each.standard),
      ...each.diagnostics.map((text) => element("p", {}, text)),
      element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": `Values: ${each.title}` },
        table(`${each.title} on ${chart}`, ["Quantity", "Part", "Value", "95 % interval", "Unit"], each.rows.map(row))),
      ...each.figures.map((png, k) => element("img", { class: "figure", src: URL.createObjectURL(new Blob([Uint8Array.from(atob(png), (c) => c.charCodeAt(0))], { type: "image/png" })), alt: `Figure ${k + 1}: ${each.title}` })))));
}
