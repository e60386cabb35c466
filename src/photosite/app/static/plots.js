// Line plots as SVG, with axes, units, a key, and the values under the mouse or at the arrow keys.

import { element, short, svg } from "./dom.js";

const MARGIN = 12, BOTTOM = 44, LEAST_WIDTH = 280, MOST_WIDTH = 640, OTHER_WIDTH = 460, CHARACTER = 7.8;

// Plots are drawn for the width that they get, so that text has the same size in all.
const drawings = new WeakMap();
const widths = new ResizeObserver((changes) => {
  for (const { target } of changes) {
    const { width, draw } = drawings.get(target) ?? {};
    if (target.clientWidth && width !== fitting(target)) requestAnimationFrame(draw);
  }
});

function fitting(parent) {
  return parent.clientWidth ? Math.round(Math.min(Math.max(parent.clientWidth, LEAST_WIDTH), MOST_WIDTH) / 20) * 20 : OTHER_WIDTH;
}

function ticks(low, high, logarithmic) {
  if (logarithmic) {
    const decades = Math.log10(high / low), factors = decades > 2 ? [1] : decades > 0.7 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 6, 8];
    const found = [], step = Math.max(1, Math.ceil(decades / 7));
    for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k += step) found.push(...factors.map((each) => each * 10 ** k));
    const inside = found.filter((each) => each >= low * (1 - 1e-9) && each <= high * (1 + 1e-9));
    return inside.length > 1 ? inside : [low, Math.sqrt(low * high), high];
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

// plot(parent, {lines: [{name, x, y}], x: {label, logarithmic}, y: {label, logarithmic, low}, marks, title}) replaces what
// is in the parent. A line can have `ends`, the 95 % interval of each point. A mark {x, y, label} is a labelled point; without y or x, a labelled line across the plot.
export function plot(parent, content) {
  const draw = () => {
    const width = fitting(parent);
    drawings.set(parent, { width, draw });
    const height = Math.max(Math.min(0.56 * width, 300), 210, 7 * content.y.label.length + 40); // the label stands upright
    parent.replaceChildren(...drawn(content, width, Math.round(height)));
  };
  draw();
  widths.observe(parent);
}

function drawn({ lines, x, y, title, marks = [], steps = false }, W, H) {
  const visible = ([a, b]) => Number.isFinite(a) && Number.isFinite(b) && (!x.logarithmic || a > 0) && (!y.logarithmic || b > 0) && !(b < y.low);
  const points = [...lines.flatMap((line) => line.x.map((value, k) => [value, line.y[k]])).filter(visible)];
  if (!points.length) return [element("p", { class: "hint" }, "No values to plot.")];
  const bars = lines.flatMap((line) => (line.ends ?? []).flat()).filter(Number.isFinite);
  const extent = (k, each) => {
    const own = [...points.map((point) => point[k]), ...(k ? bars : []), ...marks.map((mark) => mark[each]).filter(Number.isFinite)];
    return [Math.min(...own), Math.max(...own)];
  };
  let [[x0, x1], [y0, y1]] = [extent(0, "x"), extent(1, "y")];
  if (y.low !== undefined) y0 = y.low;
  if (x0 === x1) [x0, x1] = x.logarithmic ? [x0 / 2, x1 * 2] : [x0 - 1, x1 + 1];
  if (y0 === y1) [y0, y1] = y.logarithmic ? [y0 / 2, y1 * 2] : [y0 - 1, y1 + 1];
  if (!y.logarithmic) y1 += 0.04 * (y1 - y0);
  const texts = { x: ticks(x0, x1, x.logarithmic).map((each) => [each, short(each, digits(x0, x1, x.logarithmic))]), y: ticks(y0, y1, y.logarithmic).map((each) => [each, short(each, digits(y0, y1, y.logarithmic))]) };
  const LEFT = 28 + CHARACTER * Math.max(...texts.y.map(([, text]) => text.length)), TOP = MARGIN, RIGHT = MARGIN;
  const scaled = (value, low, high, logarithmic) => logarithmic
    ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  const px = (value) => LEFT + (W - LEFT - RIGHT) * scaled(value, x0, x1, x.logarithmic);
  const py = (value) => H - BOTTOM - (H - TOP - BOTTOM) * scaled(value, y0, y1, y.logarithmic);
  const made = svg("svg", { class: "plot", viewBox: `0 0 ${W} ${H}`, role: "img", tabindex: "0", "aria-label": `${title}: ${y.label} over ${x.label}, ${lines.map((l) => l.name).join(", ")}` });
  const write = (at, down, anchor, content, extra = {}) => {
    const text = svg("text", { x: at, y: down, "text-anchor": anchor, ...extra });
    text.textContent = content;
    made.append(text);
  };
  let end = -Infinity;
  for (const [tick, text] of texts.x) {
    made.append(svg("line", { class: "grid", x1: px(tick), x2: px(tick), y1: TOP, y2: H - BOTTOM }));
    const half = CHARACTER * text.length / 2, at = Math.min(px(tick), W - half);
    if (at - half < end + 4) continue; // it would touch the one before
    write(at, H - BOTTOM + 16, "middle", text);
    end = at + half;
  }
  for (const [tick, text] of texts.y) {
    made.append(svg("line", { class: "grid", x1: LEFT, x2: W - RIGHT, y1: py(tick), y2: py(tick) }));
    write(LEFT - 6, py(tick) + 4, "end", text);
  }
  made.append(svg("path", { class: "axis", d: `M${LEFT} ${TOP}V${H - BOTTOM}H${W - RIGHT}` }));
  write((LEFT + W - RIGHT) / 2, H - 8, "middle", x.label);
  write(14, (TOP + H - BOTTOM) / 2, "middle", y.label, { transform: `rotate(-90 14 ${(TOP + H - BOTTOM) / 2})` });
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
        if (half) made.append(svg("line", { class: `bar ${style}`, x1: px(value), x2: px(value), y1: py(Math.min(line.y[k] + half, y1)), y2: py(Math.max(line.y[k] - half, y0)) }));
        made.append(svg("circle", { class: `mark ${style}${line.used && !line.used[k] ? " hollow" : ""}`, cx: px(value), cy: py(line.y[k]), r: 3 }));
      });
      return;
    }
    made.append(svg("path", { class: `line ${line.style || `s${number % 8}`}`, d: path }));
    line.ends?.forEach(([low, high], k) => {
      if (!Number.isFinite(low) || !Number.isFinite(line.y[k])) return;
      made.append(svg("line", { class: `bar ${line.style || `s${number % 8}`}`, x1: px(line.x[k]), x2: px(line.x[k]), y1: py(Math.min(high, y1)), y2: py(Math.max(low, y0)) }));
    });
  });
  for (const mark of marks) {
    const [across, down] = [mark.x, mark.y].map(Number.isFinite), right = across && px(mark.x) > (LEFT + W) / 2;
    if (across && down) made.append(svg("circle", { class: `reached ${mark.style ?? ""}`, cx: px(mark.x), cy: py(mark.y), r: 6 }));
    else if (across) made.append(svg("line", { class: "mark-line", x1: px(mark.x), x2: px(mark.x), y1: TOP, y2: H - BOTTOM }));
    else made.append(svg("line", { class: "mark-line", x1: LEFT, x2: W - RIGHT, y1: py(mark.y), y2: py(mark.y) }));
    write(across ? px(mark.x) + (right ? -6 : 6) : W - RIGHT - 4, !down ? H - BOTTOM - 8 : py(mark.y) > TOP + 20 ? py(mark.y) - 8 : py(mark.y) + 14, right || !across ? "end" : "start", mark.label, { class: "mark-text" });
  }
  const cursor = svg("line", { class: "hover", y1: TOP, y2: H - BOTTOM, x1: -9, x2: -9, visibility: "hidden" });
  made.append(cursor);
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
  made.addEventListener("pointermove", (event) => {
    const box = made.getBoundingClientRect();
    const share = ((event.clientX - box.left) / box.width * W - LEFT) / (W - LEFT - RIGHT);
    if (share < 0 || share > 1) return;
    const at = x.logarithmic ? x0 * (x1 / x0) ** share : x0 + share * (x1 - x0);
    shown = stops.reduce((best, each, k) => (Math.abs(px(each) - px(at)) < Math.abs(px(stops[best]) - px(at)) ? k : best), 0);
    show(marked.length ? stops[shown] : at);
  });
  made.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1, PageDown: 10, PageUp: -10, Home: -stops.length, End: stops.length }[event.key];
    if (!step || !stops.length) return;
    event.preventDefault();
    shown = Math.min(Math.max(shown + step, 0), stops.length - 1);
    show(stops[shown]);
  });
  const key = lines.length < 2 ? [] : [element("ul", { class: "key" }, ...lines.map((line, number) => element("li", {},
    svg("svg", { viewBox: "0 0 30 6", "aria-hidden": "true" }, svg("line", { class: line.style || `s${number % 8}`, x1: 0, x2: 30, y1: 3, y2: 3 })), line.name)))];
  return [made, ...key, value];
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
  const own = b === at ? line.ends?.[k] : null;
  return Number.isFinite(found) ? `${line.name} ${short(found)}${own && Number.isFinite(own[0]) ? ` (95 %: ${short(own[0])} to ${short(own[1])})` : ""}` : "";
}
