// Frames for a wanted precision.

import { DELETED, get } from "./api.js";
import { element, short, table } from "./dom.js";
import { field, jobBar } from "./jobview.js";
import { lightField, lights } from "./lights.js";
import { plot } from "./plots.js";
import { offers, sensorPick, withoutUpload } from "./sensors.js";

let request = { sensor: { source: "nikon-d200" }, wants: { system_gain_dn_per_e: "0.5%", prnu_percent: "2%" }, longest_dark_s: 5, longest_flat_s: 0.05, illuminant: "D65", seconds_per_frame: 1 };
const PRECISION = "\\s*(?=[\\d.]*[1-9])(\\d+\\.?\\d*|\\.\\d+)(e[+\\-]?\\d+)?\\s*%?\\s*", MOST_WANTS = 12;
let built = false;

window.addEventListener(DELETED, ({ detail }) => {
  if (built && (offers(document.getElementById("view-plan"), detail) || JSON.stringify(request).includes(detail))) show(withoutUpload(request, detail));
});

export async function show(content) {
  const root = document.getElementById("view-plan");
  if (built && !content) return;
  built = true;
  if (content) request = { ...request, ...content };
  const [pick, parameters, known] = await Promise.all([sensorPick("Sensor assumed", request.sensor, (sensor) => { request.sensor = sensor; }), get("/api/parameters"), lights()]);
  const results = element("div", { "aria-live": "polite" });
  const { bar, start } = jobBar("plan", "plan", () => request, (found) => draw(results, found, parameters));
  const wants = element("div");
  const drawWants = () => {
    const rows = Object.entries(request.wants).map(([name, text]) => {
      const label = parameters.find((each) => each.name === name);
      return element("div", { class: "fields" },
        field(label?.label ?? name, label?.unit || "%", { type: "text", pattern: PRECISION, title: "Enter a percentage such as 2%, or a number above 0 in the parameter's unit." }, text, (value) => { request.wants[name] = value; }),
        element("button", { type: "button", "aria-label": `Remove ${label?.label ?? name}`, onclick: () => { delete request.wants[name]; drawWants(); } }, "Remove"));
    });
    const left = parameters.filter((each) => !(each.name in request.wants));
    const full = rows.length >= MOST_WANTS;
    const more = element("select", { "aria-label": "Add a parameter", required: !rows.length, title: rows.length ? null : "Choose the parameter whose precision is wanted.", disabled: full, onchange: () => { request.wants[more.value] = "2%"; drawWants(); } },
      element("option", { value: "" }, full ? `${MOST_WANTS} parameters are the most` : "Add a parameter …"), ...left.map((each) => element("option", { value: each.name }, `${each.label}${each.unit ? ` (${each.unit})` : ""}`)));
    wants.replaceChildren(...rows, element("p", {}, more));
  };
  drawWants();
  root.replaceChildren(
    element("h2", { id: "plan-title" }, "Plan a measurement"),
    element("p", { class: "hint" }, "The fewest dark frames and flat fields that reach a standard uncertainty, for a sensor like yours. Nothing is simulated; a real setup adds its own variation."),
    element("div", { class: "card" },
      element("div", { class: "fields" },
        pick,
        field("Longest dark frame", "s", { type: "number", min: 1e-6, max: 1e5 }, request.longest_dark_s, (value) => { request.longest_dark_s = value; }),
        field("Longest flat field", "s", { type: "number", min: 1e-6, max: 1e5 }, request.longest_flat_s, (value) => { request.longest_flat_s = value; }),
        ...lightField("Illuminant of the flat fields", known, request.illuminant, (value) => { request.illuminant = value; }),
        field("Time to save a frame", "s", { type: "number", min: 0, max: 3600 }, request.seconds_per_frame, (value) => { request.seconds_per_frame = value; })),
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
  const groups = found.steps.map((each) => [each.kind === "dark" ? "dark frames" : "flat fields", String(each.frames), short(each.exposure_s), { content: Object.entries(each.electrons ?? {}).map(([name, value]) => `${name} ${short(value, 3)}`).join(", ") || "–", class: "wrapped" }]);
  const expected = Object.entries(found.expected).filter(([, each]) => each.standard_uncertainty !== null && each.standard_uncertainty !== undefined).map(([name, each]) => {
    const known = each.standard_uncertainty < Math.abs(each.value ?? 0);
    return [named(name), known ? short(each.value) : "0", short(each.standard_uncertainty, 2), known ? short(100 * each.standard_uncertainty / Math.abs(each.value), 2) : "–", request.wants[name] ?? ""];
  });
  const card = (title, ...content) => element("div", { class: "card", tabindex: "0", role: "group", "aria-label": title }, ...content);
  const drawn = element("div");
  root.replaceChildren(element("div", { class: "planned" },
    card("Frames of the plan", element("h3", {}, `${found.frames} frames, about ${found.duration}`),
      found.least_of_a_calibration ? element("p", { class: "hint" }, "The minimum of a calibration reaches the wanted precision.") : null,
      table(`Black level ${short(found.black_level_dn)} DN, so that dark frames do not clip.`, ["Kind", "Frames", "Exposure time (s)", "Mean signal (e⁻)"], groups)),
    element("div", { class: "card" }, element("h3", {}, "Precision against the number of frames"), drawn,
      element("p", { class: "hint" }, "The frames at all settings multiplied by the same factor, two or more at each. A ring is where a precision is met.")),
    card("Expected uncertainties", element("h3", {}, "Expected"),
      table("What a calibration of these frames reaches.", ["Parameter", "Expected", "Standard uncertainty", "Relative (%)", "Wanted"], expected, { class: "stacked" }))));
  precision(drawn, found, named);
}

// Curves of the expected over the wanted uncertainty, with marks where they fall to 1.
function precision(root, { frames, precision: { frames: x, expected_over_wanted: ratios } }, named) {
  const curves = Object.entries(ratios).map(([name, y], k) => ({ name, y, style: `s${k % 8}`, met: metAt(x, y) }));
  plot(root, {
    title: "Precision", x: { label: "frames", logarithmic: true }, y: { label: "uncertainty / wanted", logarithmic: true },
    lines: curves.map(({ name, y, style, met }) => ({ name: `${named(name)}, ${request.wants[name]}${met === null ? "" : met > x[0] ? ` from ${Math.ceil(met)} frames` : ` with the fewest frames`}`, x, y: y.map((each) => each ?? NaN), style })),
    marks: [{ y: 1, label: "wanted" }, { x: frames, label: `planned: ${frames} frames` },
      ...curves.filter(({ met }) => met !== null).map(({ y, style, met }) => ({ x: met, y: met > x[0] ? 1 : y[0], label: "", style }))],
  });
}

// The number of frames at which a falling curve reaches 1: between its points, or its first.
function metAt(x, y) {
  const k = y.findIndex((each) => each !== null && each <= 1);
  if (k < 1 || y[k - 1] === null) return k < 0 ? null : x[k];
  return x[k - 1] * (x[k] / x[k - 1]) ** (Math.log(y[k - 1]) / Math.log(y[k - 1] / y[k]));
}
