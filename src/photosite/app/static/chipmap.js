// A map of the chip as a picture, with the value under the mouse or at the arrow keys, and defects as marks.

import { element, short } from "./dom.js";
import { viridis } from "./picture.js";

const COLORS = Array.from({ length: 256 }, (_, k) => viridis(k / 255));
const MARKS = { hot: "#ff3b30", offset: "#ff9f0a", dead: "#ffffff", response: "#ff2d9b", blinking: "#00e5ff", noisy: "#c6ff00" };

function valuesOf(map) {
  const bytes = Uint8Array.from(atob(map.values), (c) => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

export function chipMap(map, defects) {
  const { rows, cols, step, range: [low, high] } = map, values = valuesOf(map);
  const canvas = element("canvas", { width: cols, height: rows, tabindex: "0", role: "img", "aria-label": `Map: ${map.title}, median ${short(map.median)}, standard deviation ${short(map.standard_deviation)} ${map.unit}` });
  const context = canvas.getContext("2d"), picture = context.createImageData(cols, rows);
  values.forEach((value, k) => {
    const color = COLORS[Math.round(255 * Math.min(Math.max((value - low) / (high - low || 1), 0), 1))];
    picture.data.set([...color, 255], 4 * k);
  });
  const readout = element("p", { class: "plot-value", "aria-live": "polite" }, "Point at the map, or use the arrow keys, to read a pixel.");
  const kinds = new Set();
  const draw = () => {
    context.putImageData(picture, 0, 0);
    for (const [row, col, kind] of defects.listed ?? []) {
      if (!kinds.has(kind)) continue;
      context.strokeStyle = MARKS[kind];
      context.lineWidth = Math.max(cols / 400, 1);
      context.strokeRect(col / step - 2, row / step - 2, 5, 5);
    }
  };
  draw();
  let at = null;
  const show = (row, col) => {
    at = [Math.min(Math.max(row, 0), rows - 1), Math.min(Math.max(col, 0), cols - 1)];
    const found = (defects.listed ?? []).filter((each) => Math.floor(each[0] / step) === at[0] && Math.floor(each[1] / step) === at[1]);
    readout.textContent = `Row ${at[0] * step}, column ${at[1] * step}: ${short(values[at[0] * cols + at[1]])} ${map.unit}${found.length ? `; ${found.map((each) => `${each[2]} pixel (${short(each[3])})`).join(", ")}` : ""}`;
  };
  canvas.addEventListener("pointermove", (event) => {
    const box = canvas.getBoundingClientRect();
    show(Math.floor((event.clientY - box.top) / box.height * rows), Math.floor((event.clientX - box.left) / box.width * cols));
  });
  canvas.addEventListener("keydown", (event) => {
    const far = event.shiftKey ? 10 : 1, move = { ArrowUp: [-far, 0], ArrowDown: [far, 0], ArrowLeft: [0, -far], ArrowRight: [0, far] }[event.key];
    if (!move) return;
    event.preventDefault();
    const [row, col] = at ?? [Math.floor(rows / 2), Math.floor(cols / 2)];
    show(row + move[0], col + move[1]);
  });
  const bar = element("canvas", { width: 256, height: 1, "aria-hidden": "true" }), paint = bar.getContext("2d");
  COLORS.forEach((color, k) => { paint.fillStyle = `rgb(${color.join(",")})`; paint.fillRect(k, 0, 1, 1); });
  const boxes = Object.entries(defects.counts ?? {}).map(([kind, count]) => {
    const box = element("input", { type: "checkbox", onchange: () => { kinds[box.checked ? "add" : "delete"](kind); draw(); } });
    return element("label", { class: "choice" }, box, ` ${kind} (${count})`);
  });
  return element("div", { class: "card chip-map" }, element("h3", {}, map.title),
    canvas, element("div", { class: "scale" }, `${short(low, 3)} ${map.unit}`, bar, `${short(high, 3)} ${map.unit}`), readout,
    element("p", { class: "hint" }, `Median ${short(map.median)}, standard deviation over the pixels ${short(map.standard_deviation)} ${map.unit}. ${step > 1 ? `One of ${step} × ${step} pixels, none averaged. ` : ""}Colors from the 0.5 % to the 99.5 % quantile.`),
    boxes.length ? element("fieldset", { class: "choices" }, element("legend", {}, "Mark defects"), ...boxes) : null);
}
