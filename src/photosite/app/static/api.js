// Calls of the server. Every error becomes an Error with the server's text.

export const tab = crypto.randomUUID();
export const UPLOADED = "photosite-uploaded", DELETED = "photosite-deleted"; // events; that of a deletion has the name of the upload

const alertBox = document.getElementById("alert");

// A text with `of` is removed by another one only, or by an empty one that names the same or nothing.
export function showError(text, of = "") {
  if (!text && of && alertBox.dataset.of !== of) return;
  alertBox.textContent = text || "";
  alertBox.dataset.of = of;
  alertBox.hidden = !text;
}

async function answer(path, options) {
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Error("The server does not answer. Is photosite serve still running?");
  }
  if (response.ok) return response;
  let text = `${response.status} ${response.statusText}`;
  try {
    text = (await response.json()).error || text;
  } catch { /* no JSON */ }
  throw Object.assign(new Error(text), { status: response.status });
}

const posted = (content) => ({
  method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(content),
});

export const get = async (path) => (await answer(path, {})).json();
export const post = async (path, content) => (await answer(path, posted(content))).json();
export const postForBytes = async (path, content) => (await answer(path, posted(content))).arrayBuffer();
export const remove = (path) => answer(path, { method: "DELETE" });

// `folder` and `name` are those of a frame of an uploaded folder.
export async function upload(file, kind, { folder = "", name = file.name } = {}) {
  const path = `/api/uploads?kind=${kind}&name=${encodeURIComponent(name)}&folder=${encodeURIComponent(folder)}`;
  const found = await (await answer(path, { method: "POST", body: file })).json();
  window.dispatchEvent(new Event(UPLOADED));
  return found;
}

// A function that says how far a job is, and how long the rest of what it does now takes at the speed so far.
export function progressReporter() {
  let what = null, since = 0, before = 0;
  return (job) => {
    if (job.status === "queued") return "waits for a free process";
    const now = performance.now();
    if (what !== job.what) [what, since, before] = [job.what, now, job.done];
    const spent = (now - since) / 1000, left = job.done > before ? spent * (job.total - job.done) / (job.done - before) : 0;
    const rest = spent > 1 && left > 2 ? `, about ${Math.ceil(left)} s more` : "";
    return `${what || "computing"}${job.total > 1 ? ` ${job.done} of ${job.total}` : ""}, ${Math.round(job.seconds)} s${rest}`;
  };
}

// Waits for a job; `report` gets each state of it. Returns the job when it has ended.
export async function finished(job, report = () => {}) {
  let wait = 80;
  while (job.status === "queued" || job.status === "running") {
    report(job);
    await new Promise((resolve) => setTimeout(resolve, wait));
    wait = Math.min(wait * 1.3, 400);
    job = await get(`/api/jobs/${job.id}`);
  }
  return job;
}
