// What the views with a job share: a button that runs it, progress, cancel, and the code.

import { finished, post, progressReporter, remove, showError, tab } from "./api.js";
import { copied, element } from "./dom.js";
import { toHash } from "./state.js";

// What is wrong with the first invalid field of a view, which gets the focus; nothing is computed with an older value.
function problem(root) {
  const box = [...root.querySelectorAll(":is(input, select):invalid")].find((each) => each.checkVisibility());
  if (!box) return "";
  box.focus();
  const label = box.getAttribute("aria-label") ?? box.closest("label").firstChild.textContent;
  return `${label.trim()}: ${box.title || box.validationMessage}`;
}

// `content` is what the link restores; by default the request.
export function jobBar(name, view, request, shown, label = "Compute", content = request) {
  let job = null;
  const text = element("span", { class: "hint", role: "status" });
  const stop = element("button", { type: "button", hidden: true, onclick: () => job && remove(`/api/jobs/${job.id}`).catch(() => {}) }, "Cancel");
  const run = element("button", { type: "button", class: "primary", onclick: () => start() }, label);
  const code = async (kind) => {
    try {
      const found = (await post(`/api/${name}/code`, request()))[kind];
      if (found) await copied(kind === "python" ? "Python" : "Command", found);
      else showError("No single command does this. Copy it as Python.");
    } catch (error) { showError(error.message); }
  };
  async function start() {
    const wrong = problem(document.getElementById(`view-${view}`));
    showError(wrong);
    if (wrong) return;
    history.replaceState(null, "", toHash(view, content()));
    let mine;
    try {
      mine = job = await post(`/api/${name}?tab=${tab}`, request());
    } catch (error) { showError(error.message); return; }
    run.disabled = true;
    stop.hidden = false;
    const progress = progressReporter();
    const ended = await finished(mine, (now) => {
      if (job.id !== mine.id) return;
      text.textContent = progress(now);
    }).catch((error) => ({ status: "failed", error: error.message }));
    if (job.id !== mine.id) return;
    run.disabled = false;
    stop.hidden = true;
    text.textContent = { done: `computed in ${ended.seconds?.toFixed(1)} s`, failed: "failed", cancelled: "cancelled" }[ended.status];
    if (ended.status === "failed") showError(ended.error);
    if (ended.status === "done") shown(ended.result);
  }
  const bar = element("div", { class: "toolbar" }, run, stop,
    element("button", { type: "button", onclick: () => code("python") }, "Copy as Python"),
    element("button", { type: "button", onclick: () => code("command") }, "Copy as command"),
    element("button", { type: "button", onclick: () => copied("Link", location.origin + "/" + toHash(view, content()), "The link restores these settings on this server, in a browser that has opened it.") }, "Copy link"), text);
  return { bar, start };
}

export function field(label, unit, attributes, value, changed) {
  const box = element("input", { step: "any", required: true, ...attributes });
  box.value = value;
  box.addEventListener("change", () => {
    if (box.validity.valid && box.value !== "") changed(box.type === "number" ? Number(box.value) : box.value.trim());
  });
  return element("label", {}, unit ? `${label} (${unit})` : label, box);
}
