// The choice of a sensor: presets, files of the served folder, and the sensor of the camera view.

import { get, post } from "./api.js";
import { state as camera } from "./camera.js";
import { element } from "./dom.js";

const key = (sensor) => JSON.stringify([sensor.source, sensor.gain_setting ?? null, sensor.changes ?? {}]);

// A labelled list; `changed` gets the state of the chosen sensor.
export async function sensorPick(label, current, changed) {
  const [{ sensors }, files] = await Promise.all([post("/api/form", {}), get("/api/files?kind=sensor").catch(() => [])]);
  const presets = sensors.map((name) => [name, { source: name }]), own = files.map(({ name }) => [name, { source: `file:${name}` }]), others = [];
  const known = (sensor) => [...presets, ...own, ...others].some(([, each]) => key(each) === key(sensor));
  if (!known(camera.sensor)) others.push(["sensor of the camera view", camera.sensor]);
  if (!known(current)) others.push([current.source.replace(/^(file:|upload:|result:.*\/)/, "") + (Object.keys(current.changes ?? {}).length ? ", changed" : ""), current]);
  const options = (entries) => entries.map(([text, sensor]) => element("option", { value: key(sensor) }, text));
  const list = element("select", { onchange: () => changed([...presets, ...own, ...others].find(([, each]) => key(each) === list.value)[1]) },
    ...options(presets), ...(own.length ? [element("optgroup", { label: "Files of the folder" }, ...options(own))] : []), ...options(others));
  list.value = key(current);
  return element("label", {}, label, list);
}

const FALLBACK = "nikon-d200", OTHERS = { illuminant: "D65", scene: "macbeth" };

// What a view holds, with built-in ones in place of a deleted upload.
export function withoutUpload(content, name) {
  const kept = (key, each) => {
    if (each === name) return OTHERS[key];
    if (key === "of") return withoutUpload(each, name);
    if (each?.source === name) return key.startsWith("lens") ? { ...each, source: null } : { source: FALLBACK };
    if (!Array.isArray(each)) return each;
    const left = key === "lenses" ? each.map((one) => kept("lens", one)) : each.filter((one) => one !== name && one?.source !== name);
    return key === "sensors" && !left.length ? [{ source: FALLBACK }] : left;
  };
  return Object.fromEntries(Object.entries(content).map(([key, each]) => [key, kept(key, each)]));
}

// Whether a view offers an upload.
export const offers = (view, name) => [...view.querySelectorAll("option")].some((option) => option.value.includes(name));
