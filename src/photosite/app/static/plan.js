// Frames for a wanted precision.

import { get, post } from "./api.js";
import { element, short, table } from "./dom.js";
import { field, jobBar } from "./jobview.js";
import { lightField, lights } from "./lights.js";

let request = { sensor: { source: "nikon-d200" }, wants: { system_gain_dn_per_e: "0.5%", prnu_percent: "2%" }, longest_dark_s: 5, longest_flat_s: 0.05, illuminant: "D65", seconds_per_frame: 1 };
let built = false;

export async function show(content) {
  const root = document.getElementById("view-plan");
  if (built && !content) return;
  built = true;
  if (content) request = { ...request, ...content };
  const [{ sensors }, parameters, known] = await Promise.all([post("/api/form", {}), get("/api/parameters"), lights()]);
  const results = element("div", { "aria-live": "polite" });
  const { bar, start } = jobBar("plan", "plan", () => request, (found) => draw(results, found, parameters));
  const pick = element("select", { onchange: () => { request.sensor = { source: pick.value }; } }, ...sensors.map((name) => element("option", { value: name }, name)));
  if (!sensors.includes(request.sensor.source)) pick.append(element("option", { value: request.sensor.source }, request.sensor.source));
  pick.value = request.sensor.source;
  const wants = element("div");
  const drawWants = () => {
    const rows = Object.entries(request.wants).map(([name, text]) => {
      const label = parameters.find((each) => each.name === name);
      return element("div", { class: "fields" },
        field(label?.label ?? name, label?.unit || "%", { type: "text", required: true }, text, (value) => { request.wants[name] = value; }),
        element("button", { type: "button", "aria-label": `Remove ${label?.label ?? name}`, onclick: () => { delete request.wants[name]; drawWants(); } }, "Remove"));
    });
    const left = parameters.filter((each) => !(each.name in request.wants));
    const more = element("select", { "aria-label": "Add a parameter", onchange: () => { request.wants[more.value] = "2%"; drawWants(); } },
      element("option", { value: "" }, "Add a parameter …"), ...left.map((each) => element("option", { value: each.name }, `${each.label}${each.unit ? ` (${each.unit})` : ""}`)));
    wants.replaceChildren(...rows, element("p", {}, more));
  };
  drawWants();
  root.replaceChildren(
    element("h2", { id: "plan-title" }, "Plan a measurement"),
    element("p", { class: "hint" }, "The fewest dark frames and flat fields that reach a standard uncertainty, for a sensor like yours. Nothing is simulated; a real setup adds its own variation."),
    element("div", { class: "card" },
      element("div", { class: "fields" },
        element("label", {}, "Sensor assumed", pick),
        field("Longest dark frame", "s", { type: "number", min: 1e-6 }, request.longest_dark_s, (value) => { request.longest_dark_s = value; }),
        field("Longest flat field", "s", { type: "number", min: 1e-6 }, request.longest_flat_s, (value) => { request.longest_flat_s = value; }),
        ...lightField("Illuminant of the flat fields", known, request.illuminant, (value) => { request.illuminant = value; }),
        field("Time to save a frame", "s", { type: "number", min: 0 }, request.seconds_per_frame, (value) => { request.seconds_per_frame = value; })),
      element("h3", {}, "Wanted standard uncertainty"),
      element("p", { class: "hint" }, "Percent of the value, such as 2%, or a number in the parameter's unit."), wants),
    bar, results);
  start();
}

function draw(root, found, parameters) {
  const named = (name) => {
    const { label, unit } = parameters.find((each) => each.name === name) ?? { label: name, unit: "" };
    return unit ? `${label} (${unit})` : label;
  };
  const groups = found.steps.map((each) => [each.kind === "dark" ? "dark frames" : "flat fields", String(each.frames), short(each.exposure_s), Object.entries(each.electrons ?? {}).map(([name, value]) => `${name} ${short(value, 3)}`).join(", ") || "–"]);
  const expected = Object.entries(found.expected).filter(([, each]) => each.standard_uncertainty !== null && each.standard_uncertainty !== undefined).map(([name, each]) => {
    const known = each.standard_uncertainty < Math.abs(each.value ?? 0);
    return [named(name), known ? short(each.value) : "0", short(each.standard_uncertainty, 2), known ? short(100 * each.standard_uncertainty / Math.abs(each.value), 2) : "–", request.wants[name] ?? ""];
  });
  root.replaceChildren(element("div", { class: "beside" },
    element("div", { class: "card", tabindex: "0", role: "group", "aria-label": "Frames of the plan" }, element("h3", {}, `${found.frames} frames, about ${found.duration}`),
      found.least_of_a_calibration ? element("p", { class: "hint" }, "The minimum of a calibration reaches the wanted precision.") : null,
      table(`Black level ${short(found.black_level_dn)} DN, so that dark frames do not clip.`, ["Kind", "Frames", "Exposure time (s)", "Mean signal (e⁻)"], groups)),
    element("div", { class: "card", tabindex: "0", role: "group", "aria-label": "Expected uncertainties" }, element("h3", {}, "Expected"),
      table("What a calibration of these frames reaches.", ["Parameter", "Expected", "Standard uncertainty", "Relative (%)", "Wanted"], expected))));
}
