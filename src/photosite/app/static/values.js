// The choice of values of image quality: columns of comparisons and sweeps, from the server's registry.

import { get, showError } from "./api.js";
import { element, short } from "./dom.js";

const MOST = 16;
let known = null;

// A list to add from, and a button for each chosen value that removes it. `changed` gets the names.
export async function valuePick(label, chosen, changed) {
  known ??= await get("/api/values");
  const box = element("div", { class: "values", role: "group", "aria-label": label }), groups = Map.groupBy(known, (each) => each.measurement);
  const unit = (each) => (each.unit ? ` (${each.unit})` : "");
  const draw = (names, focused = null) => {
    const set = (next) => { draw(next, next.length < names.length ? "select" : null); changed(next); };
    const list = element("select", { onchange: () => {
      if (names.length >= MOST) { showError(`${MOST} values are the most.`); list.value = ""; return; }
      set([...names, list.value]);
    } }, element("option", { value: "" }, "add a value …"),
    ...[...groups].map(([title, entries]) => element("optgroup", { label: title }, ...entries.filter((each) => !names.includes(each.name)).map((each) => element("option", { value: each.name, title: each.definition }, each.label + unit(each))))));
    box.replaceChildren(element("label", {}, label, list), ...names.map((name) => {
      const found = known.find((each) => each.name === name);
      return element("button", { type: "button", title: found?.definition, "aria-label": `Remove ${name}`, onclick: () => set(names.filter((each) => each !== name)) },
        `${name}${found ? unit(found) : ""} ×`);
    }));
    if (focused) box.querySelector(focused).focus();
  };
  draw(chosen);
  return box;
}

// A value with its interval, as text.
export const intervalText = (value, [low, high]) => `${short(value)}${Number.isFinite(low) ? ` (${short(low)} to ${short(high)})` : ""}`;
