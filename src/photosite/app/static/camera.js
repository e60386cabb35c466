// The camera view: form, preview, exact frame, plots and regions.

import { finished, get, post, postForBytes, remove, showError, tab, upload } from "./api.js";
import { copied, element, short, table } from "./dom.js";
import { fieldRow } from "./fields.js";
import { Picture, SNR_RANGE, decode, describe, viridis } from "./picture.js";
import { plot } from "./plots.js";
import { merged, toHash } from "./state.js";

const at = (id) => document.getElementById(id);
const IDLE_MS = 450;
const LIGHTS = ["A", "D50", "D65", "3200K", "daylight 5600", "led 4000", "FL2", "FL11", "sunlight"];

export let state = merged(null);
let form = null, picture = null, job = null, idle = null, exactWanted = false;
let inFlight = false, again = false, since = null, last = null;
const open = new Set(["Light and place", "Lens", "Exposure", "Noise"]);

export async function start(content) {
  state = merged(content);
  picture = new Picture(at("picture"), { onview: () => request(), onregion: addRegion, onpoint: (pixel) => { at("readout").textContent = describe(pixel); } });
  at("layer").addEventListener("change", layered);
  at("overlay").addEventListener("change", layered);
  at("brightness").value = state.brightness;
  at("brightness").addEventListener("input", () => {
    const value = Number(at("brightness").value);
    if (value > 0) { state.brightness = value; request(performance.now()); remember(); }
  });
  at("zoom-in").addEventListener("click", () => picture.zoom(1.5));
  at("zoom-out").addEventListener("click", () => picture.zoom(1 / 1.5));
  at("zoom-fit").addEventListener("click", () => picture.fit());
  at("zoom-one").addEventListener("click", () => picture.one());
  for (const mode of ["pan", "region"]) at(`mode-${mode}`).addEventListener("click", () => setMode(mode));
  at("cancel").addEventListener("click", () => cancel(true));
  at("copy-python").addEventListener("click", () => copyCode("python", "Python", "dn is the array of digital numbers on this page."));
  at("copy-command").addEventListener("click", () => copyCode("command", "Command", state.capture.noise ? "shot.tif holds the digital numbers of this page." : "clean.tif holds the noise-free digital numbers of this page."));
  at("copy-link").addEventListener("click", () => copied("Link", location.origin + "/" + toHash("camera", state), "The link restores this state on this server, in a browser that has opened it."));
  at("save").addEventListener("click", save);
  at("region-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const [r0, r1, c0, c1] = ["r0", "r1", "c0", "c1"].map((name) => Number(at(`region-${name}`).value));
    if (!(r1 > r0 && c1 > c0)) { showError("The last row and column of a region must be greater than the first."); return; }
    addRegion([r0, r1, c0, c1]);
  });
  window.addEventListener("pagehide", () => { if (job) fetch(`/api/jobs/${job.id}`, { method: "DELETE", keepalive: true }); });
  await loadForm();
  changed(performance.now());
}

export async function restore(content) {
  state = merged(content);
  at("brightness").value = state.brightness;
  await loadForm();
  changed(performance.now());
}

async function loadForm() {
  try {
    form = await post("/api/form", { sensor: { ...state.sensor, changes: arraySize() }, scene: state.scene.source });
  } catch (error) {
    showError(error.message);
    return;
  }
  await build();
  const [rows, cols] = ["rows", "cols"].map((name) => state.sensor.changes[name] ?? form.sensor[0].fields.find((field) => field.name === name).value);
  picture.setFrame(rows, cols);
}

// Changes do not alter the values that the form shows as the sensor's own.
const arraySize = () => ({});

function group(title, content, note) {
  const details = element("details", { ontoggle: () => open[details.open ? "add" : "delete"](title) }, element("summary", {}, title), ...content);
  details.open = open.has(title);
  if (note) details.append(element("p", { class: "hint" }, note));
  return details;
}

async function build() {
  const controls = at("camera-controls"), top = controls.scrollTop, focused = document.activeElement?.dataset?.key;
  const part = (name) => (field) => {
    const own = state[name];
    return fieldRow(field, own[field.name], (value) => {
      own[field.name] = field.name === "cells_per_pixel" ? Number(value) : value;
      changed(performance.now());
    });
  };
  const scene = form.scene.flatMap((each) => each.name === "options"
    ? [element("fieldset", {}, element("legend", {}, each.title), ...each.fields.map(optionRow))]
    : each.fields.map((field) => part("scene")(field.name === "illuminant" ? { ...field, list: "lights" } : field)));
  const [array, ...others] = form.sensor;
  const sensorGroups = others.filter((each) => !each.optional), effects = others.filter((each) => each.optional);
  const lens = state.lens.source ? [element("p", { class: "hint" }, "The optics file defines the lens.")] : form.lens[0].fields.map(part("lens"));
  controls.replaceChildren(
    element("datalist", { id: "lights" }, ...LIGHTS.map((value) => element("option", { value }))),
    element("div", { class: "pick" }, ...(await picks())),
    group("Light and place", scene),
    group("Lens", lens),
    group("Exposure", form.capture[0].fields.map(part("capture"))),
    group("Array", array.fields.map((field) => sensorRow(field, true))),
    ...sensorGroups.map((each) => group(each.title, each.fields.map((field) => sensorRow(field)), each.note)),
    group("Shutter and effects", effects.map(effectRow)),
  );
  controls.scrollTop = top;
  if (focused) controls.querySelector(`[data-key="${focused}"]`)?.focus();
}

function optionRow(field) {
  return fieldRow(field, state.scene.options[field.name] ?? field.value, (value) => {
    if (value === null || value === field.value) delete state.scene.options[field.name];
    else state.scene.options[field.name] = value;
    changed(performance.now());
  });
}

function sensorRow(field, resizes = false) {
  const changes = state.sensor.changes;
  return fieldRow(field, changes[field.name] ?? field.value, (value) => {
    if (value === null || value === field.value) delete changes[field.name];
    else changes[field.name] = value;
    if (resizes) picture.setFrame(...array());
    changed(performance.now());
  });
}

const array = () => ["rows", "cols"].map((name) => state.sensor.changes[name] ?? form.sensor[0].fields.find((field) => field.name === name).value);

function effectRow(effect) {
  const changes = state.sensor.changes, own = changes[effect.name];
  const enabled = own === undefined ? effect.enabled : own !== null;
  const box = element("input", { type: "checkbox", id: `effect-${effect.name}`, "data-key": effect.name });
  box.checked = enabled;
  box.addEventListener("change", () => {
    if (box.checked === effect.enabled) delete changes[effect.name];
    else changes[effect.name] = box.checked ? structuredClone(effect.example) : null;
    changed(performance.now());
    build();
  });
  const rows = enabled ? effect.fields.map((field) => fieldRow(field, own?.[field.name] ?? field.value, (value) => {
    const next = { ...(changes[effect.name] ?? effect.example) };
    if (value === null) delete next[field.name]; else next[field.name] = value;
    changes[effect.name] = next;
    changed(performance.now());
  })) : [];
  return element("div", { class: "effect" },
    element("div", { class: "label" }, element("label", { for: box.id }, box, ` ${effect.title}`)),
    element("p", { class: "hint" }, effect.description, enabled && effect.note ? ` ${effect.note}` : ""), ...rows);
}

async function picks() {
  const lists = await Promise.all(["scene", "sensor", "lens"].map((kind) => get(`/api/files?kind=${kind}`).catch(() => [])));
  const pick = (key, label, kind, builtIn, files, current, chosen) => {
    const list = element("select", { id: `pick-${key}`, "data-key": key, onchange: () => chosen(list.value) },
      ...builtIn.map(([value, text]) => element("option", { value }, text)),
      ...(files.length ? [element("optgroup", { label: "Files of the folder" }, ...files.map((file) => element("option", { value: `file:${file.name}` }, file.name)))] : []));
    if (![...list.options].some((option) => option.value === current)) list.append(element("option", { value: current }, uploads.get(current)?.text ?? current));
    list.value = current;
    const file = element("input", { type: "file", id: `upload-${key}`, class: "hidden", tabindex: "-1", "aria-hidden": "true" });
    file.addEventListener("change", async () => {
      if (!file.files.length) return;
      try {
        showError("");
        const stored = await upload(file.files[0], kind);
        uploads.set(stored.name, { name: stored.file_name, text: `${stored.file_name} (${stored.holds})` });
        chosen(stored.name);
      } catch (error) { showError(error.message); }
    });
    const button = element("button", { type: "button", onclick: () => file.click(), "aria-label": `Upload a ${label.toLowerCase()} file` }, "Upload …");
    return element("div", {}, element("div", { class: "label row" }, element("label", { class: "name", for: `pick-${key}` }, label), button), list, file);
  };
  const found = [
    pick("scene", "Scene", "scene", form.scenes.map((name) => [name, name]), lists[0], state.scene.source, (value) => {
      state.scene.source = value;
      state.scene.options = {};
      const own = value.includes(":");
      state.scene.illuminant = own ? (/\.(png|jpe?g)$/i.test(uploads.get(value)?.name ?? value) ? "D65" : null) : state.scene.illuminant ?? "A";
      state.scene.mean_luminance_cd_m2 = own && state.scene.illuminant === null ? null : state.scene.mean_luminance_cd_m2 ?? 40;
      loadForm().then(() => changed(performance.now()));
    }),
    pick("lens", "Lens", "lens", [["", "diffraction-limited lens"]], lists[2], state.lens.source ?? "", (value) => {
      state.lens.source = value || null;
      loadForm().then(() => changed(performance.now()));
    }),
    pick("sensor", "Sensor", "sensor", form.sensors.map((name) => [name, name]), lists[1], state.sensor.source, (value) => {
      state.sensor = { source: value, gain_setting: null, changes: {} };
      picture.regions = [];
      loadForm().then(() => changed(performance.now()));
    }),
  ];
  if (form.gain_settings.length > 1) {
    const list = element("select", { id: "pick-gain", "data-key": "gain", onchange: () => {
      state.sensor.gain_setting = Number(list.value);
      loadForm().then(() => changed(performance.now()));
    } }, ...form.gain_settings.map((value) => element("option", { value }, String(value))));
    list.value = String(state.sensor.gain_setting ?? form.gain_setting);
    found.push(element("div", {}, element("label", { for: "pick-gain" }, "Gain setting"), list));
  }
  if (Object.keys(state.sensor.changes).length) {
    found.push(element("button", { type: "button", onclick: () => { state.sensor.changes = {}; loadForm().then(() => changed(performance.now())); } }, "Undo changes of the sensor"));
  }
  return found;
}

const uploads = new Map();

function remember() {
  if (!at("view-camera").hidden) history.replaceState(null, "", toHash("camera", state));
}

// A value was changed at time `when`: a preview now, the exact frame when nothing changes for a while.
function changed(when) {
  cancel(false);
  request(when);
  clearTimeout(idle);
  idle = setTimeout(() => { remember(); exact(); }, IDLE_MS);
  exactWanted = true;
}

async function request(when = null) {
  if (!picture?.place || !form) return;
  since ??= when;
  if (inFlight) { again = true; return; }
  inFlight = true;
  const begun = since;
  since = null;
  try {
    const view = picture.view();
    // While a slider moves, the picture has what it shows and no more; all of it follows with the exact frame.
    view.mean = begun === null || ["mean", "snr"].includes(picture.layer);
    const data = decode(await postForBytes("/api/view", { state, view, tab }));
    showError("");
    picture.setFrame(data.header.frame_rows, data.header.frame_cols);
    picture.show(data);
    if (begun !== null) performance.measure("slider-to-picture", { start: begun, end: performance.now() });
    const spent = begun === null ? null : performance.now() - begun;
    requestAnimationFrame(() => describeView(data.header, spent));
  } catch (error) {
    showError(error.message);
    badge("", "no picture", "The settings above cannot be simulated.");
  }
  inFlight = false;
  if (again) { again = false; request(); }
}

function badge(kind, text, rest) {
  at("badge").className = `badge ${kind}`;
  at("badge").textContent = text;
  at("status-text").textContent = rest;
}

function describeView(header, spent) {
  last = header;
  const size = `${header.frame_rows} × ${header.frame_cols} pixels`;
  const sampling = header.step === 1 ? "every pixel in view" : `one of ${header.step} × ${header.step} pixels, none averaged`;
  const saturated = header.saturated_fraction > 0 ? `; ${short(100 * header.saturated_fraction, 2)} % of them saturated` : "";
  const time = spent === null ? "" : `; ${Math.round(spent)} ms`;
  const rest = `${header.sensor}, ${size}: ${sampling}${saturated}${time}.`;
  if (header.exact) badge("exact", "exact frame", rest);
  else badge("preview", "preview", `${rest} ${exactWanted ? "The exact frame follows." : ""}`);
  at("notes").hidden = !header.notes.length;
  at("notes").replaceChildren(...header.notes.map((note) => element("li", {}, note)));
  at("picture").setAttribute("aria-label", `${at("layer").selectedOptions[0].textContent} of ${header.scene}, ${header.exact ? "exact" : "preview"}`);
  const { counts, dn_per_bin: width } = header.histogram;
  const styles = { R: "s1", G: "s2", B: "s0" };
  plot(at("histogram"), {
    title: "Histogram", steps: true,
    lines: Object.entries(counts).map(([name, y], k) => ({ name, x: y.map((_, bin) => bin * width), y: y.map((n) => n || NaN), style: styles[name] ?? `s${(k + 3) % 8}` })),
    x: { label: "digital number (DN)" }, y: { label: "pixels in view", logarithmic: true, low: 0.8 },
  });
  plot(at("snr-plot"), {
    title: "Signal-to-noise ratio", lines: [{ name: "SNR", x: header.snr.signal_e, y: header.snr.snr_db }],
    x: { label: "light (e⁻)", logarithmic: true }, y: { label: "SNR (dB)", low: -10 },
  });
  describeRegions(header.regions);
  legend();
}

function legend() {
  const box = at("legend");
  box.hidden = at("layer").value !== "snr";
  if (box.hidden || box.childElementCount) return;
  const bar = element("canvas", { width: 192, height: 1, "aria-hidden": "true" }), context = bar.getContext("2d");
  for (let k = 0; k < 192; k++) { context.fillStyle = `rgb(${viridis(k / 191).join(",")})`; context.fillRect(k, 0, 1, 1); }
  box.append(`SNR ${SNR_RANGE[0]} dB`, bar, `${SNR_RANGE[1]} dB`);
}

function layered() {
  picture.setLayer(at("layer").value, at("overlay").checked);
  legend();
}

function setMode(mode) {
  picture.mode = mode;
  for (const each of ["pan", "region"]) at(`mode-${each}`).setAttribute("aria-pressed", String(each === mode));
  at("picture").classList.toggle("region", mode === "region");
}

function addRegion(region) {
  if (picture.regions.length >= 8) { showError("Eight regions are the most; remove one first."); return; }
  const [rows, cols] = picture.size, inside = [Math.min(region[0], rows - 1), Math.min(region[1], rows), Math.min(region[2], cols - 1), Math.min(region[3], cols)];
  picture.regions = [...picture.regions, inside];
  picture.draw();
  request();
}

function describeRegions(regions) {
  const rows = regions.flatMap((each, number) => Object.entries(each.channels).map(([name, found], k) => [
    k ? "" : `${number + 1}: rows ${each.region[0]}–${each.region[1] - 1}, columns ${each.region[2]}–${each.region[3] - 1}${each.exact ? "" : " (preview)"}`,
    name, ...(found ? [String(found.pixels), short(found.mean_dn, 6), short(found.sd_dn), short(found.mean_e, 5), short(found.snr_db, 4)] : ["too few", "–", "–", "–", "–"])]));
  if (!regions.length) { at("regions").replaceChildren(); return; }
  const drawn = table("Mean and standard deviation over the pixels; signal above black.", ["Region", "Channel", "Pixels", "Mean (DN)", "SD (DN)", "Signal (e⁻)", "SNR (dB)"], rows);
  const clear = element("button", { type: "button", onclick: () => { picture.regions = []; picture.draw(); request(); } }, "Remove regions");
  at("regions").replaceChildren(element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": "Values of the regions" }, drawn), clear);
}

async function exact() {
  let mine;
  try {
    mine = await post("/api/frames", { state, tab });
  } catch { return; } // the preview has said what is wrong
  job = mine;
  at("working").hidden = false;
  const ended = await finished(mine, (now) => {
    if (job !== mine && job?.id !== mine.id) return;
    const bar = at("progress");
    if (now.total) { bar.max = now.total; bar.value = now.done; } else bar.removeAttribute("value");
    at("working-text").textContent = now.status === "queued" ? "Exact frame: waits for other computations" : `Exact frame: ${now.what || "scene"} ${now.total ? `${now.done} of ${now.total}` : ""}`;
  }).catch((error) => ({ id: mine.id, status: "failed", error: error.message }));
  if (job?.id !== mine.id) return;
  job = null;
  at("working").hidden = true;
  exactWanted = false;
  if (ended.status === "failed") showError(`The exact frame could not be computed: ${ended.error}`);
  if (ended.status === "done") request();
}

function cancel(byHand) {
  const running = job;
  job = null;
  at("working").hidden = true;
  if (byHand) { exactWanted = false; clearTimeout(idle); if (last && !last.exact) describeView(last, null); request(); }
  if (running) remove(`/api/jobs/${running.id}`).catch(() => {});
}

async function copyCode(kind, title, note) {
  try {
    copied(title, (await post("/api/code", state))[kind], note);
  } catch (error) { showError(error.message); }
}

async function save() {
  const suffix = at("save-kind").value;
  try {
    at("save").disabled = true;
    const content = await postForBytes("/api/save", { state, suffix });
    const link = element("a", { href: URL.createObjectURL(new Blob([content])), download: `shot${suffix}` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  } catch (error) { showError(error.message); }
  at("save").disabled = false;
}
