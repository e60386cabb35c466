// The results of a calibration: files, tables with intervals, curves with residuals, and maps.

import { finished, post, progressReporter, showError, tab } from "./api.js";
import { state as camera } from "./camera.js";
import { chipMap } from "./chipmap.js";
import { element, short, table } from "./dom.js";
import { plot } from "./plots.js";
import { toHash } from "./state.js";

const STYLES = { R: "s1", G: "s2", B: "s0", M: "s0" };

const interval = (each) => (each.interval_95 ? `${short(each.interval_95[0], 5)} to ${short(each.interval_95[1], 5)}` : "–");

const value = (each) => (each.upper_limit_95 == null ? short(each.value, 5) : `< ${short(each.upper_limit_95, 2)}`);

function estimates(caption, first, rows) {
  const missing = rows.some((each) => each.value === null && each.reason);
  const head = [...first, "Value", "95 % interval", ...(missing ? ["Why it is missing"] : [])];
  return table(caption, head, rows.map((each) => [each.unit ? `${each.label} (${each.unit})` : each.label, ...(first.length > 1 ? [each.part] : []), value(each), interval(each),
    ...(missing ? [{ content: each.value === null ? each.reason : "", class: "reason" }] : [])]), { class: missing ? "stacked reasons" : "stacked" });
}

const scrolled = (label, ...content) => element("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": label }, ...content);
const list = (title, entries) => (entries.length ? [element("div", { class: "card" }, element("h3", {}, title), element("ul", { class: "notes" }, ...entries.map((text) => element("li", {}, text))))] : []);

function curveCard(curve) {
  const card = element("div", { class: "card" }), above = element("div"), below = element("div"), channels = Object.entries(curve.channels);
  const style = (name, k) => STYLES[name] ?? `s${k % 8}`, [logX, logY] = curve.logarithmic;
  const lines = channels.flatMap(([name, part], k) => {
    const x = part.x.filter((_, i) => part.used[i]);
    const marks = { name, x: part.x, y: part.y, half: part.half_95, used: part.used, marks: true, style: style(name, k) };
    if (part.slope === null || part.intercept === null || x.length < 2) return [marks];
    const ends = [Math.min(...x), Math.max(...x)];
    return [marks, { name: `${name} fitted`, x: ends, y: ends.map((value) => part.intercept + part.slope * value), style: style(name, k) }];
  });
  const title = curve.title || curve.kind.replaceAll("_", " ");
  card.append(element("h3", {}, title), above, below);
  plot(above, { title, lines, x: { label: curve.x_label, logarithmic: logX }, y: { label: curve.y_label, logarithmic: logY } });
  const left = channels.filter(([, part]) => part.residual.length).map(([name, part], k) => ({ name, x: part.x, y: part.residual.map((value, i) => (part.used[i] ? value ?? NaN : NaN)), marks: true, style: style(name, k) }));
  if (left.length) plot(below, { title: `Residuals of ${title}`, lines: left, x: { label: curve.x_label, logarithmic: logX }, y: { label: "residual (std. uncertainties)" } });
  return card;
}

function part(each, result) {
  const name = each.name ? `${each.name[0].toUpperCase()}${each.name.slice(1)}` : "", title = name || "Parameters";
  const parameters = scrolled(title, estimates(name ? "" : result.title, ["Parameter"], each.parameters));
  const plots = element("div", { class: "plots" }, ...each.curves.map(curveCard));
  const channels = Object.entries(each.channels).map(([channel, rows]) => element("details", { class: "card" }, element("summary", {}, `Channel ${channel}`),
    scrolled(`Parameters of channel ${channel}${name ? `, ${name}` : ""}`, estimates("Of this channel alone.", ["Parameter"], rows))));
  const maps = element("div", { class: "plots" }, ...each.maps.map((map) => chipMap(map, each.defects)));
  if (!name) return [element("div", { class: "card" }, element("h3", {}, title), parameters), plots, ...channels, maps];
  return [element("details", { class: "card" }, element("summary", {}, name), parameters, plots, ...channels, maps)];
}

// A button that makes the report, which takes longer than most calibrations, and downloads it.
function reportButton(result) {
  const text = element("span", { class: "hint", role: "status" });
  const button = element("button", { type: "button", onclick: async () => {
    button.disabled = true;
    try {
      const progress = progressReporter();
      const ended = await finished(await post(`/api/report?tab=${tab}`, { result: result.id }), (job) => { text.textContent = `Report: ${progress(job)}`; });
      if (ended.status !== "done") throw new Error(ended.error || "cancelled");
      const { name, address } = ended.result;
      element("a", { href: address, download: name }).click();
      text.textContent = `${name} downloaded`;
      showError("");
    } catch (error) { text.textContent = ""; showError(`The report was not written: ${error.message}`); }
    button.disabled = false;
  } }, "Download report.html");
  return [button, text];
}

export function drawResults(root, result) {
  const files = result.files.map(({ name, address }) => element("a", { class: "button", href: address, download: name }, `Download ${name}`));
  const sensor = result.files.find(({ name }) => name.endsWith(".sensor.yaml"));
  if (sensor) {
    const source = sensor.address.replace("/api/results/", "result:");
    files.push(element("a", { class: "button", href: toHash("camera", { ...camera, sensor: { source, gain_setting: null, changes: {}, binning: null } }) }, "Open the sensor in the camera view"));
  }
  root.replaceChildren(
    element("div", { class: "toolbar" }, ...files, ...(result.id ? reportButton(result) : [])),
    ...list("Limits of the result", result.warnings), ...list("Frames left out", result.rejected),
    ...result.tables.map((each) => element("div", { class: "card" }, element("h3", {}, each.title), scrolled(each.title, estimates(result.title, ["Parameter", each.first], each.rows)))),
    ...(result.curves.length ? [element("div", { class: "plots" }, ...result.curves.map(curveCard))] : []),
    ...result.parts.flatMap((each) => part(each, result)));
}
