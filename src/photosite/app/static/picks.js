// Scene, lens and sensor: built in, files of the served folder, and files that a person uploads or drops.

import { get, showError, upload } from "./api.js";
import { element } from "./dom.js";
import { dropped } from "./drop.js";

const uploads = new Map();

// What the state becomes when a scene, lens or sensor is chosen.
const CHOSEN = {
  scene(state, value) {
    const own = value.includes(":"), light = state.scene.illuminant ?? "A", luminance = state.scene.mean_luminance_cd_m2 ?? 40;
    const picture = /\.(png|jpe?g)$/i.test(uploads.get(value)?.name ?? value);
    const [illuminant, mean_luminance_cd_m2] = !own ? [light, luminance] : picture ? ["D65", luminance] : [null, null];
    Object.assign(state.scene, { source: value, options: {}, illuminant, mean_luminance_cd_m2 });
  },
  lens(state, value) { state.lens.source = value || null; },
  sensor(state, value) { state.sensor = { source: value, gain_setting: null, changes: {}, binning: null }; },
};

// Chooses the first of the built-in ones in place of a deleted upload; returns the kinds that were changed.
export function forget(state, name) {
  const fallbacks = { scene: "macbeth", lens: "", sensor: "nikon-d200" };
  const used = Object.keys(fallbacks).filter((kind) => state[kind].source === name);
  for (const kind of used) CHOSEN[kind](state, fallbacks[kind]);
  if (state.scene.illuminant === name) { state.scene.illuminant = "A"; used.push("light"); }
  return used;
}

async function take(file, kind, state, reload) {
  try {
    showError("");
    const stored = await upload(file, kind);
    uploads.set(stored.name, { name: stored.file_name, text: `${stored.file_name} (${stored.holds})` });
    CHOSEN[kind](state, stored.name);
    reload(kind === "sensor");
  } catch (error) { showError(error.message); }
}

// What a file holds, by its name or its first line.
async function kindOf(file) {
  if (!/\.ya?ml$/i.test(file.name)) return "scene";
  return /^\s*photosite_optics\s*:/m.test(await file.slice(0, 1 << 16).text()) ? "lens" : "sensor";
}

export function dropOnView(view, stateOf, reload) {
  dropped(view, async ([file]) => take(file, await kindOf(file), stateOf(), reload));
}

// The choice of the gain setting: none where the sensor has only one.
export function gainPick(valueOf, state, reload) {
  const own = valueOf("gain_setting"), settings = [own, ...valueOf("gain_settings").map((each) => each.setting)].filter((each) => Number.isFinite(each));
  if (settings.length < 2) return [];
  const list = element("select", { id: "pick-gain", "data-key": "gain", onchange: () => { state.sensor.gain_setting = Number(list.value); reload(); } },
    ...settings.sort((a, b) => a - b).map((value) => element("option", { value }, String(value))));
  list.value = String(state.sensor.gain_setting ?? own);
  return [element("label", { for: "pick-gain" }, "Gain setting"), list];
}

export async function picks(form, state, reload) {
  const lists = await Promise.all(["scene", "sensor", "lens"].map((kind) => get(`/api/files?kind=${kind}`).catch(() => [])));
  const pick = (kind, label, builtIn, files, current) => {
    const list = element("select", { id: `pick-${kind}`, "data-key": kind, onchange: () => { CHOSEN[kind](state, list.value); reload(kind === "sensor"); } },
      ...builtIn.map(([value, text]) => element("option", { value }, text)),
      ...(files.length ? [element("optgroup", { label: "Files of the folder" }, ...files.map((file) => element("option", { value: `file:${file.name}` }, file.name)))] : []));
    if (![...list.options].some((option) => option.value === current)) list.append(element("option", { value: current }, uploads.get(current)?.text ?? current.replace(/^result:.*\//, "calibrated: ")));
    list.value = current;
    const file = element("input", { type: "file", id: `upload-${kind}`, class: "hidden", tabindex: "-1", "aria-hidden": "true" });
    file.addEventListener("change", () => { if (file.files.length) take(file.files[0], kind, state, reload); });
    const button = element("button", { type: "button", onclick: () => file.click(), "aria-label": `Upload a ${label.toLowerCase()} file` }, "Upload …");
    const box = element("div", {}, element("div", { class: "label row" }, element("label", { class: "name", for: `pick-${kind}` }, label), button), list, file);
    dropped(box, ([each]) => take(each, kind, state, reload));
    return box;
  };
  const named = (names) => names.map((name) => [name, name]);
  const found = [
    pick("scene", "Scene", named(form.scenes), lists[0], state.scene.source),
    pick("lens", "Lens", [["", "diffraction-limited lens"]], lists[2], state.lens.source ?? ""),
    pick("sensor", "Sensor", named(form.sensors), lists[1], state.sensor.source),
  ];
  found.push(element("p", { class: "hint" }, "Or drop a scene, a lens or a sensor file on this page."));
  return found;
}
