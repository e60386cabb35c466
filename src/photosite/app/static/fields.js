// Rows of the form: a label, a slider, a number field and the unit, from the server's description of a field.

import { element } from "./dom.js";

const STEPS = 1000;
let count = 0;

// `changed(value)` gets a number, text, true or false, or null for an empty optional field.
export function fieldRow(field, value, changed) {
  const id = `field-${++count}`, hint = `${id}-hint`;
  const described = field.description ? { "aria-describedby": hint } : {};
  const row = element("div", { class: "row" });
  const set = (next) => {
    row.classList.toggle("changed", !same(next, field.value));
    changed(next);
  };
  row.classList.toggle("changed", !same(value, field.value));
  const unit = element("span", { class: "unit", id: `${id}-unit` }, field.unit);
  const label = element("label", { class: "name", for: id }, field.label);
  if (field.kind === "flag") {
    const box = element("input", { type: "checkbox", id, ...described, onchange: () => set(box.checked) });
    box.checked = Boolean(value);
    row.append(element("div", { class: "label" }, label, box));
  } else if (field.kind === "choice") {
    const list = element("select", { id, ...described, onchange: () => set(list.value === "" ? null : list.value) },
      field.optional ? element("option", { value: "" }, "none") : null,
      ...field.choices.map((choice) => element("option", { value: choice }, choice.replaceAll("_", " "))));
    list.value = value === null || value === undefined ? "" : String(value);
    row.append(element("div", { class: "label" }, label, element("span", { class: "entry" }, list)));
  } else if (field.kind === "text") {
    const suggestions = field.choices.length ? element("datalist", { id: `${id}-list` }, ...field.choices.map((choice) => element("option", { value: choice }))) : null;
    const box = element("input", { type: "text", id, list: suggestions?.id, ...described, onchange: () => set(box.value.trim() || null) });
    box.value = value ?? "";
    row.append(element("div", { class: "label" }, label, element("span", { class: "entry" }, box, suggestions)));
  } else {
    const box = element("input", {
      type: "number", id, step: field.kind === "whole" ? 1 : "any", ...described,
      min: field.lowest, max: field.highest, placeholder: field.optional ? "default" : null, required: !field.optional,
    });
    box.value = typeof value === "number" ? Number(value.toPrecision(6)) : value ?? "";
    const problem = element("p", { class: "problem", id: `${id}-problem`, role: "alert", hidden: true });
    box.setAttribute("aria-describedby", `${field.description ? `${hint} ` : ""}${problem.id}`);
    const check = () => {
      const valid = box.validity.valid;
      problem.hidden = valid;
      problem.textContent = valid ? "" : `${field.label} must be ${range(field)}.`;
      if (valid) box.removeAttribute("aria-invalid"); else box.setAttribute("aria-invalid", "true");
    };
    const slider = field.slider ? element("input", {
      type: "range", min: 0, max: STEPS, step: 1, "aria-label": `${field.label} slider${field.unit ? ` in ${field.unit}` : ""}`,
    }) : null;
    const show = () => { if (slider && box.value !== "") slider.value = position(field, Number(box.value)); };
    const spoken = () => slider?.setAttribute("aria-valuetext", `${box.value || "default"} ${field.unit}`.trim());
    show();
    spoken();
    box.addEventListener("input", () => {
      if (!box.validity.valid) return; // it can be half a number yet
      check();
      show();
      spoken();
      set(box.value === "" ? null : Number(box.value));
    });
    box.addEventListener("change", check);
    slider?.addEventListener("input", () => {
      const next = fromPosition(field, Number(slider.value));
      box.value = next;
      check();
      spoken();
      set(next);
    });
    row.append(element("div", { class: "label" }, label, element("span", { class: "entry" }, box, unit)));
    if (slider) row.append(slider);
    row.append(problem);
  }
  if (field.description) row.append(element("p", { class: "hint", id: hint }, field.description));
  return row;
}

// The values that a number field takes, as text.
function range({ kind, lowest, highest }) {
  const number = kind === "whole" ? "a whole number" : "a number";
  if (lowest !== null && highest !== null) return `${number} from ${lowest} to ${highest}`;
  return lowest !== null ? `${number}, ${lowest} or more` : highest !== null ? `${number}, ${highest} at most` : number;
}

function same(one, other) {
  if (one === other || (one ?? null) === (other ?? null)) return true;
  return one !== null && other !== null && one !== "" && other !== "" && Number(one) === Number(other);
}

function position(field, value) {
  const [low, high] = field.slider;
  const share = field.logarithmic && low > 0 ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.round(STEPS * Math.min(Math.max(Number.isFinite(share) ? share : 0, 0), 1));
}

function fromPosition(field, at) {
  const [low, high] = field.slider, share = at / STEPS;
  const value = field.logarithmic && low > 0 ? low * (high / low) ** share : low + share * (high - low);
  if (field.kind === "whole") return Math.round(value);
  return Number(Number(value).toPrecision(3));
}
