// Small helpers to build elements. Text is always set as text, never as markup.

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key === "class") made.className = value;
    else if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// A number with a few digits, as a person writes it.
export function short(value, digits = 4) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-3) return value.toExponential(digits - 1).replace(/\.?0+e/, "e").replace("e+", "e");
  return String(Number(value.toPrecision(size >= 10 ** digits ? Math.ceil(Math.log10(size)) : digits)));
}

export const captionOf = (text) => element("caption", {}, element("span", {}, text));

// Cells can be texts or elements; an element of a cell of its own, td, is taken as it is.
export function table(caption, head, rows, attributes = {}) {
  return element("table", attributes,
    captionOf(caption),
    element("thead", {}, element("tr", {}, ...head.map((text) => element("th", { scope: "col" }, text)))),
    element("tbody", {}, ...rows.map((row) => element("tr", {}, ...row.map((cell, k) =>
      k === 0 ? element("th", { scope: "row" }, cell) : cell instanceof HTMLTableCellElement ? cell : element("td", {}, cell))))));
}

export async function copied(title, text, note = "") {
  const dialog = document.getElementById("code");
  let done = true;
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    done = false;
  }
  document.getElementById("code-title").textContent = done ? `${title} copied` : `${title}: select and copy`;
  document.getElementById("code-note").textContent = note;
  document.getElementById("code-text").textContent = text;
  dialog.showModal();
}
