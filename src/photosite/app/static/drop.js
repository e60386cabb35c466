// Files that a person drops on a part of the page.

// `taken` gets the list of files; with `folders`, the entries of the file system, which can be folders.
export function dropped(target, taken, { folders = false } = {}) {
  let depth = 0;
  const mark = (over) => target.classList.toggle("drop", over);
  const holdsFiles = (event) => [...event.dataTransfer.types].includes("Files");
  target.addEventListener("dragenter", (event) => {
    if (!holdsFiles(event)) return;
    event.preventDefault();
    event.stopPropagation();
    depth += 1;
    mark(true);
  });
  target.addEventListener("dragover", (event) => {
    if (!holdsFiles(event)) return;
    event.preventDefault();
    event.stopPropagation();
    event.dataTransfer.dropEffect = "copy";
  });
  target.addEventListener("dragleave", () => {
    depth = Math.max(depth - 1, 0);
    if (!depth) mark(false);
  });
  target.addEventListener("drop", (event) => {
    if (!holdsFiles(event)) return;
    event.preventDefault();
    event.stopPropagation();
    depth = 0;
    mark(false);
    const entries = folders ? [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean) : [];
    if (entries.length) taken(entries);
    else if (event.dataTransfer.files.length) taken([...event.dataTransfer.files]);
  });
}

// A file beside all of these must not replace the page.
for (const name of ["dragover", "drop"]) window.addEventListener(name, (event) => event.preventDefault());
