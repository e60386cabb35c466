// Rows of the form that consist of others: sections, tables, lists and entries by name, as a sensor file has them.

import { dropped } from "./drop.js";
import { element } from "./dom.js";
import { fieldRow } from "./fields.js";
import { plot } from "./plots.js";

const STYLES = { R: "s1", G: "s2", B: "s0", M: "s0" };
const MOST_TEXT = 1 << 20;
let count = 0;

const numberOf = (value) => (value !== null && typeof value === "object" && "value" in value ? value.value : value);
const clone = (value) => structuredClone(value ?? null);

// A row for any field. `changed` gets the new value; null for a part that is switched off or an empty field.
export function partRow(field, value, changed, options = {}) {
  const make = { section, list, entries, table, matrix, numbers, choices }[field.kind];
  return make ? make(field, value, changed, options) : fieldRow(field, numberOf(value), changed);
}

const hint = (field) => (field.description ? element("p", { class: "hint" }, field.description) : null);

function section(field, value, changed, options) {
  const body = element("div", { class: "inner" }), rows = new Map();
  let own = clone(value);
  const visible = () => {
    for (const each of field.fields) {
      const applies = ([name, values]) => values.includes(own[name] ?? field.fields.find((other) => other.name === name).value);
      rows.get(each.name).hidden = !Object.entries(each.only ?? {}).every(applies);
    }
  };
  const patch = (part) => {
    own = { ...own, ...part };
    for (const name of Object.keys(own)) if (own[name] === null) delete own[name];
    visible();
    changed(own);
  };
  const build = () => {
    rows.clear();
    body.replaceChildren();
    if (own === null) return;
    for (const each of field.fields) {
      const row = each.kind === "table" ? table(each, own, patch, options) : partRow(each, own[each.name] ?? each.value, (next) => patch({ [each.name]: next }), options);
      rows.set(each.name, row);
      body.append(row);
    }
    visible();
  };
  build();
  if (!field.optional) {
    own ??= {};
    build();
    return element("fieldset", { class: "part" }, element("legend", {}, field.label), body);
  }
  const box = element("input", { type: "checkbox", id: `part-${++count}`, "data-part": field.name, "aria-describedby": field.description ? `part-${count}-hint` : null });
  box.checked = own !== null;
  const row = element("div", { class: "row effect" }, element("div", { class: "label" }, element("label", { class: "name", for: box.id }, field.label), box),
    field.description ? element("p", { class: "hint", id: `${box.id}-hint` }, field.description) : null, body);
  box.addEventListener("change", () => {
    own = box.checked ? clone(field.value ?? field.example ?? {}) : null;
    build();
    changed(own);
  });
  return row;
}

function list(field, value, changed, options) {
  const root = element("fieldset", { class: "part" }), inner = { kind: "section", fields: field.fields, optional: false };
  let own = clone(value) ?? [];
  const build = () => {
    const rows = own.map((each, k) => element("div", { class: "row" },
      section({ ...inner, name: field.name, label: `${field.label} ${k + 1}` }, each, (next) => { own = own.with(k, next); changed(own); }, options),
      element("button", { type: "button", "aria-label": `Remove ${field.label} ${k + 1}`, onclick: () => { own = own.toSpliced(k, 1); changed(own); build(); } }, "Remove")));
    const add = element("button", { type: "button", "aria-label": `Add to ${field.label}`, onclick: () => {
      own = [...own, clone(field.example?.at(-1) ?? {})];
      changed(own);
      build();
      root.querySelector(":scope > button")?.focus();
    } }, "Add");
    root.replaceChildren(element("legend", {}, field.label), ...[hint(field)].filter(Boolean), ...rows, add);
  };
  build();
  return root;
}

function entries(field, value, changed, options) {
  const [item] = field.fields, root = element("fieldset", { class: "part" }), curves = element("div");
  let own = clone(value) ?? {};
  const tabular = item.kind === "section" ? item.fields.find((each) => each.kind === "table") : null;
  const draw = () => {
    if (!tabular) return;
    const [grid, column] = tabular.fields;
    plot(curves, {
      title: `${column.label} of ${Object.keys(own).join(", ")}`,
      lines: Object.entries(own).map(([name, each], k) => ({ name, x: each[grid.name] ?? [], y: each[column.name] ?? [], style: STYLES[name] ?? `s${(k + 3) % 8}` })),
      x: { label: axis(grid) }, y: { label: axis(column), low: 0 },
    });
  };
  const build = () => {
    const rows = Object.keys(own).map((name) => element("details", { class: "entry-of" }, element("summary", {}, name),
      partRow({ ...item, name, label: name, optional: false }, own[name], (next) => { own = { ...own, [name]: next }; draw(); changed(own); }, { ...options, plain: true }),
      element("button", { type: "button", "aria-label": `Remove ${name} of ${field.label}`, onclick: () => { const { [name]: _, ...rest } = own; own = rest; changed(Object.keys(own).length || !field.optional ? own : null); build(); } }, "Remove")));
    const name = element("input", { type: "text", "aria-label": `Name of a new entry of ${field.label}`, size: 6 });
    const missing = field.keys.find((key) => !(key in own));
    name.value = missing ?? "";
    const add = element("button", { type: "button", "aria-label": `Add an entry to ${field.label}`, onclick: () => {
      const key = name.value.trim();
      if (!key || key in own) { name.focus(); return; }
      const first = Object.values(own)[0] ?? Object.values(field.example ?? {})[0];
      own = { ...own, [key]: clone(first ?? (item.kind === "section" ? {} : 0)) };
      changed(own);
      build();
    } }, "Add");
    root.replaceChildren(element("legend", {}, field.label), ...[hint(field)].filter(Boolean), ...(tabular ? [curves] : []), ...rows, element("div", { class: "label" }, name, add));
    draw();
  };
  build();
  return root;
}

const axis = (field) => (field.unit ? `${field.label} (${field.unit})` : field.label);

// Text with numbers: a message for each problem, and the value for `changed` where there is none.
function textRow(field, box, describe, parse, changed) {
  const problem = element("p", { class: "problem", id: `${box.id}-problem`, role: "alert", hidden: true });
  box.setAttribute("aria-describedby", `${box.id}-hint ${problem.id}`);
  const read = () => {
    try {
      const value = parse(box.value);
      problem.hidden = true;
      box.removeAttribute("aria-invalid");
      changed(value);
    } catch (error) {
      problem.textContent = error.message;
      problem.hidden = false;
      box.setAttribute("aria-invalid", "true");
    }
  };
  box.addEventListener("change", read);
  return [element("p", { class: "hint", id: `${box.id}-hint` }, describe), problem, read];
}

function lines(text) {
  const rows = text.split(/\r?\n/).map((line) => line.trim().split(/[\s,;]+/).filter(Boolean)).filter((row) => row.length);
  while (rows.length && !Number.isFinite(Number(rows[0][0]))) rows.shift(); // headings
  return rows.map((row, k) => row.map((text) => {
    const found = Number(text);
    if (!Number.isFinite(found)) throw new Error(`Line ${k + 1}: "${text}" is not a number.`);
    return found;
  }));
}

const joined = (row) => row.map((each) => String(numberOf(each))).join(" ");

function numbers(field, value, changed) {
  const box = element("input", { type: "text", id: `part-${++count}`, class: "wide" });
  box.value = Array.isArray(value) ? joined(value) : value ?? "";
  const what = `${field.description} ${field.choices.length ? `${field.choices.join(" or ")}, or numbers` : "Numbers"} with spaces between them.`.trim();
  const [about, problem] = textRow(field, box, what, (text) => {
    if (!text.trim()) { if (field.optional) return null; throw new Error("Enter one number or more."); }
    if (field.choices.includes(text.trim())) return text.trim();
    return lines(text).flat();
  }, changed);
  return element("div", { class: "row" }, element("label", { class: "name", for: box.id }, axis(field)), box, about, problem);
}

function matrix(field, value, changed) {
  const box = element("textarea", { id: `part-${++count}`, rows: 4, spellcheck: "false" });
  box.value = (value ?? []).map(joined).join("\n");
  const [about, problem] = textRow(field, box, `${field.description} One line for each row, spaces between numbers.`.trim(), (text) => {
    const rows = lines(text);
    if (!rows.length) { if (field.optional) return null; throw new Error("Enter one number or more."); }
    if (rows.some((row) => row.length !== rows[0].length)) throw new Error("All lines must have as many numbers as the first.");
    return rows;
  }, changed);
  return element("div", { class: "row" }, element("label", { class: "name", for: box.id }, axis(field)), box, about, problem);
}

// Columns of a section over its grid. `value` is the section; `patch` gets all columns.
function table(field, value, patch, { plain = false } = {}) {
  const [grid, ...columns] = field.fields, box = element("textarea", { id: `part-${++count}`, rows: 7, spellcheck: "false" });
  const names = (column) => (Array.isArray(value[column.name]) || !column.keys.length || value[column.name] === undefined ? [null] : Object.keys(value[column.name]));
  const shown = columns.filter((column) => value[column.name] !== undefined && value[column.name] !== null);
  const cells = shown.flatMap((column) => names(column).map((key) => (key === null ? value[column.name] : value[column.name][key])));
  const rows = value[grid.name] ? value[grid.name].map((at, k) => [at, ...cells.map((cell) => cell[k])]) : cells.length ? [cells.map((cell) => (Array.isArray(cell) ? cell[0] : cell))] : [];
  box.value = rows.map(joined).join("\n");
  box.rows = Math.min(Math.max(rows.length + 1, 2), 7);
  const keyed = columns.find((column) => column.keys.length > 1), curve = element("div");
  const draw = (found) => {
    const x = found[grid.name];
    curve.replaceChildren();
    if (plain || !x) return;
    const column = columns[0], y = found[column.name];
    const of = Array.isArray(y) ? [[column.label, y]] : Object.entries(y ?? {});
    plot(curve, { title: `${column.label} over ${grid.label.toLowerCase()}`, lines: of.map(([name, each]) => ({ name, x, y: each, style: STYLES[name] })), x: { label: axis(grid) }, y: { label: axis(column) } });
  };
  const parse = (text) => {
    const found = lines(text), most = 1 + columns.length, least = 1 + columns.filter((column) => !column.optional).length;
    const made = Object.fromEntries([grid, ...columns].map((column) => [column.name, null]));
    if (!found.length) { if (field.optional && columns.every((column) => column.optional)) return made; throw new Error("Enter one line or more."); }
    if (found.length === 1 && found[0].length === 1 && grid.optional) return { ...made, [columns[0].name]: [found[0][0]] };
    const wide = keyed && found[0].length === 1 + keyed.keys.length;
    found.forEach((row, k) => {
      if (row.length !== found[0].length) throw new Error(`Line ${k + 1} has ${row.length} numbers, the first has ${found[0].length}.`);
      if (!wide && (row.length < Math.max(least, 2) || row.length > most)) throw new Error(`Each line needs ${[grid, ...columns.filter((column) => !column.optional)].map((column) => column.label.toLowerCase()).join(" and ")}; line ${k + 1} has ${row.length} ${row.length === 1 ? "number" : "numbers"}.`);
    });
    const column = (k) => found.map((row) => row[k]);
    made[grid.name] = column(0);
    if (wide) made[keyed.name] = Object.fromEntries(keyed.keys.map((key, k) => [key, column(k + 1)]));
    else columns.slice(0, found[0].length - 1).forEach((each, k) => { made[each.name] = column(k + 1); });
    return made;
  };
  const heads = [grid, ...columns.filter((column) => !column.optional || shown.includes(column))].map(axis).join(", ");
  const more = columns.filter((column) => column.optional && !shown.includes(column)).map((column) => column.label.toLowerCase());
  const text = `A line each: ${heads}${more.length ? `; ${more.join(", ")} if known` : ""}.${grid.optional ? " One number alone holds everywhere." : ""}${keyed ? ` One column for all channels, or one each for ${keyed.keys.join(", ")}.` : ""} Paste from a spreadsheet, or drop a CSV file.`;
  const [about, problem, read] = textRow(field, box, text, parse, (found) => { draw(found); patch(found); });
  draw(value);
  dropped(box, async ([file]) => {
    if (file.size > MOST_TEXT) { problem.textContent = `${file.name} is larger than a table can be.`; problem.hidden = false; return; }
    box.value = (await file.text()).trim();
    read();
  });
  return element("div", { class: "row always" }, element("label", { class: "name", for: box.id }, `${field.label}${field.unit ? ` (${field.unit})` : ""}, table`), box, about, problem, curve);
}

function choices(field, value, changed) {
  let own = new Set(value ?? []);
  return element("fieldset", { class: "part" }, element("legend", {}, field.label), ...field.choices.map((choice) => {
    const box = element("input", { type: "checkbox", onchange: () => { own[box.checked ? "add" : "delete"](choice); changed(field.choices.filter((each) => own.has(each))); } });
    box.checked = own.has(choice);
    return element("label", { class: "choice" }, box, ` ${choice.replaceAll("_", " ")}`);
  }));
}
