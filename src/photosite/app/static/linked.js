// Pictures side by side that show the same part of their frames.

import { finished, post, postForBytes, remove, showError, tab } from "./api.js";
import { element } from "./dom.js";
import { Picture, decode, describe, snrLegend } from "./picture.js";

const IDLE_MS = 600;
const LAYERS = [["developed", "developed picture"], ["raw", "raw mosaic"], ["mean", "mean electrons"], ["snr", "SNR map"]];
const KEYS = "The pictures move and zoom together. Arrow keys move, + and − zoom, 0 fits the frame, 1 shows single pixels. The mouse wheel zooms.";

const running = new Set(); // jobs, which end with the page
window.addEventListener("pagehide", () => { for (const id of running) fetch(`/api/jobs/${id}`, { method: "DELETE", keepalive: true }); });

export class LinkedPictures {
  // `layers` is false for pictures that are given, not simulated.
  constructor(name, { layers = true, onlayer = () => {} } = {}) {
    this.name = name;
    this.panels = [];
    this.layer = "developed";
    const button = (text, label, act) => element("button", { type: "button", "aria-label": /^\w/.test(text) ? null : label, title: label, onclick: () => this.panels.length && act(this.panels[0].picture) }, text);
    this.select = element("select", { onchange: () => { this.setLayer(this.select.value); onlayer(this.layer); } },
      ...LAYERS.map(([value, text]) => element("option", { value }, text)));
    this.legend = element("div", { class: "legend", hidden: true }, ...snrLegend());
    this.grid = element("div", { class: "pictures" });
    this.root = element("div", {},
      element("div", { class: "toolbar", role: "group", "aria-label": name },
        layers ? element("label", {}, "Show ", this.select) : null,
        element("span", { class: "buttons" },
          button("−", "Zoom out", (picture) => picture.zoom(1 / 1.5)), button("+", "Zoom in", (picture) => picture.zoom(1.5)),
          button("Fit", "Fit the frame", (picture) => picture.fit()), button("1 : 1", "Single pixels at their size", (picture) => picture.one()))),
      this.legend, this.grid, element("p", { class: "hint", id: `${name.replaceAll(" ", "-")}-keys` }, KEYS));
  }

  setLayer(layer) {
    this.layer = this.select.value = layer;
    this.legend.hidden = layer !== "snr";
    for (const panel of this.panels) panel.picture.setLayer(layer, false);
  }

  // Shows one picture for each of [{label, state}], or of [{label, data}] for given ones.
  show(sources) {
    while (this.panels.length > sources.length) this.panels.pop().close();
    sources.forEach((source, number) => {
      this.panels[number] ??= new Panel(this, number);
      this.panels[number].set(source);
    });
    this.grid.replaceChildren(...this.panels.map((panel) => panel.root));
  }

  moved(panel) {
    const share = panel.picture.share();
    for (const other of this.panels) {
      if (other !== panel && other.known) { other.picture.follow(share); other.request(); }
    }
  }

  pointed(panel, at) {
    for (const each of this.panels) each.describe(each === panel || at === null ? at : { y: at.y, x: at.x });
  }
}

class Panel {
  constructor(group, number) {
    this.group = group;
    this.tab = `${tab}-${number}`;
    this.canvas = element("canvas", { tabindex: "0", role: "img", "aria-label": "Picture", "aria-describedby": `${group.name.replaceAll(" ", "-")}-keys` });
    this.title = element("h3", {});
    this.badge = element("span", { class: "badge" }, "starting");
    this.note = element("span", { class: "hint" });
    this.readout = element("p", { class: "readout" });
    this.root = element("figure", {}, this.title, element("div", { class: "frame" }, this.canvas), element("p", { class: "status" }, this.badge, " ", this.note), this.readout);
    this.picture = new Picture(this.canvas, {
      onview: () => { this.request(); if (this.known) group.moved(this); },
      onregion: () => { this.picture.draw(); },
      onpoint: (pixel, at) => group.pointed(this, at ?? null),
    });
    this.picture.layer = group.layer;
  }

  set({ label, state = null, data = null }) {
    const text = JSON.stringify(state);
    this.title.textContent = this.label = label;
    if (data) {
      this.badge.hidden = this.known = true;
      this.picture.setFrame(data.header.rows * data.header.step, data.header.cols * data.header.step);
      this.picture.show(data);
      this.canvas.setAttribute("aria-label", label);
      return;
    }
    if (text === this.text) return;
    this.text = text;
    this.state = state;
    this.cancel();
    this.request();
    clearTimeout(this.idle);
    this.idle = setTimeout(() => this.exact(), IDLE_MS);
  }

  async request() {
    if (!this.state) return;
    if (this.inFlight) { this.again = true; return; }
    this.inFlight = true;
    const text = this.text;
    try {
      const view = this.known ? this.picture.view() : { height: Math.max(this.canvas.height, 16), width: Math.max(this.canvas.width, 16) };
      const data = decode(await postForBytes("/api/view", { state: this.state, view, tab: this.tab }));
      if (text === this.text) this.shown(data);
    } catch (error) {
      this.badge.className = "badge";
      this.badge.textContent = "no picture";
      this.note.textContent = error.message;
    }
    this.inFlight = false;
    if (this.again) { this.again = false; this.request(); }
  }

  shown(data) {
    const { header } = data, [rows, cols] = this.picture.size, resized = !this.known || rows !== header.frame_rows || cols !== header.frame_cols;
    const other = this.group.panels.find((panel) => panel !== this && panel.known);
    this.known = true;
    this.picture.setFrame(header.frame_rows, header.frame_cols);
    if (resized && other && !other.picture.fitted) {
      this.picture.follow(other.picture.share());
      this.again = true;
    }
    this.picture.show(data);
    this.badge.className = `badge ${header.exact ? "exact" : "preview"}`;
    this.badge.textContent = header.exact ? "exact frame" : "preview";
    const saturated = header.saturated_fraction > 0 ? `, ${(100 * header.saturated_fraction).toPrecision(2)} % saturated` : "";
    this.note.textContent = `${header.frame_rows} × ${header.frame_cols} pixels${saturated}`;
    this.canvas.setAttribute("aria-label", `${this.label}: ${this.group.select.selectedOptions[0].textContent} of ${header.scene}, ${header.exact ? "exact" : "preview"}`);
  }

  describe(at) {
    const { picture } = this;
    if (!this.known || !this.state) return;
    const pixel = at && picture.pixel((at.x * picture.size[1] - picture.place.col) * picture.place.scale, (at.y * picture.size[0] - picture.place.row) * picture.place.scale);
    this.readout.textContent = pixel ? describe(pixel) : "";
  }

  async exact() {
    let mine;
    try {
      mine = await post("/api/frames", { state: this.state, tab: this.tab });
    } catch { return; } // the preview has said what is wrong
    this.job = mine;
    running.add(mine.id);
    const ended = await finished(mine).catch((error) => ({ status: "failed", error: error.message }));
    running.delete(mine.id);
    if (this.job?.id !== mine.id) return;
    this.job = null;
    if (ended.status === "failed") showError(`The exact frame of ${this.label} could not be computed: ${ended.error}`);
    if (ended.status === "done") this.request();
  }

  cancel() {
    const running = this.job;
    this.job = null;
    clearTimeout(this.idle);
    if (running) remove(`/api/jobs/${running.id}`).catch(() => {});
  }

  close() {
    this.cancel();
    this.state = null;
  }
}
