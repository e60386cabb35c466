// Comparison: sensors or lenses in the same light, and measured frames with their simulation.

import { DELETED, get, post, showError, upload } from "./api.js";
import { state as camera } from "./camera.js";
import { element, short, table } from "./dom.js";
import { field, jobBar } from "./jobview.js";
import { lightField, lights } from "./lights.js";
import { LinkedPictures } from "./linked.js";
import { plot } from "./plots.js";
import { withoutUpload } from "./sensors.js";
import { intervalText, valuePick } from "./values.js";

const KINDS = [["sensors", "Sensors"], ["lenses", "Lenses"], ["measured", "Measured frames and their simulation"]];
const FIGURES = [
  ["channel", "Channel with the largest signal"], ["pixel_width_um", "Pixel width (µm)"],
  ["quantum_efficiency_peak_percent", "Peak quantum efficiency (%)"], ["electrons_per_cd_m2", "Signal (e⁻ per cd/m²)"],
  ["saturation_capacity_e", "Saturation capacity (e⁻)"], ["read_noise_e", "Read noise (e⁻)"],
  ["dynamic_range_db", "Dynamic range (dB)"], ["snr_max_db", "Highest SNR (dB)"], ["snr10_cd_m2", "SNR10 (cd/m²)"],
  ["snr10_lux", "SNR10 (lux)"], ["saturation_cd_m2", "Saturates at (cd/m²)"],
  ["nyquist_per_mm", "Nyquist frequency (cycles/mm)"], ["mtf50_per_mm", "MTF50 of lens and pixel (cycles/mm)"],
  ["mtf50_per_height", "MTF50 (line pairs per picture height)"], ["mtf_at_nyquist", "MTF at the Nyquist frequency"],
  ["corner_illumination_percent", "Light in the corner (% of the center)"], ["corner_distortion_percent", "Distortion in the corner (%)"],
  ["mean_delta_e_2000", "Color error, mean ΔE 2000"], ["largest_delta_e_2000", "Color error, largest ΔE 2000"],
  ["mean_delta_e_2000_left_out", "Mean ΔE 2000 of patches left out of the fit"],
];
const FITS = [["light", "fit it to the patches"], ["", "as given"], ["fill_factor", "as given, fit the fill factor"]];
const WHITE_OVER_MEAN = 4.5; // of a ColorChecker's patches: such a white is as bright in all pictures
const COMPUTE_MS = 400;
const lensOf = (f_number, focal_length_mm = 50) => ({ source: null, f_number, focal_length_mm, transmittance: 1, falloff: "none" });

let content = {
  kind: "sensors", sensors: [{ source: "nikon-d200" }, { source: "google-pixel-4a" }], lens: lensOf(2.8),
  lenses: [lensOf(2.8), lensOf(16)], sensor: { source: "nikon-d200" },
  exposure_s: 1 / 30, illuminant: "3200K", mean_luminance_cd_m2: 40, scene: "macbeth", same: true, layer: "developed", values: [],
  measured: [], of: { sensor: { source: "nikon-d200" }, lens: lensOf(8), illuminant: "A", luminance_cd_m2: null, exposure_s: null, distance_m: 1.2, black_level_dn: null, corners: [], fit: "light", tolerance_percent: 1 },
};
let built = false, known = null, later = null, pictures = null, pick = null;
let repick = () => {};

const sensorKey = (sensor) => JSON.stringify([sensor.source, sensor.gain_setting ?? null, sensor.changes ?? {}, sensor.binning ?? null]);
const titleOf = (sensor) => sensor.source.replace(/^(file:|upload:|result:.*\/)/, "") + (Object.keys(sensor.changes ?? {}).length || sensor.binning ? ", changed" : "");

export async function show(restored) {
  if (built && !restored) return;
  built = true;
  if (restored) content = { ...content, ...restored, of: { ...content.of, ...restored.of } };
  const [form, lamps, ...lists] = await Promise.all([post("/api/form", {}), lights(), ...["sensor", "lens", "raw", "folder", "scene"].map((kind) => get(`/api/files?kind=${kind}`))]);
  const [sensors, lenses, raws, folders, scenes] = lists.map((list) => list.map((file) => `file:${file.name}`));
  known = { sensors: form.sensors.map((source) => ({ source })), lenses, raws, folders, lamps, scenes: [...form.scenes, ...scenes] };
  known.sensors.push(...sensors.map((source) => ({ source })));
  for (const sensor of [camera.sensor, ...content.sensors, content.sensor, content.of.sensor]) {
    if (!known.sensors.some((each) => sensorKey(each) === sensorKey(sensor))) known.sensors.push(sensor);
  }
  pick = await valuePick("Image quality of simulated charts", content.values, (values) => { content.values = values; repick(); });
  build();
}

window.addEventListener(DELETED, ({ detail }) => {
  if (!JSON.stringify([content, known]).includes(detail)) return;
  content = withoutUpload(content, detail);
  if (!known) return;
  known.raws = known.raws.filter((name) => name !== detail);
  known.sensors = known.sensors.filter(({ source }) => source !== detail);
  known.lamps = known.lamps.filter(([name]) => name !== detail);
  build();
});

function build() {
  const root = document.getElementById("view-compare");
  pictures?.show([]);
  pictures = null;
  const kinds = element("fieldset", { class: "choices" }, element("legend", { class: "hidden" }, "What to compare"), ...KINDS.map(([kind, label]) => {
    const button = element("input", { type: "radio", name: "compare-kind", value: kind, onchange: () => { content.kind = kind; build(); root.querySelector(`[value=${kind}]`).focus(); } });
    button.checked = content.kind === kind;
    return element("label", {}, button, ` ${label}`);
  }));
  root.replaceChildren(element("h2", { id: "compare-title" }, "Compare"), kinds,
    ...(content.kind === "measured" ? buildMeasured() : buildCameras()));
}

// Sensors or lenses.

const cameras = () => content.kind === "sensors"
  ? content.sensors.map((sensor) => ({ sensor, lens: content.lens }))
  : content.lenses.map((lens) => ({ sensor: content.sensor, lens }));

const comparison = () => ({
  cameras: cameras(), exposure_s: content.exposure_s, illuminant: content.illuminant, mean_luminance_cd_m2: content.mean_luminance_cd_m2, values: content.values,
});

function buildCameras() {
  const results = element("div", { "aria-live": "polite" });
  let figures = null;
  const { bar, start } = jobBar("comparison", "compare", comparison, (found) => { figures = found; draw(results, found); shoot(); }, "Compute", () => content);
  pictures = new LinkedPictures("Pictures", { onlayer: (layer) => { content.layer = layer; } });
  pictures.setLayer(content.layer);
  const shoot = () => {
    const found = figures ? Object.entries(figures.cameras) : [];
    const own = content.scene.includes(":"), photo = /\.(png|jpe?g)$/i.test(content.scene);
    pictures.show(cameras().map(({ sensor, lens }, number) => ({
      label: found.length === cameras().length ? found[number][0] : content.kind === "sensors" ? titleOf(sensor) : lensText(lens),
      state: {
        scene: { source: content.scene, illuminant: own && !photo ? null : content.illuminant, mean_luminance_cd_m2: own && !photo ? null : content.mean_luminance_cd_m2 },
        lens, sensor, capture: { exposure_s: content.exposure_s },
        brightness: content.same && found.length === cameras().length ? found[number][1].saturation_cd_m2 / (WHITE_OVER_MEAN * content.mean_luminance_cd_m2) : 1,
      },
    })));
  };
  const changed = () => { figures = null; clearTimeout(later); later = setTimeout(start, COMPUTE_MS); };
  repick = changed;
  const scene = choice("Scene of the pictures", known.scenes.map((source) => [source, source.replace("file:", "")]), content.scene, (value) => { content.scene = value; shoot(); });
  const same = element("input", { type: "checkbox", onchange: () => { content.same = same.checked; shoot(); } });
  same.checked = content.same;
  const light = element("div", { class: "fields" },
    field("Exposure time", "s", { type: "number", min: 1e-6, required: true }, Number(content.exposure_s.toPrecision(6)), (value) => { content.exposure_s = value; changed(); }),
    ...lightField("Light", known.lamps, content.illuminant, (value) => { content.illuminant = value; changed(); }),
    field("Mean luminance", "cd/m²", { type: "number", min: 1e-6, required: true }, content.mean_luminance_cd_m2, (value) => { content.mean_luminance_cd_m2 = value; changed(); }),
    scene, element("label", { class: "check" }, "Pictures of the same brightness", same));
  start();
  return [element("div", { class: "card" }, ...(content.kind === "sensors" ? sensorChoices(changed) : lensChoices(changed)), light, pick), bar, pictures.root, results];
}

function choice(label, options, value, changed) {
  const list = element("select", { onchange: () => changed(list.value) }, ...options.map(([each, text]) => element("option", { value: each }, text)));
  if (!options.some(([each]) => each === value)) list.append(element("option", { value }, value));
  list.value = value;
  return element("label", {}, label, list);
}

function sensorChoice(label, sensor, changed) {
  return choice(label, known.sensors.map((each) => [sensorKey(each), titleOf(each)]), sensorKey(sensor), (value) => changed(known.sensors.find((each) => sensorKey(each) === value)));
}

const lensText = (lens) => lens.source ? lens.source.replace(/^(file|upload):/, "") : `f/${short(lens.f_number)}, ${short(lens.focal_length_mm)} mm`;

// Fields of a lens; `changed` gets a new one.
function lensFields(lens, changed, name = "Lens") {
  const list = choice(name, [["", "diffraction-limited"], ...known.lenses.map((file) => [file, file.replace("file:", "")])], lens.source ?? "", (value) => changed({ ...lens, source: value || null }, true));
  if (lens.source) return [list];
  return [list,
    field("f-number", "", { type: "number", min: 0.5, required: true }, lens.f_number, (value) => { lens.f_number = value; changed(lens); }),
    field("Focal length", "mm", { type: "number", min: 0.1, required: true }, lens.focal_length_mm, (value) => { lens.focal_length_mm = value; changed(lens); })];
}

function sensorChoices(changed) {
  const boxes = known.sensors.map((sensor) => {
    const box = element("input", { type: "checkbox" });
    box.checked = content.sensors.some((one) => sensorKey(one) === sensorKey(sensor));
    box.addEventListener("change", () => {
      const chosen = known.sensors.filter((_, k) => boxes[k].box.checked);
      if (!chosen.length) { box.checked = true; return; }
      content.sensors = chosen;
      boxes.forEach((each) => { each.box.disabled = !each.box.checked && chosen.length >= 8; });
      changed();
    });
    return { box, label: element("label", {}, box, ` ${titleOf(sensor)}${sensor === camera.sensor ? " (of the camera view)" : ""}`) };
  });
  const fields = element("div", { class: "fields" });
  const drawLens = () => fields.replaceChildren(...lensFields(content.lens, (lens, again) => { content.lens = lens; if (again) drawLens(); changed(); }, "Lens of all"));
  drawLens();
  return [element("fieldset", { class: "choices" }, element("legend", {}, "Sensors, up to eight"), ...boxes.map((each) => each.label)), fields];
}

function lensChoices(changed) {
  const rows = element("div", {});
  const drawRows = () => rows.replaceChildren(...content.lenses.map((lens, number) => element("div", { class: "fields", role: "group", "aria-label": `Lens ${number + 1}` },
    ...lensFields(lens, (next, again) => { content.lenses[number] = next; if (again) drawRows(); changed(); }, `Lens ${number + 1}`),
    content.lenses.length > 1 ? element("button", { type: "button", "aria-label": `Remove lens ${number + 1}`, onclick: () => { content.lenses.splice(number, 1); drawRows(); changed(); } }, "Remove") : null)));
  drawRows();
  const add = element("button", { type: "button", onclick: () => {
    if (content.lenses.length >= 8) { showError("Eight lenses are the most."); return; }
    content.lenses.push({ ...content.lenses.at(-1) });
    drawRows();
    changed();
  } }, "Add a lens");
  return [rows, element("p", {}, add), element("div", { class: "fields" }, sensorChoice("Sensor behind all", content.sensor, (sensor) => { content.sensor = sensor; changed(); }))];
}

const card = (title, ...children) => element("div", { class: "card", tabindex: "0", role: "group", "aria-label": title }, element("h3", {}, title), ...children);

function draw(root, found) {
  const names = Object.keys(found.cameras), plots = element("div", { class: "plots" });
  const add = (title, lines, x, y) => {
    if (!lines.length) return;
    const box = element("div");
    plot(box, { title, lines, x, y });
    plots.append(element("div", { class: "card" }, element("h3", {}, title), box));
  };
  add("Signal-to-noise ratio against luminance", names.map((name) => ({ name, x: found.luminance_cd_m2, y: found.snr_db[name].map((v) => v ?? NaN) })),
    { label: "luminance (cd/m²)", logarithmic: true }, { label: "SNR (dB)", low: -10 });
  if (content.kind === "sensors") add("Signal-to-noise ratio against volts", Object.entries(found.noise_budgets).map(([name, curve]) => ({ name, x: curve.volts, y: curve.snr_db })),
    { label: "signal at the pixel (V)", logarithmic: true }, { label: "SNR (dB)" });
  add("Sharpness: MTF of lens and pixel", names.map((name) => ({ name, x: found.frequency_per_mm, y: found.mtf[name] })),
    { label: "frequency on the sensor (cycles/mm)" }, { label: "MTF", low: 0 });
  const value = (name, figure) => { const each = found.cameras[name][figure]; return typeof each === "string" ? each : each === null ? figure.startsWith("snr") ? "not reached" : "–" : short(each); };
  const notes = [...found.notes, ...names.map((name) => found.chart[name].reason && `${name}: ${found.chart[name].reason}`).filter(Boolean)];
  root.replaceChildren(plots, element("div", { class: "beside" },
    card("Figures", table(`${short(found.exposure_s)} s, ${found.illuminant}`, ["Figure", ...names], FIGURES.map(([figure, label]) => [label, ...names.map((name) => value(name, figure))])),
      element("p", { class: "hint" }, "SNR of one pixel with the whole noise of a frame. SNR10: luminance of the surface, and illuminance on an 18 % gray chart, at which the signal is 10 times the noise. Dynamic range as in EMVA 1288 release 4.0. MTF on the axis, along the rows, at 550 nm.")),
    ...quality(found, names),
    card("Color error on the chart", ...colors(found, names))), element("div", { class: "beside" }, ...patches(found, names)),
    notes.length ? element("ul", { class: "notes", "aria-label": "Notes" }, ...notes.map((note) => element("li", {}, note))) : "");
}

// Values of image quality with 95 % intervals, and why some are missing.
function quality(found, names) {
  const rows = Object.entries(found.quality[names[0]] ?? {});
  if (!rows.length) return [];
  const cell = ({ value, interval_95: ends }) => (value === null ? "missing" : intervalText(value, ends ?? []));
  const reasons = names.flatMap((name) => Object.entries(found.quality[name]).filter(([, each]) => each.reason).map(([value, each]) => [name, value, each.reason]));
  const grouped = [...Map.groupBy(reasons, ([name, , reason]) => `${name}: ${reason}`)];
  return [card("Image quality of simulated charts", table("Values with 95 % intervals", ["Value", ...names], rows.map(([value, { label, unit }]) => [unit ? `${label} (${unit})` : label, ...names.map((name) => cell(found.quality[name][value]))])),
    ...(grouped.length ? [element("ul", { class: "notes", "aria-label": "Missing values" }, ...grouped.map(([reason, each]) => element("li", {}, `${each.map(([, value]) => value).join(", ")}, ${reason}`)))] : []),
    element("p", { class: "hint" }, "Four frames of each chart in the light above, exposed to just below saturation. Quality has all values and figures."))];
}

function colors(found, names) {
  const shown = names.filter((name) => found.chart[name].delta_e_2000);
  if (!shown.length) return [element("p", { class: "hint" }, "No camera has a color error here; the reasons are below.")];
  const any = found.chart[shown[0]], cell = (value) => value === null ? "saturated" : value.toFixed(2);
  return [table("ΔE 2000 of each patch after the best color matrix of each camera", ["Patch", ...shown], any.patches.map((patch, k) => [patch, ...shown.map((name) => cell(found.chart[name].delta_e_2000[k]))])),
    element("p", { class: "hint" }, "The matrix from camera RGB to XYZ under D65 is fitted to the patches that do not saturate. About 1 is just visible side by side.")];
}

function patches(found, names) {
  return names.filter((name) => found.chart[name].patches).map((name) => {
    const { patches: rows, channels, mean_dn: mean, snr_db: ratio, saturated } = found.chart[name];
    const body = table("Mean above black and signal-to-noise ratio over the pixels of a patch, of one simulated frame", ["Patch", ...channels.flatMap((channel) => [`${channel} (DN)`, `${channel} SNR (dB)`])],
      rows.map((patch, k) => [patch, ...channels.flatMap((_, c) => [short(mean[k][c], 5) + (saturated[k][c] ? " saturated" : ""), short(ratio[k][c], 3)])]));
    return element("details", { class: "card" }, element("summary", {}, `Patches: ${name}`), element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": `Patches of ${name}` }, body));
  });
}

// Measured frames.

const validation = () => ({
  ...content.of, measured: content.measured, fit: content.of.fit || null, distance_m: content.of.distance_m ?? 1.2, tolerance_percent: content.of.tolerance_percent ?? 0,
});

function buildMeasured() {
  const { of } = content, results = element("div", { "aria-live": "polite" });
  const { bar } = jobBar("validation", "compare", validation, (found) => drawMeasured(results, found), "Compare with simulation", () => content);
  const files = element("select", { multiple: true, size: 6, id: "compare-files", onchange: () => { content.measured = [...files.selectedOptions].map((option) => option.value); } });
  const option = (value, text) => { const made = element("option", { value }, text); made.selected = content.measured.includes(value); return made; };
  files.append(...known.folders.map((name) => option(name, `${name.replace("file:", "")}/ (folder)`)), ...known.raws.map((name) => option(name, name.replace("file:", ""))));
  for (const name of content.measured) if (![...known.folders, ...known.raws].includes(name)) files.append(option(name, name));
  const raw = element("input", { type: "file", multiple: true, hidden: true, "aria-label": "Upload raw frames", onchange: async () => {
    try {
      for (const file of raw.files) {
        const found = await upload(file, "raw");
        known.raws.push(found.name);
        content.measured = [...content.measured, found.name];
        files.append(option(found.name, `${found.file_name}, ${found.holds}`));
      }
      showError("");
    } catch (error) { showError(error.message); }
  } });
  const light = lightField("Lamp", known.lamps, of.illuminant, (value) => { of.illuminant = value; });
  const optional = (label, unit, name, attributes = {}) => {
    const box = element("input", { type: "number", step: "any", placeholder: "of the files", ...attributes });
    box.value = of[name] ?? "";
    box.addEventListener("change", () => { if (box.validity.valid) of[name] = box.value === "" ? null : Number(box.value); });
    return element("label", {}, unit ? `${label} (${unit})` : label, box);
  };
  const corners = element("input", { type: "text", placeholder: "found in the frame", size: 34, "aria-describedby": "corners-hint" });
  corners.value = of.corners.map((corner) => corner.join(",")).join(" ");
  corners.addEventListener("change", () => {
    const found = corners.value.trim().split(/[\s;]+/).filter(Boolean).map((text) => text.split(",").map(Number));
    const valid = [0, 4].includes(found.length) && found.every((corner) => corner.length === 2 && corner.every(Number.isFinite));
    showError(valid ? "" : "Corners must be four row,col, such as 412,388 420,3391 2201,3377 2188,405, or empty.");
    if (valid) of.corners = found;
  });
  const fields = element("div", { class: "fields" });
  const drawFields = () => fields.replaceChildren(
    sensorChoice("Sensor simulated", of.sensor, (sensor) => { of.sensor = sensor; }),
    ...lensFields(of.lens, (lens, again) => { of.lens = lens; if (again) drawFields(); }),
    ...light,
    choice("Light level", FITS, of.fit ?? "", (value) => { of.fit = value; }),
    optional("Mean luminance of the patches", "cd/m²", "luminance_cd_m2", { min: 1e-6, placeholder: "of the lamp" }),
    optional("Exposure time", "s", "exposure_s", { min: 1e-9 }), optional("Distance to the chart", "m", "distance_m", { min: 1e-3, placeholder: "1.2" }),
    optional("Black level", "DN", "black_level_dn", { min: 0 }), optional("Tolerance", "%", "tolerance_percent", { min: 0, placeholder: "0" }),
    element("label", {}, "Corners of the chart", corners));
  drawFields();
  return [
    element("p", { class: "hint" }, "Raw frames of a ColorChecker against frames that are simulated from the sensor, the lens and the light: patch means, noise, colors, and whether they agree."),
    element("div", { class: "card" },
      element("p", {}, element("label", { for: "compare-files" }, "Measured frames of one scene and setting")), files,
      known.raws.length || known.folders.length ? null : element("p", { class: "hint" }, "No folder is served. Upload frames, or start photosite serve with a folder."),
      element("p", {}, element("button", { type: "button", onclick: () => raw.click() }, "Upload frames …"), raw), fields,
      element("p", { class: "hint", id: "corners-hint" }, "Corners as row,col in pixels: the outer corners of the dark skin, bluish green, black and white patches. Empty: the chart is found.")),
    bar, results];
}

async function rgbaOf(text) {
  const bytes = Uint8Array.from(atob(text), (each) => each.charCodeAt(0));
  const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
  const canvas = element("canvas", { width: bitmap.width, height: bitmap.height }), context = canvas.getContext("2d");
  context.drawImage(bitmap, 0, 0);
  return { rgba: context.getImageData(0, 0, bitmap.width, bitmap.height).data, rows: bitmap.height, cols: bitmap.width };
}

async function drawMeasured(root, found) {
  const shown = new LinkedPictures("Measured and simulated", { layers: false });
  const points = element("div", { class: "card" }), noise = element("div", { class: "card" });
  const { measured, simulated, channels, patches: names } = found, colors = found.color;
  const delta = colors ? new Map(colors.patches.map((name, k) => [name, colors.delta_e_2000[k]])) : new Map();
  const reasons = [...(found.fit_summary ? [found.fit_summary] : []), ...found.reasons];
  const notes = [...found.notes, ...found.warnings];
  root.replaceChildren(
    card("Verdict", element("p", { class: "verdict" }, element("strong", { class: `badge ${found.agrees ? "exact" : "preview"}` }, found.agrees ? "measured and simulated agree" : "measured and simulated differ")),
      element("ul", {}, ...reasons.map((reason) => element("li", {}, reason))),
      colors ? element("p", {}, `ΔE 2000 between measured and simulated: mean ${short(colors.delta_e_2000.reduce((a, b) => a + b, 0) / colors.delta_e_2000.length, 3)}, largest ${short(Math.max(...colors.delta_e_2000), 3)}.`) : null),
    shown.root, element("div", { class: "plots" }, points, noise),
    card("Patches", table("Means above black in DN", ["Patch", ...channels.flatMap((c) => [`${c} measured`, "simulated", "difference (%)"]), "ΔE 2000"],
      names.map((name, k) => [name, ...channels.flatMap((_, c) => [short(measured.mean_dn[k][c], 5), short(simulated.mean_dn[k][c], 5),
        found.relative_difference[k][c] === null ? "–" : (100 * found.relative_difference[k][c]).toFixed(2)]), delta.has(name) ? delta.get(name).toFixed(2) : "–"]))),
    notes.length ? element("ul", { class: "notes", "aria-label": "Notes" }, ...notes.map((note) => element("li", {}, note))) : "");
  const against = (box, title, values, label) => {
    const lines = channels.map((name, c) => ({ name, marks: true, x: simulated[values].map((row) => row[c]), y: measured[values].map((row) => row[c]), style: { R: "s1", G: "s2", B: "s0" }[name] }));
    const top = Math.max(...lines.flatMap((line) => line.x));
    const drawn = element("div");
    box.replaceChildren(element("h3", {}, title), drawn);
    plot(drawn, { title, lines: [{ name: "equal", x: [0, top], y: [0, top], style: "s7" }, ...lines], x: { label: `simulated ${label}` }, y: { label: `measured ${label}`, low: 0 } });
  };
  against(points, "Means of the patches", "mean_dn", "(DN)");
  against(noise, "Noise over the pixels", "spatial_noise_dn", "(DN)");
  const sources = await Promise.all(["measured", "simulated"].map(async (label) => {
    const { rgba, rows, cols } = await rgbaOf(found.pictures[label]);
    return { label, data: { header: { row: 0, col: 0, rows, cols, step: found.pictures.step, cfa: [["M"]], white_level_dn: 1 }, dn: null, mean: null, rgba } };
  }));
  shown.show(sources);
}
