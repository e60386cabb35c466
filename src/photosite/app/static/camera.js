// The camera view: form, preview, exact frame, plots and regions.

import { DELETED, finished, post, postForBytes, progressReporter, remove, showError, tab } from "./api.js";
import { copied, element, short, table } from "./dom.js";
import { partRow } from "./parts.js";
import { lights, spectrumUpload } from "./lights.js";
import { dropOnView, forget, gainPick, picks } from "./picks.js";
import { Picture, decode, describe, snrLegend } from "./picture.js";
import { plot } from "./plots.js";
import { merged, toHash } from "./state.js";

const at = (id) => document.getElementById(id);
const IDLE_MS = 450;

export let state = merged(null);
const FIRST_SETTING = 100; // of a sensor that states none, when others are added
const GAIN_TABLE = ["gain_setting", "gain_settings", "gain_setting_is_iso"];
let form = null, gain = null, picture = null, job = null, idle = null, exactWanted = false;
let inFlight = false, again = false, since = null, last = null, undo = null, suggested = null;
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
  at("auto-brightness").addEventListener("click", () => {
    state.brightness = Number(Math.min(Math.max(state.brightness * picture.brightening(), 1e-3), 1e6).toPrecision(3));
    at("brightness").value = state.brightness;
    request(performance.now());
    remember();
  });
  at("auto-exposure").addEventListener("click", () => {
    if (suggested === null) return;
    state.capture.exposure_s = suggested;
    build().then(() => changed(performance.now()));
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
    const [rows, cols] = picture.size;
    if (r0 >= rows || c0 >= cols) { showError(`The region is outside the frame, which has ${rows} rows and ${cols} columns.`); return; }
    showError("");
    addRegion([r0, r1, c0, c1]);
  });
  window.addEventListener("pagehide", () => { if (job) fetch(`/api/jobs/${job.id}`, { method: "DELETE", keepalive: true }); });
  dropOnView(at("view-camera"), () => state, reload);
  window.addEventListener(DELETED, ({ detail }) => {
    const used = forget(state, detail);
    if (used.length) reload(used.includes("sensor"));
  });
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
    // The form shows the sensor's own values, at a gain setting that can be a changed one; changes are marked beside them.
    const changes = Object.fromEntries(Object.entries(state.sensor.changes).filter(([name]) => GAIN_TABLE.includes(name)));
    form = await post("/api/form", { sensor: { ...state.sensor, changes, binning: null }, scene: state.scene.source });
  } catch (error) {
    showError(error.message);
    return;
  }
  await build();
  picture.setFrame(...array());
}

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
    return partRow(field, own[field.name], (value) => {
      own[field.name] = field.name === "cells_per_pixel" ? Number(value) : value;
      changed(performance.now());
    });
  };
  const known = await lights();
  const spectrum = spectrumUpload((name) => { state.scene.illuminant = name; build().then(() => changed(performance.now())); });
  const scene = form.scene.flatMap((each) => each.name === "options"
    ? [element("fieldset", {}, element("legend", {}, each.title), ...each.fields.map(optionRow))]
    : each.fields.flatMap((field) => field.name === "illuminant" ? [part("scene")({ ...field, choices: known.map(([name]) => name) }), ...spectrum] : part("scene")(field)));
  const lens = state.lens.source ? [element("p", { class: "hint" }, "The optics file defines the lens.")]
    : [...form.lens[0].fields.filter((each) => !each.fields.length).map(part("lens")), element("p", { class: "hint", id: "field-of-view" }, fieldOfView()), ...form.lens[0].fields.filter((each) => each.fields.length).map(part("lens"))];
  gain = element("div", {}, ...gainPick(sensorValue, state, reload));
  undo = element("button", { type: "button", onclick: undoSensor }, "Undo changes of the sensor");
  controls.replaceChildren(
    element("div", { class: "pick" }, ...(await picks(form, state, reload)), gain, undo),
    group("Light and place", scene),
    group("Lens", lens),
    group("Exposure", form.capture[0].fields.map(part("capture"))),
    ...form.sensor.map((each) => group(each.title, [...each.fields.map(sensorRow), ...(each.name === "readout" ? [part("sensor")(form.binning)] : [])])),
  );
  controls.scrollTop = top;
  if (focused) controls.querySelector(`[data-key="${focused}"]`)?.focus();
}

function optionRow(field) {
  return partRow(field, state.scene.options[field.name] ?? field.value, (value) => {
    if (value === null || value === field.value) delete state.scene.options[field.name];
    else state.scene.options[field.name] = value;
    changed(performance.now());
  });
}

function undoSensor() {
  if ("gain_settings" in state.sensor.changes || "gain_setting" in state.sensor.changes) state.sensor.gain_setting = null;
  Object.assign(state.sensor, { changes: {}, binning: null });
  reload(true);
}

function sensorRow(field) {
  const changes = state.sensor.changes, isPart = ["section", "entries", "list"].includes(field.kind);
  return partRow(field, field.name in changes ? changes[field.name] : field.value, (value) => {
    const own = isPart ? JSON.stringify(value) === JSON.stringify(field.value) : value === null || value === field.value;
    if (own) delete changes[field.name];
    else changes[field.name] = value;
    if (field.name === "gain_settings" && value.length && sensorValue("gain_setting") === null) {
      changes.gain_setting = FIRST_SETTING; // the others need it
      build().then(() => at("camera-controls").querySelector('[aria-label="Add to Other settings"]').focus());
    }
    if (GAIN_TABLE.includes(field.name)) gain.replaceChildren(...gainPick(sensorValue, state, reload));
    if (["rows", "cols"].includes(field.name)) picture.setFrame(...array());
    changed(performance.now());
  });
}

function reload(ofSensor = false) {
  if (ofSensor) picture.regions = [];
  loadForm().then(() => changed(performance.now()));
}

const sensorValue = (name) => state.sensor.changes[name] ?? form.sensor.flatMap((each) => each.fields).find((field) => field.name === name).value;
const array = () => ["rows", "cols"].map(sensorValue);

// The angle that the frame covers: with a focal length for another sensor, it is far too small or too large.
function fieldOfView() {
  const degrees = (count, um) => short(2 * Math.atan(count * um / 2000 / state.lens.focal_length_mm) * 180 / Math.PI, 3);
  const [rows, cols] = array();
  return `Field of view ${degrees(cols, sensorValue("width_um"))}° × ${degrees(rows, sensorValue("height_um"))}°, focused at infinity.`;
}

function remember() {
  if (!at("view-camera").hidden) history.replaceState(null, "", toHash("camera", state));
}

// A value was changed at time `when`: a preview now, the exact frame when nothing changes for a while.
function changed(when) {
  at("auto-exposure").disabled = true; // until the exact frame is known
  if (at("field-of-view")) at("field-of-view").textContent = fieldOfView();
  if (undo) undo.hidden = !Object.keys(state.sensor.changes).length && !state.sensor.binning;
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
    view.dn = begun === null || picture.layer === "raw" || picture.overlay;
    const data = decode(await postForBytes("/api/view", { state, view, tab }));
    showError("", "picture");
    picture.setFrame(data.header.frame_rows, data.header.frame_cols);
    picture.show(data);
    if (begun !== null) performance.measure("slider-to-picture", { start: begun, end: performance.now() });
    const spent = begun === null ? null : performance.now() - begun;
    requestAnimationFrame(() => describeView(data.header, spent));
  } catch (error) {
    showError(error.message, "picture");
    badge("", "no picture", error.status === 422 ? "The settings above cannot be simulated." : "");
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
  const sampling = header.step === 1 ? "every pixel in view" : `each the mean of ${header.step} × ${header.step} pixels of its color`;
  const saturated = header.saturated_fraction > 0 ? `; ${short(100 * header.saturated_fraction, 2)} % of them saturated` : "";
  const time = spent === null ? "" : `; ${Math.round(spent)} ms`;
  const rest = `${header.sensor}, ${size}: ${sampling}${saturated}${time}.`;
  if (header.exact) at("working").hidden = true;
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
  box.append(...snrLegend());
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
    name, ...(found ? [String(found.pixels), short(found.mean_dn, 6), short(found.sd_dn), short(found.mean_e, 5), short(found.snr_db, 4)] : [each.waits ? "follow with the exact frame" : "too few", "–", "–", "–", "–"])]));
  if (!regions.length) { at("regions").replaceChildren(); return; }
  const drawn = table("Mean and standard deviation over the pixels; signal above black.", ["Region", "Channel", "Pixels", "Mean (DN)", "SD (DN)", "Signal (e⁻)", "SNR (dB)"], rows, { class: "stacked" });
  const clear = element("button", { type: "button", onclick: () => { picture.regions = []; picture.draw(); request(); } }, "Remove regions");
  at("regions").replaceChildren(element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": "Values of the regions" }, drawn), clear);
}

async function exact() {
  let mine;
  try {
    mine = await post("/api/frames", { state, tab });
  } catch { return; } // the preview has said what is wrong
  job = mine;
  const progress = progressReporter();
  const ended = await finished(mine, (now) => {
    if (job?.id !== mine.id) return;
    at("working").hidden = Boolean(last?.exact); // a frame that is kept is on the screen already
    const bar = at("progress");
    if (now.total) { bar.max = now.total; bar.value = now.done; } else bar.removeAttribute("value");
    at("working-text").textContent = `Exact frame: ${progress(now)}`;
  }).catch((error) => ({ id: mine.id, status: "failed", error: error.message }));
  if (job?.id !== mine.id) return;
  job = null;
  at("working").hidden = true;
  exactWanted = false;
  if (ended.status === "failed") showError(`The exact frame could not be computed: ${ended.error}`, "picture");
  if (ended.status === "done") {
    suggest(ended.result.suggested_exposure_s);
    request();
  }
}

// The exposure time at which the bright parts of the frame are just below saturation.
function suggest(exposure_s) {
  const known = Number.isFinite(exposure_s) && exposure_s > 0 && exposure_s <= 1e5;
  suggested = known ? Number(exposure_s.toPrecision(3)) : null;
  at("auto-exposure").disabled = !known || suggested === state.capture.exposure_s;
  at("auto-exposure").title = known ? `${short(suggested)} s puts the bright parts just below saturation` : "";
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
