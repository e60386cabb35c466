// Views, appearance, and the state in the link.

import { showError } from "./api.js";
import * as calibrate from "./calibrate.js";
import * as camera from "./camera.js";
import * as compare from "./compare.js";
import * as plan from "./plan.js";
import * as quality from "./quality.js";
import * as sweep from "./sweep.js";
import { fromHash, merged } from "./state.js";
import "./uploads.js";

const VIEWS = { camera: null, calibrate, compare, plan, sweep, quality };
const root = document.documentElement, appearance = document.getElementById("appearance");
const APPEARANCES = ["system", "light", "dark"];

function setAppearance(name) {
  if (name === "system") delete root.dataset.appearance;
  else root.dataset.appearance = name;
  appearance.textContent = `Appearance: ${name}`;
  appearance.setAttribute("aria-label", `Appearance: ${name}. Change`);
  try { localStorage.setItem("photosite-appearance", name); } catch { /* private mode */ }
}

appearance.addEventListener("click", () => {
  const now = root.dataset.appearance ?? "system";
  setAppearance(APPEARANCES[(APPEARANCES.indexOf(now) + 1) % 3]);
});
try { setAppearance(localStorage.getItem("photosite-appearance") ?? "system"); } catch { setAppearance("system"); }

const links = new Map();
for (const link of document.querySelectorAll("nav a")) links.set(link.dataset.view, link);
let started = false, shown = null;

async function route(byHand) {
  const { view, content } = fromHash(location.hash), name = view in VIEWS ? view : "camera";
  showError("");
  if (name !== shown && shown !== null) window.scrollTo(0, 0);
  shown = name;
  for (const [each, link] of links) {
    if (each === name) link.setAttribute("aria-current", "page"); else link.removeAttribute("aria-current");
    document.getElementById(`view-${each}`).hidden = each !== name;
  }
  document.title = `${links.get(name).textContent} – photosite workbench`;
  try {
    if (name !== "camera") await VIEWS[name].show(content);
    else if (!started) { started = true; await camera.start(content); }
    else if (content && JSON.stringify(merged(content)) !== JSON.stringify(camera.state)) await camera.restore(content);
  } catch (error) { showError(error.message); }
  if (byHand) document.getElementById("main").focus({ preventScroll: true });
}

document.getElementById("code-close").addEventListener("click", () => document.getElementById("code").close());
window.addEventListener("hashchange", () => route(true));
route(false);
