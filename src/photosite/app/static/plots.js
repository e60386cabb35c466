// Line plots as SVG, with axes, units, a key, and the values under the mouse or at the arrow keys.

import { element, short, svg } from "./dom.js";

const W = 460, H = 260, LEFT = 58, RIGHT = 12, TOP = 12, BOTTOM = 44;

function ticks(low, high, logarithmic) {
  if (logarithmic) {
    const found = [];
    const step = Math.max(1, Math.round((Math.log10(high) - Math.log10(low)) / 6));
    for (let k = Math.ceil(Math.log10(low) - 1e-9); k <= Math.log10(high) + 1e-9; k += step) found.push(10 ** k);
    if (found.length > 1) return found;
    return [low, Math.sqrt(low * high), high];
  }
  const raw = (high - low) / 5, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= raw);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high * (1 + 1e-12); k++) found.push(k * step);
  return found;
}

// Digits with which the ticks of a narrow range differ.
function digits(low, high, logarithmic) {
  if (logarithmic) return 3;
  return Math.min(Math.max(Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / (high - low))) + 2, 3), 12);
}

// plot(parent, {lines: [{name, x, y}], x: {label, logarithmic}, y: {label, logarithmic, low}, marks, title})
export function plot(parent, { lines, x, y, title, steps = false }) {
  const points = lines.flatMap((line) => line.x.map((value, k) => [value, line.y[k]]))
    .filter(([a, b]) => Number.isFinite(a) && Number.isFinite(b) && (!x.logarithmic || a > 0) && (!y.logarithmic || b > 0));
  parent.replaceChildren();
  if (!points.length) {
    parent.append(element("p", { class: "hint" }, "No values to plot."));
    return;
  }
  let [x0, x1] = [Math.min(...points.map((p) => p[0])), Math.max(...points.map((p) => p[0]))];
  let [y0, y1] = [Math.min(...points.map((p) => p[1])), Math.max(...points.map((p) => p[1]))];
  if (y.low !== undefined) y0 = y.low;
  if (x0 === x1) [x0, x1] = x.logarithmic ? [x0 / 2, x1 * 2] : [x0 - 1, x1 + 1];
  if (y0 === y1) [y0, y1] = y.logarithmic ? [y0 / 2, y1 * 2] : [y0 - 1, y1 + 1];
  if (!y.logarithmic) y1 += 0.04 * (y1 - y0);
  const scaled = (value, low, high, logarithmic) => logarithmic
    ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  const px = (value) => LEFT + (W - LEFT - RIGHT) * scaled(value, x0, x1, x.logarithmic);
  const py = (value) => H - BOTTOM - (H - TOP - BOTTOM) * scaled(value, y0, y1, y.logarithmic);
  const drawn = svg("svg", { class: "plot", viewBox: `0 0 ${W} ${H}`, role: "img", tabindex: "0", "aria-label": `${title}: ${y.label} over ${x.label}, ${lines.map((l) => l.name).join(", ")}` });
  for (const tick of ticks(x0, x1, x.logarithmic)) {
    drawn.append(svg("line", { class: "grid", x1: px(tick), x2: px(tick), y1: TOP, y2: H - BOTTOM }));
    const text = svg("text", { x: Math.min(px(tick), W - 2), y: H - BOTTOM + 16, "text-anchor": px(tick) > W - 30 ? "end" : "middle" });
    text.textContent = short(tick, digits(x0, x1, x.logarithmic));
    drawn.append(text);
  }
  for (const tick of ticks(y0, y1, y.logarithmic)) {
    drawn.append(svg("line", { class: "grid", x1: LEFT, x2: W - RIGHT, y1: py(tick), y2: py(tick) }));
    const text = svg("text", { x: LEFT - 6, y: py(tick) + 4, "text-anchor": "end" });
    text.textContent = short(tick, digits(y0, y1, y.logarithmic));
    drawn.append(text);
  }
  drawn.append(svg("path", { class: "axis", d: `M${LEFT} ${TOP}V${H - BOTTOM}H${W - RIGHT}` }));
  const across = svg("text", { x: (LEFT + W - RIGHT) / 2, y: H - 8, "text-anchor": "middle" });
  across.textContent = x.label;
  const down = svg("text", { x: 14, y: (TOP + H - BOTTOM) / 2, "text-anchor": "middle", transform: `rotate(-90 14 ${(TOP + H - BOTTOM) / 2})` });
  down.textContent = y.label;
  drawn.append(across, down);
  lines.forEach((line, number) => {
    let path = "", pen = false;
    line.x.forEach((value, k) => {
      const at = line.y[k];
      const inside = Number.isFinite(at) && at >= y0 && (!y.logarithmic || at > 0) && (!x.logarithmic || value > 0);
      if (inside) {
        const [a, b] = [px(value).toFixed(1), py(at).toFixed(1)];
        path += !pen ? `M${a} ${b}` : steps ? `H${a}V${b}` : `L${a} ${b}`;
      }
      pen = inside;
    });
    if (line.marks) {
      line.x.forEach((value, k) => {
        if (!Number.isFinite(line.y[k]) || line.y[k] < y0 || (x.logarithmic && !(value > 0))) return;
        const half = line.half?.[k], style = line.style || `s${number % 8}`;
        if (half) drawn.append(svg("line", { class: `bar ${style}`, x1: px(value), x2: px(value), y1: py(Math.min(line.y[k] + half, y1)), y2: py(Math.max(line.y[k] - half, y0)) }));
        drawn.append(svg("circle", { class: `mark ${style}${line.used && !line.used[k] ? " hollow" : ""}`, cx: px(value), cy: py(line.y[k]), r: 3 }));
      });
      return;
    }
    drawn.append(svg("path", { class: `line ${line.style || `s${number % 8}`}`, d: path }));
  });
  const cursor = svg("line", { class: "hover", y1: TOP, y2: H - BOTTOM, x1: -9, x2: -9, visibility: "hidden" });
  drawn.append(cursor);
  const value = element("p", { class: "plot-value", "aria-live": "polite" });
  // Points where there are some, else the values of all lines.
  const marked = lines.filter((line) => line.marks);
  const stops = [...new Set((marked.length ? marked : lines).flatMap((line) => line.x.filter((each, k) => Number.isFinite(line.y[k]) && each >= x0 && each <= x1)))].sort((a, b) => a - b);
  let shown = -1;
  const show = (at) => {
    cursor.setAttribute("x1", px(at));
    cursor.setAttribute("x2", px(at));
    cursor.setAttribute("visibility", "visible");
    value.textContent = `${x.label} ${short(at)}: ` + lines.map((line) => valueAt(line, at)).filter(Boolean).join(", ");
  };
  drawn.addEventListener("pointermove", (event) => {
    const box = drawn.getBoundingClientRect();
    const share = ((event.clientX - box.left) / box.width * W - LEFT) / (W - LEFT - RIGHT);
    if (share < 0 || share > 1) return;
    const at = x.logarithmic ? x0 * (x1 / x0) ** share : x0 + share * (x1 - x0);
    shown = stops.reduce((best, each, k) => (Math.abs(px(each) - px(at)) < Math.abs(px(stops[best]) - px(at)) ? k : best), 0);
    show(marked.length ? stops[shown] : at);
  });
  drawn.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1, PageDown: 10, PageUp: -10, Home: -stops.length, End: stops.length }[event.key];
    if (!step || !stops.length) return;
    event.preventDefault();
    shown = Math.min(Math.max(shown + step, 0), stops.length - 1);
    show(stops[shown]);
  });
  parent.append(drawn);
  if (lines.length > 1) {
    parent.append(element("ul", { class: "key" }, ...lines.map((line, number) => element("li", {},
      svg("svg", { viewBox: "0 0 30 6", "aria-hidden": "true" }, svg("line", { class: line.style || `s${number % 8}`, x1: 0, x2: 30, y1: 3, y2: 3 })), line.name))));
  }
  parent.append(value);
}

// The value of a line at a place: of its point there, or between its points.
function valueAt(line, at) {
  if (line.marks) {
    const k = line.x.indexOf(at);
    if (k < 0 || !Number.isFinite(line.y[k])) return "";
    return `${line.name} ${short(line.y[k])}${line.half?.[k] ? ` ± ${short(line.half[k], 2)} (95 %)` : ""}${line.used && !line.used[k] ? " (not used)" : ""}`;
  }
  const k = line.x.findIndex((each) => each >= at);
  if (k < 0 || (k === 0 && line.x[0] > at)) return "";
  const [a, b] = [line.x[Math.max(k - 1, 0)], line.x[k]], share = b > a ? (at - a) / (b - a) : 1;
  const [low, high] = [line.y[Math.max(k - 1, 0)], line.y[k]];
  const found = Number.isFinite(low) && Number.isFinite(high) ? low + share * (high - low) : high;
  return Number.isFinite(found) ? `${line.name} ${short(found)}` : "";
}
