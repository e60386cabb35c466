// A measure of the camera over one or two of its fields: curves or a heat map.

import { DELETED, post, showError } from "./api.js";
import { element, short, svg, table } from "./dom.js";
import { field, jobBar } from "./jobview.js";
import { lightField, lights } from "./lights.js";
import { viridis } from "./picture.js";
import { plot } from "./plots.js";
import { offers, sensorPick, withoutUpload } from "./sensors.js";
import { intervalText, valuePick } from "./values.js";

const UNITS = {
  signal_e: "e⁻", noise_e: "e⁻", snr_db: "dB", electrons_per_cd_m2: "e⁻ per cd/m²", saturation_capacity_e: "e⁻", dynamic_range_db: "dB",
  snr_max_db: "dB", snr10_cd_m2: "cd/m²", snr10_lux: "lux", saturation_cd_m2: "cd/m²",
};
const LABELS = {
  signal_e: "Signal", noise_e: "Noise", snr_db: "SNR", electrons_per_cd_m2: "Signal per luminance", saturation_capacity_e: "Saturation capacity",
  dynamic_range_db: "Dynamic range", snr_max_db: "Highest SNR", snr10_cd_m2: "SNR10", snr10_lux: "SNR10 (illuminance)", saturation_cd_m2: "Saturates at",
};

let request = {
  sensor: { source: "google-pixel-4a" }, lens: { f_number: 2.8, focal_length_mm: 4 }, measure: "snr", luminance_cd_m2: 5, exposure_s: 1 / 15, illuminant: "D65", values: [], frames: 4,
  ranges: [{ field: "pixel_width_um", first: 0.8, last: 4, count: 17, logarithmic: false }, { field: "f_number", first: 1.4, last: 5.6, count: 5, logarithmic: true }],
};
// Ranges and exposure that a measure begins with: charts take seconds for each camera.
const SURFACE = { exposure_s: request.exposure_s, ranges: request.ranges };
const STARTS = {
  snr: SURFACE, sensor_figures: SURFACE,
  image_quality: { exposure_s: null, luminance_cd_m2: 200, ranges: [{ field: "f_number", first: 1.4, last: 5.6, count: 5, logarithmic: true }] },
};

let built = false, fields = new Map(), result = null;

window.addEventListener(DELETED, ({ detail }) => {
  if (built && (offers(document.getElementById("view-sweep"), detail) || JSON.stringify(request).includes(detail))) show(withoutUpload(request, detail));
});

// `run` is whether the sweep begins at once.
export async function show(content, run = true) {
  const root = document.getElementById("view-sweep");
  if (built && !content) return;
  built = true;
  if (content) request = { ...request, ...content };
  const [pick, known] = await Promise.all([sensorPick("Sensor", request.sensor, (sensor) => { request.sensor = sensor; ranges(); }), lights()]);
  const { bar, start } = jobBar("sweep", "sweep", () => request, (found) => { result = found; draw(); });
  const box = element("div"), measure = element("select", { onchange: () => show({ measure: measure.value, ...STARTS[measure.value] }, false) },
    element("option", { value: "snr" }, "signal, noise and SNR of a surface"), element("option", { value: "sensor_figures" }, "dynamic range, SNR10 and saturation"),
    element("option", { value: "image_quality" }, "image quality of simulated charts"));
  measure.value = request.measure;
  const ofCharts = request.measure === "image_quality";
  const values = ofCharts ? await valuePick("Values", request.values, (chosen) => { request.values = chosen; }) : null;
  const number = (label, unit, name, attributes) => field(label, unit, { type: "number", ...attributes }, request[name] ?? "", (value) => { request[name] = value; });
  async function ranges() {
    let form;
    try {
      form = await post("/api/form", { sensor: { source: request.sensor.source, gain_setting: request.sensor.gain_setting ?? null } });
      showError("");
    } catch (error) { showError(error.message); return; } // of a sensor file that cannot be read
    fields = new Map([["pixel_width_um", { label: "Pixel width, noise in electrons kept", unit: "µm" }]]);
    if (ofCharts) fields.set("mean_luminance_cd_m2", { label: "Mean luminance of the charts", unit: "cd/m²" });
    const ofLens = form.lens[0].fields.filter((each) => !each.optional), ofSensor = form.sensor.filter((each) => each.name !== "gain_settings").flatMap((each) => each.fields);
    for (const each of [...ofLens, ...ofSensor]) if (each.kind === "number" || each.kind === "whole") fields.set(each.name, each);
    const row = (entry, number) => {
      const list = element("select", { onchange: () => { entry.field = list.value; } }, ...[...fields].map(([name, each]) => element("option", { value: name }, each.unit ? `${each.label} (${each.unit})` : each.label)));
      if (![...list.options].some((option) => option.value === entry.field)) entry.field = list.options[0].value;
      list.value = entry.field;
      const spacing = element("select", { onchange: () => { entry.logarithmic = spacing.value === "factors"; } }, element("option", { value: "steps" }, "equal steps"), element("option", { value: "factors" }, "equal factors"));
      spacing.value = entry.logarithmic ? "factors" : "steps";
      return element("fieldset", { class: "choices" }, element("legend", {}, number ? "Second field" : "First field"), element("div", { class: "fields" },
        element("label", {}, "Field", list), field("From", "", { type: "number" }, entry.first, (value) => { entry.first = value; }),
        field("To", "", { type: "number" }, entry.last, (value) => { entry.last = value; }), field("Values", "", { type: "number", min: 1, max: 200, step: 1 }, entry.count, (value) => { entry.count = value; }),
        element("label", {}, "Spacing", spacing), number ? element("button", { type: "button", onclick: () => { request.ranges = request.ranges.slice(0, 1); ranges(); } }, "Remove") : null));
    };
    box.replaceChildren(...request.ranges.map(row), ...(request.ranges.length < 2 ? [element("button", { type: "button", onclick: () => { request.ranges = [...request.ranges, { field: "f_number", first: 1.4, last: 5.6, count: 5, logarithmic: true }]; ranges(); } }, "Add a second field")] : []));
  }
  await ranges();
  root.replaceChildren(
    element("h2", { id: "sweep-title" }, "Sweep a camera"),
    element("p", { class: "hint" }, ofCharts
      ? "Charts are simulated with each camera and measured, with 95 % intervals, as photosite measure does: some seconds for each camera."
      : "One pixel that sees an even surface, for all combinations of the values. Nothing is drawn at random."),
    element("div", { class: "card" }, element("div", { class: "fields" }, pick,
      field("f-number", "", { type: "number", min: 0.5 }, request.lens.f_number, (value) => { request.lens = { ...request.lens, f_number: value }; }),
      field("Focal length", "mm", { type: "number", min: 0.2 }, request.lens.focal_length_mm, (value) => { request.lens = { ...request.lens, focal_length_mm: value }; }),
      element("label", {}, "Measure", measure),
      ...(request.measure === "sensor_figures" ? [] : [number(ofCharts ? "Mean luminance" : "Luminance", "cd/m²", "luminance_cd_m2", { min: 1e-9, max: 1e9 })]),
      field("Exposure time", "s", { type: "number", min: 1e-6, max: 1e5, required: !ofCharts, placeholder: ofCharts ? "just below saturation" : null, class: ofCharts ? "wide" : null,
        oninput: (event) => { if (ofCharts && event.target.value === "") request.exposure_s = null; } },
      request.exposure_s === null ? "" : Number(request.exposure_s.toPrecision(6)), (value) => { request.exposure_s = value; }),
      ...(ofCharts ? [number("Number of frames", "0: no noise", "frames", { min: 0, max: 64, step: 1 })] : []),
      ...lightField("Illuminant", known, request.illuminant, (value) => { request.illuminant = value; })), values ?? "", box),
    bar, element("div", { id: "sweep-results", "aria-live": "polite" }));
  if (run) start();
  else measure.focus();
}

const named = (name) => {
  if (result?.labels[name]) return result.labels[name];
  const known = fields.get(name) ?? { label: LABELS[name] ?? name, unit: UNITS[name] };
  return known.unit ? `${known.label} (${known.unit})` : known.label;
};

// The last measured column that has values.
const lastShown = () => result.measured.findLast((name) => result.columns[name].some((each) => each !== null)) ?? result.measured.at(-1);

function draw(y = lastShown(), shape = result.fields.length === 2 ? "map" : "curves") {
  const root = document.getElementById("sweep-results"), { columns, fields: varied, measured } = result;
  const ends = (name, k) => [columns[`low(${name})`]?.[k] ?? NaN, columns[`high(${name})`]?.[k] ?? NaN];
  const list = element("select", { onchange: () => draw(list.value, kind.value) }, ...measured.map((name) => element("option", { value: name }, named(name))));
  list.value = y;
  const kind = element("select", { onchange: () => draw(list.value, kind.value) }, element("option", { value: "curves" }, "curves"), element("option", { value: "map" }, "heat map"));
  kind.value = shape;
  const card = element("div", { class: "card" }), drawn = element("div", { class: "sweep-plot" });
  if (shape === "map" && varied.length === 2) heatMap(drawn, varied, columns, y);
  else {
    const lines = new Map();
    columns[varied[0]].forEach((value, k) => {
      const name = varied.length === 2 ? `${named(varied[1])} ${short(columns[varied[1]][k])}` : named(y);
      if (!lines.has(name)) lines.set(name, { name, x: [], y: [], ends: [] });
      lines.get(name).x.push(value);
      lines.get(name).y.push(columns[y][k] ?? NaN);
      lines.get(name).ends.push(ends(y, k));
    });
    plot(drawn, { title: "Sweep", lines: [...lines.values()], x: { label: named(varied[0]), logarithmic: request.ranges[0].logarithmic }, y: { label: named(y) } });
  }
  const names = Object.keys(columns), shown = [...varied, ...measured];
  const rows = columns[varied[0]].map((_, k) => shown.map((name) => (columns[`low(${name})`] ? intervalText(columns[name][k], ends(name, k)) : short(columns[name][k], 5))));
  const save = (content, kind, name) => {
    const link = element("a", { href: URL.createObjectURL(new Blob([content], { type: kind })), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  };
  card.append(element("div", { class: "toolbar" }, element("label", {}, "Show ", list), ...(varied.length === 2 ? [element("label", {}, "as ", kind)] : []),
    element("button", { type: "button", onclick: () => save([names.map((name) => (name.includes(",") ? `"${name}"` : name)).join(","), ...columns[varied[0]].map((_, k) => names.map((name) => columns[name][k] ?? "").join(","))].join("\n") + "\n", "text/csv", "sweep.csv") }, "Save CSV"),
    element("button", { type: "button", onclick: () => save(Uint8Array.from(atob(result.png), (c) => c.charCodeAt(0)), "image/png", "sweep.png") }, "Save PNG")), drawn);
  root.replaceChildren(card, element("details", { class: "card" }, element("summary", {}, `Table of ${rows.length} cameras`),
    element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": "Table of the sweep" }, table(result.labels[measured[0]] ? "All combinations, with 95 % intervals." : "All combinations.", shown.map(named), rows))),
  result.notes.length ? element("ul", { class: "notes", "aria-label": "Missing values" }, ...result.notes.map((note) => element("li", {}, note))) : "");
}

function heatMap(root, [across, down], columns, y) {
  const xs = [...new Set(columns[across])], ys = [...new Set(columns[down])], values = columns[y].filter((value) => value !== null);
  const low = Math.min(...values), high = Math.max(...values), W = window.innerWidth < 480 ? 360 : 560, H = 320, L = 62, T = 12, B = 48, R = 96;
  const [w, h] = [(W - L - R) / xs.length, (H - T - B) / ys.length];
  const drawn = svg("svg", { class: "plot", viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": `Heat map of ${named(y)} over ${named(across)} and ${named(down)}` });
  const value = element("p", { class: "plot-value" }, "Point at a field of the map to read it.");
  columns[across].forEach((a, k) => {
    const i = xs.indexOf(a), j = ys.indexOf(columns[down][k]), found = columns[y][k];
    const color = found === null ? "none" : `rgb(${viridis((found - low) / (high - low || 1)).join(",")})`;
    const cell = svg("rect", { x: L + i * w, y: H - B - (j + 1) * h, width: w + 0.3, height: h + 0.3, fill: color });
    cell.addEventListener("pointerenter", () => { value.textContent = `${named(across)} ${short(a)}, ${named(down)} ${short(columns[down][k])}: ${named(y)} ${short(found)}`; });
    drawn.append(cell);
  });
  const label = (x, yy, text, anchor = "middle", extra = {}) => { const made = svg("text", { x, y: yy, "text-anchor": anchor, ...extra }); made.textContent = text; drawn.append(made); };
  const every = (list, most) => Math.ceil(list.length / most);
  xs.forEach((x, i) => { if (i % every(xs, W / 70) === 0) label(L + (i + 0.5) * w, H - B + 16, short(x, 3)); });
  ys.forEach((v, j) => { if (j % every(ys, 8) === 0) label(L - 6, H - B - (j + 0.5) * h + 4, short(v, 3), "end"); });
  label((L + W - R) / 2, H - 10, named(across));
  label(16, (T + H - B) / 2, named(down), "middle", { transform: `rotate(-90 16 ${(T + H - B) / 2})` });
  for (let k = 0; k < 60; k++) drawn.append(svg("rect", { x: W - R + 16, y: H - B - (k + 1) * (H - T - B) / 60, width: 14, height: (H - T - B) / 60 + 0.4, fill: `rgb(${viridis(k / 59).join(",")})` }));
  for (const share of [0, 0.5, 1]) label(W - R + 36, H - B - share * (H - T - B) + (share === 1 ? 10 : 0), short(low + share * (high - low), 3), "start");
  label(W - 8, (T + H - B) / 2, named(y), "middle", { transform: `rotate(-90 ${W - 8} ${(T + H - B) / 2})` });
  root.append(drawn, value);
}
