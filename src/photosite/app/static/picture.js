// The canvas: one view of the frame, zoom and movement, layers, and what is under the mouse.

import { short } from "./dom.js";

const VIRIDIS = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37]];
const SNR_RANGE = [0, 45];

export function viridis(share) {
  const at = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1), k = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[k].map((low, c) => Math.round(low + (at - k) * (VIRIDIS[k + 1][c] - low)));
}

// The body of /api/view as arrays.
export function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const count = header.rows * header.cols, at = 4 + length, atDn = at + (header.mean ? 4 * count : 0);
  const Kind = header.dn_type === "uint16" ? Uint16Array : Float32Array, atPicture = header.dn_type ? atDn + Kind.BYTES_PER_ELEMENT * count : atDn;
  return {
    header,
    mean: header.mean ? new Float32Array(buffer, at, count) : null,
    dn: header.dn_type ? new Kind(buffer, atDn, count) : null,
    rgba: header.developed ? new Uint8ClampedArray(buffer, atPicture, 4 * count) : null,
  };
}

const gamma = new Uint8ClampedArray(1025).map((_, k) => Math.round(255 * (k / 1024) ** (1 / 2.2)));

export class Picture {
  constructor(canvas, { onview, onregion, onpoint }) {
    this.canvas = canvas;
    this.onview = onview;
    this.onregion = onregion;
    this.onpoint = onpoint;
    this.place = null; // {row, col, scale}: top left in pixels of the sensor, and CSS pixels for each
    this.fitted = true;
    this.size = [1, 1];
    this.data = null;
    this.layer = "developed";
    this.overlay = false;
    this.mode = "pan";
    this.regions = [];
    this.drawing = null;
    this.image = document.createElement("canvas");
    this.listen();
    new ResizeObserver(() => this.resized()).observe(canvas);
  }

  resized() {
    const box = this.canvas.getBoundingClientRect();
    if (!box.width || !box.height) return;
    this.canvas.width = Math.round(box.width);
    this.canvas.height = Math.round(box.height);
    if (this.fitted) this.fit(false);
    this.draw();
    this.onview();
  }

  setFrame(rows, cols) {
    if (this.size[0] === rows && this.size[1] === cols && this.place) return;
    this.size = [rows, cols];
    this.fit(false);
  }

  // What is in view as shares of the frame, to show the same part of other frames.
  share() {
    const { row, col, scale } = this.place, [rows, cols] = this.size, { width, height } = this.canvas;
    return { fitted: this.fitted, y: (row + height / scale / 2) / rows, x: (col + width / scale / 2) / cols, span: width / scale / cols };
  }

  shareAt(x, y) {
    return { y: (this.place.row + y / this.place.scale) / this.size[0], x: (this.place.col + x / this.place.scale) / this.size[1] };
  }

  follow({ fitted, x, y, span }) {
    if (fitted) this.fit(false);
    else {
      const [rows, cols] = this.size, { width, height } = this.canvas, scale = Math.min(width / (span * cols), 64);
      this.place = { scale, row: y * rows - height / scale / 2, col: x * cols - width / scale / 2 };
      this.fitted = false;
      this.clamp();
    }
    this.draw();
  }

  fit(report = true) {
    const [rows, cols] = this.size, { width, height } = this.canvas;
    const scale = Math.min(width / cols, height / rows);
    this.place = { scale, row: (rows - height / scale) / 2, col: (cols - width / scale) / 2 };
    this.fitted = true;
    if (report) this.moved();
  }

  zoom(factor, x = this.canvas.width / 2, y = this.canvas.height / 2) {
    const old = this.place.scale, least = Math.min(this.canvas.width / this.size[1], this.canvas.height / this.size[0]);
    const scale = Math.min(Math.max(old * factor, least), 64);
    this.place.row += y / old - y / scale;
    this.place.col += x / old - x / scale;
    this.place.scale = scale;
    this.fitted = scale <= least * 1.0001;
    if (this.fitted) this.fit(false);
    this.moved();
  }

  one() {
    this.zoom(1 / this.place.scale);
  }

  move(rows, cols) {
    this.place.row += rows;
    this.place.col += cols;
    this.fitted = false;
    this.moved();
  }

  moved() {
    this.clamp();
    this.draw();
    this.onview();
  }

  clamp() {
    const { scale } = this.place;
    for (const [axis, name, length] of [[0, "row", this.canvas.height], [1, "col", this.canvas.width]]) {
      const span = length / scale, size = this.size[axis];
      this.place[name] = span >= size ? (size - span) / 2 : Math.min(Math.max(this.place[name], 0), size - span);
    }
  }

  // The part in view, as the server takes it.
  view() {
    const { row, col, scale } = this.place, { width, height } = this.canvas;
    const r0 = Math.max(Math.floor(row), 0), c0 = Math.max(Math.floor(col), 0);
    const rows = Math.min(Math.ceil(row + height / scale), this.size[0]) - r0;
    const cols = Math.min(Math.ceil(col + width / scale), this.size[1]) - c0;
    return {
      row: r0, col: c0, rows: Math.max(rows, 1), cols: Math.max(cols, 1),
      height: Math.max(Math.min(Math.ceil(rows * scale), 4096), 16), width: Math.max(Math.min(Math.ceil(cols * scale), 4096), 16),
      regions: this.regions, developed: this.layer === "developed", mean: true, dn: true,
    };
  }

  show(data) {
    this.data = data;
    this.paint();
    this.draw();
  }

  setLayer(layer, overlay) {
    const again = layer === "developed" ? !this.data?.rgba || overlay && !this.data.dn : layer === "raw" ? !this.data?.dn : !this.data?.mean;
    this.layer = layer;
    this.overlay = overlay;
    if (again) this.onview();
    else if (this.data) {
      this.paint();
      this.draw();
    }
  }

  // The factor that makes the bright parts of the developed picture nearly white; 1 where it has none.
  brightening() {
    const { rgba } = this.data ?? {};
    if (!rgba || this.layer !== "developed") return 1;
    const counts = new Uint32Array(256);
    for (let k = 0; k < rgba.length; k += 4) counts[Math.max(rgba[k], rgba[k + 1], rgba[k + 2])]++;
    let code = 255;
    for (let above = counts[255]; code > 1 && above < rgba.length / 4 / 200; above += counts[code]) code--;
    const share = code / 255;
    return 0.9 / (share > 0.04045 ? ((share + 0.055) / 1.055) ** 2.4 : share / 12.92);
  }

  paint() {
    const { header, dn, mean, rgba } = this.data, { rows, cols } = header;
    if (this.image.width !== cols || this.image.height !== rows) {
      this.image.width = cols;
      this.image.height = rows;
    }
    const context = this.image.getContext("2d");
    if (this.layer === "developed" && rgba && !(this.overlay && dn)) {
      context.putImageData(new ImageData(rgba, cols, rows), 0, 0);
      return;
    }
    const picture = context.createImageData(cols, rows), out = picture.data;
    const white = header.white_level_dn, tile = header.cfa, layer = (this.layer === "developed" ? rgba : this.layer === "raw" || mean) ? this.layer : "raw";
    if (layer === "raw" && !dn) return; // it follows
    const channelAt = tile.map((line) => line.map((name) => "RGB".indexOf(name)));
    const snr = layer === "snr" ? snrLookup(header.snr) : null;
    const colors = snr ? Array.from({ length: 256 }, (_, k) => viridis(k / 255)) : null;
    for (let r = 0, k = 0; r < rows; r++) {
      const line = channelAt[r % tile.length];
      for (let c = 0; c < cols; c++, k++) {
        const o = 4 * k;
        out[o + 3] = 255;
        if (layer === "developed") {
          out[o] = rgba[o]; out[o + 1] = rgba[o + 1]; out[o + 2] = rgba[o + 2];
        } else if (layer === "snr") {
          const color = colors[Math.round(255 * Math.min(Math.max((snr(mean[k]) - SNR_RANGE[0]) / (SNR_RANGE[1] - SNR_RANGE[0]), 0), 1))];
          out[o] = color[0]; out[o + 1] = color[1]; out[o + 2] = color[2];
        } else {
          const share = layer === "raw" ? dn[k] / white : mean[k] / header.saturation_e;
          const value = gamma[Math.round(1024 * Math.min(Math.max(share, 0), 1))];
          const channel = layer === "raw" ? line[c % line.length] : -1;
          if (channel < 0) out[o] = out[o + 1] = out[o + 2] = value;
          else out[o + channel] = value;
        }
        if (this.overlay && dn && dn[k] >= white) { out[o] = 255; out[o + 1] = 0; out[o + 2] = 220; }
      }
    }
    context.putImageData(picture, 0, 0);
  }

  draw() {
    const context = this.canvas.getContext("2d"), { width, height } = this.canvas;
    context.fillStyle = "#000";
    context.fillRect(0, 0, width, height);
    if (!this.place) return;
    const { row, col, scale } = this.place;
    if (this.data) {
      const { header } = this.data, size = header.step * scale;
      context.imageSmoothingEnabled = size < 1;
      context.drawImage(this.image, (header.col - col) * scale, (header.row - row) * scale, header.cols * size, header.rows * size);
      if (scale >= 32 && header.step === 1) this.drawNumbers(context);
    }
    context.lineWidth = 2;
    context.font = "bold 13px system-ui, sans-serif";
    const boxes = this.drawing ? [...this.regions, this.drawing] : this.regions;
    boxes.forEach(([r0, r1, c0, c1], number) => {
      const box = [(c0 - col) * scale, (r0 - row) * scale, (c1 - c0) * scale, (r1 - r0) * scale];
      context.strokeStyle = "#000";
      context.strokeRect(...box);
      context.setLineDash([5, 4]);
      context.strokeStyle = "#ffd24d";
      context.strokeRect(...box);
      context.setLineDash([]);
      if (number < this.regions.length) {
        context.fillStyle = "#000";
        context.fillRect(box[0], box[1] - 17, 17, 17);
        context.fillStyle = "#ffd24d";
        context.fillText(String(number + 1), box[0] + 4, box[1] - 4);
      }
    });
  }

  drawNumbers(context) {
    const { header, dn } = this.data, { row, col, scale } = this.place;
    context.font = `${Math.min(scale / 3.6, 13)}px system-ui, sans-serif`;
    context.textAlign = "center";
    for (let r = 0; r < header.rows; r++) for (let c = 0; c < header.cols; c++) {
      const x = (header.col + c + 0.5 - col) * scale, y = (header.row + r + 0.5 - row) * scale + 4;
      if (x < -scale || y < -scale || x > this.canvas.width + scale || y > this.canvas.height + scale) continue;
      const text = String(Math.round(dn[r * header.cols + c]));
      context.strokeStyle = "#000";
      context.lineWidth = 3;
      context.strokeText(text, x, y);
      context.fillStyle = "#fff";
      context.fillText(text, x, y);
    }
    context.textAlign = "start";
  }

  // The pixel of the frame at a place of the canvas, with what is known of it.
  pixel(x, y) {
    if (!this.data?.dn || !this.place) return null;
    const { header, dn, mean } = this.data, { row, col, scale } = this.place;
    const index = (at, first, length) => { const k = Math.floor((at - first) / header.step); return k >= 0 && k < length ? k : -1; };
    const i = index(row + y / scale, header.row, header.rows), j = index(col + x / scale, header.col, header.cols);
    if (i < 0 || j < 0) return null;
    return {
      row: header.row + i * header.step, col: header.col + j * header.step, step: header.step,
      channel: header.cfa[i % header.cfa.length][j % header.cfa[0].length],
      dn: dn[i * header.cols + j], mean: mean ? mean[i * header.cols + j] : null,
      electrons: electronsOf(dn[i * header.cols + j], header.response),
    };
  }

  listen() {
    const { canvas } = this;
    let start = null;
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      return [(event.clientX - box.left) * canvas.width / box.width, (event.clientY - box.top) * canvas.height / box.height];
    };
    const cell = ([x, y]) => [
      Math.min(Math.max(Math.floor(this.place.row + y / this.place.scale), 0), this.size[0] - 1),
      Math.min(Math.max(Math.floor(this.place.col + x / this.place.scale), 0), this.size[1] - 1),
    ];
    const point = () => this.place && this.onpoint(this.pixel(canvas.width / 2, canvas.height / 2), this.shareAt(canvas.width / 2, canvas.height / 2));
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.place || event.button) return;
      canvas.setPointerCapture(event.pointerId);
      start = { point: at(event), cell: cell(at(event)), row: this.place.row, col: this.place.col };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!this.place) return;
      const point = at(event);
      this.onpoint(this.pixel(...point), this.shareAt(...point));
      if (!start) return;
      if (this.mode === "region" || event.shiftKey) {
        const [a, b] = [start.cell, cell(point)];
        this.drawing = [Math.min(a[0], b[0]), Math.max(a[0], b[0]) + 1, Math.min(a[1], b[1]), Math.max(a[1], b[1]) + 1];
        this.draw();
      } else {
        this.place.row = start.row - (point[1] - start.point[1]) / this.place.scale;
        this.place.col = start.col - (point[0] - start.point[0]) / this.place.scale;
        this.fitted = false;
        this.moved();
      }
    });
    canvas.addEventListener("pointerup", () => {
      if (this.drawing) this.onregion(this.drawing);
      this.drawing = start = null;
    });
    canvas.addEventListener("wheel", (event) => {
      if (!this.place) return;
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 400), ...at(event));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      if (!this.place || event.ctrlKey || event.metaKey || event.altKey) return;
      const part = 0.1 / this.place.scale, keys = {
        ArrowUp: () => this.move(-part * canvas.height, 0), ArrowDown: () => this.move(part * canvas.height, 0),
        ArrowLeft: () => this.move(0, -part * canvas.width), ArrowRight: () => this.move(0, part * canvas.width),
        "+": () => this.zoom(1.5), "=": () => this.zoom(1.5), "-": () => this.zoom(1 / 1.5), 0: () => this.fit(), 1: () => this.one(),
      };
      if (!keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
      point();
    });
    canvas.addEventListener("focus", point);
  }
}

// The electrons of a digital number: linear between the entries of the response, and beyond its ends.
function electronsOf(dn, { dn: numbers, electrons }) {
  if (numbers.length < 2) return NaN;
  let k = numbers.findIndex((each) => each > dn);
  k = k < 0 ? numbers.length - 2 : Math.min(Math.max(k - 1, 0), numbers.length - 2);
  return electrons[k] + (dn - numbers[k]) * (electrons[k + 1] - electrons[k]) / (numbers[k + 1] - numbers[k]);
}

// The key of the SNR map.
export function snrLegend() {
  const bar = document.createElement("canvas");
  bar.width = 192;
  bar.height = 1;
  bar.setAttribute("aria-hidden", "true");
  const context = bar.getContext("2d");
  for (let k = 0; k < 192; k++) { context.fillStyle = `rgb(${viridis(k / 191).join(",")})`; context.fillRect(k, 0, 1, 1); }
  return [`SNR ${SNR_RANGE[0]} dB`, bar, `${SNR_RANGE[1]} dB`];
}

function snrLookup(snr) {
  const { signal_e: signal, snr_db: ratio } = snr;
  if (!signal.length) return () => NaN;
  const low = Math.log(signal[0]), step = (Math.log(signal[signal.length - 1]) - low) / (signal.length - 1);
  return (electrons) => {
    if (!(electrons > 0)) return -99;
    const at = (Math.log(electrons) - low) / step, k = Math.min(Math.max(Math.floor(at), 0), signal.length - 2);
    return ratio[k] + Math.min(at - k, 1) * (ratio[k + 1] - ratio[k]);
  };
}

export function describe(pixel) {
  if (!pixel) return "Point at the picture to read a pixel.";
  const place = pixel.step === 1 ? `Row ${pixel.row}, column ${pixel.col}` : `Mean of ${pixel.step} × ${pixel.step} pixels at row ${pixel.row}, column ${pixel.col}`;
  const text = `${place}, ${pixel.channel}: ${short(pixel.dn, 5)} DN = ${short(pixel.electrons, 4)} e⁻ above black`;
  return pixel.mean === null ? text : `${text}; mean from light ${short(pixel.mean, 4)} e⁻`;
}
