// The comparison of sensors behind the same lens.

import { post } from "./api.js";
import { state as camera } from "./camera.js";
import { element, short, table } from "./dom.js";
import { field, jobBar } from "./jobview.js";
import { plot } from "./plots.js";

const FIGURES = [
  ["channel", "Channel with the largest signal"], ["pixel_width_um", "Pixel width (µm)"],
  ["quantum_efficiency_peak_percent", "Peak quantum efficiency (%)"], ["electrons_per_cd_m2", "Signal (e⁻ per cd/m²)"],
  ["saturation_capacity_e", "Saturation capacity (e⁻)"], ["read_noise_e", "Read noise (e⁻)"],
  ["dynamic_range_db", "Dynamic range (dB)"], ["snr_max_db", "Highest SNR (dB)"], ["snr10_cd_m2", "SNR10 (cd/m²)"],
  ["snr10_lux", "SNR10 (lux)"], ["saturation_cd_m2", "Saturates at (cd/m²)"],
];

let request = { sensors: [{ source: "nikon-d200" }, { source: "sony-imx174" }], f_number: 2.8, exposure_s: 1 / 15, illuminant: "3200K" };
let built = false;

export async function show(content) {
  const root = document.getElementById("view-compare");
  if (built && !content) return;
  built = true;
  if (content) request = { ...request, ...content };
  const { sensors } = await post("/api/form", {});
  const results = element("div", { "aria-live": "polite" });
  const { bar, start } = jobBar("comparison", "compare", () => request, (found) => draw(results, found));
  const ownChanged = Object.keys(camera.sensor.changes).length > 0 || camera.sensor.gain_setting !== null || camera.sensor.source.includes(":");
  const choices = [...sensors.map((source) => [source, { source }]), ...(ownChanged ? [["sensor of the camera view", camera.sensor]] : [])];
  const key = (sensor) => JSON.stringify([sensor.source, sensor.gain_setting ?? null, sensor.changes ?? {}]);
  for (const sensor of request.sensors) if (!choices.some(([, known]) => key(known) === key(sensor))) choices.push([sensor.source, sensor]);
  const boxes = choices.map(([label, sensor]) => {
    const box = element("input", { type: "checkbox" });
    box.checked = request.sensors.some((one) => key(one) === key(sensor));
    box.addEventListener("change", () => {
      request.sensors = choices.filter((_, k) => boxes[k].box.checked).map(([, each]) => each);
      boxes.forEach((each) => { each.box.disabled = !each.box.checked && request.sensors.length >= 8; });
    });
    return { box, label: element("label", {}, box, ` ${label}`) };
  });
  root.replaceChildren(
    element("h2", { id: "compare-title" }, "Compare sensors"),
    element("p", { class: "hint" }, "The same even surface through the same lens without losses: signal-to-noise ratio of one pixel with the whole noise of a frame."),
    element("div", { class: "card" },
      element("fieldset", { class: "choices" }, element("legend", {}, "Sensors, up to eight"), ...boxes.map((each) => each.label)),
      element("div", { class: "fields" },
        field("f-number", "", { type: "number", min: 0.5 }, request.f_number, (value) => { request.f_number = value; }),
        field("Exposure time", "s", { type: "number", min: 1e-6 }, Number(request.exposure_s.toPrecision(6)), (value) => { request.exposure_s = value; }),
        field("Illuminant", "", { type: "text" }, request.illuminant, (value) => { request.illuminant = value; }))),
    bar, results);
  start();
}

function draw(root, found) {
  const names = Object.keys(found.sensors), plots = element("div", { class: "plots" });
  const one = element("div", { class: "card" }), other = element("div", { class: "card" });
  const figures = table(`f/${short(found.f_number)}, ${short(found.exposure_s)} s, illuminant ${found.illuminant}`, ["Figure", ...names],
    FIGURES.map(([key, label]) => [label, ...names.map((name) => { const value = found.sensors[name][key]; return typeof value === "string" ? value : value === null ? "not reached" : short(value); })]));
  plot(one, {
    title: "SNR against luminance", lines: names.map((name) => ({ name, x: found.luminance_cd_m2, y: found.snr_db[name].map((v) => v ?? NaN) })),
    x: { label: "luminance (cd/m²)", logarithmic: true }, y: { label: "SNR (dB)", low: -10 },
  });
  one.prepend(element("h3", {}, "Signal-to-noise ratio against luminance"));
  const budgets = Object.entries(found.noise_budgets);
  plot(other, {
    title: "SNR against volts", lines: budgets.map(([name, curve]) => ({ name, x: curve.volts, y: curve.snr_db })),
    x: { label: "signal at the pixel (V)", logarithmic: true }, y: { label: "SNR (dB)" },
  });
  other.prepend(element("h3", {}, "Signal-to-noise ratio against volts"));
  plots.append(one, ...(budgets.length ? [other] : []));
  root.replaceChildren(plots, element("div", { class: "card", tabindex: "0", role: "group", "aria-label": "Figures of the sensors" }, element("h3", {}, "Figures"), figures,
    element("p", { class: "hint" }, "SNR10: luminance of the surface, and illuminance on an 18 % gray chart, at which the signal is 10 times the noise. Dynamic range as in EMVA 1288 release 4.0.")));
}
