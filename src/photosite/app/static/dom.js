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

const SUPERSCRIPTS = { "-": "⁻", ...Object.fromEntries([..."⁰¹²³⁴⁵⁶⁷⁸⁹"].entries()) };

// A number with a few digits, as a person writes it.
export function short(value, digits = 4) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-3) {
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
    const power = `10${[...String(Number(exponent))].map((each) => SUPERSCRIPTS[each]).join("")}`;
    return Number(mantissa) === 1 ? power : `${Number(mantissa)} × ${power}`;
  }
  return String(Number(value.toPrecision(size >= 10 ** digits ? Math.ceil(Math.log10(size)) : digits)));
}

// A number of bytes, as a person writes it.
export function sizeText(bytes) {
  const [unit, size] = [["GB", 1e9], ["MB", 1e6], ["kB", 1e3], ["bytes", 1]].find(([, each]) => bytes >= each || each === 1);
  return `${short(bytes / size, 3)} ${unit}`;
}

const captionOf = (text) => element("caption", {}, element("span", {}, text));

// A table of texts or elements; an object {content, class} gives a cell its class. The class "stacked" makes each row a
// block of labelled values on narrow screens, where elements lose the roles of a table unless they are explicit.
export function table(caption, head, rows, attributes = {}) {
  const cell = (each, k) => {
    const { content, ...own } = each?.content === undefined ? { content: each } : each;
    return k === 0 ? element("th", { scope: "row", role: "rowheader", ...own }, content) : element("td", { role: "cell", "data-label": head[k], ...own }, content);
  };
  return element("table", { role: "table", ...attributes }, captionOf(caption),
    element("thead", { role: "rowgroup" }, element("tr", { role: "row" }, ...head.map((text) => element("th", { scope: "col", role: "columnheader" }, text)))),
    element("tbody", { role: "rowgroup" }, ...rows.map((row) => element("tr", { role: "row" }, ...row.map(cell)))));
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
