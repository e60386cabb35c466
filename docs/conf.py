"""Sphinx configuration. `make docs` builds the site into docs/_build/html."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import click
from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html import HTML5Translator

import photosite
from photosite.cli.main import COMMANDS

HERE = Path(__file__).parent
for name in ("charts", "illuminants", "lights", "pictures", "render", "scenes"):
    sys.modules[f"photosite.{name}"] = getattr(photosite, name)  # pages name photosite.charts.macbeth
os.environ["PATH"] = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])  # notebooks run photosite

project = "photosite"
author = "The photosite developers"
copyright = "2026, The photosite developers"
version = release = photosite.__version__
language = "en"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = [
    "_build",
    "gallery/*.ipynb",
    "gallery/*.py",
    "reference/diagnostics/*",
    "howto/image-quality/*",
    "validation/image-quality-coverage.md",
    "validation/coverage-tables.md",
]
templates_path = ["_templates"]
smartquotes = False  # -- begins an option
default_role = "code"  # docstrings write names in single backticks

html_theme = "furo"
html_title = f"photosite {release}"
html_copy_source = False
html_math_renderer = "mathml"  # browsers set it without scripts

# Pages in Markdown, and notebooks

myst_enable_extensions = ["attrs_block", "colon_fence", "deflist"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / "notebooks")
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_in_temp = True
nb_merge_streams = True
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# The reference from docstrings

autosummary_generate = True
autodoc_typehints = "none"  # docstrings state types with units and shapes
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_param = False

# The gallery

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"drawing\.py$|training",
    "reset_modules": (),  # drawing.py sets the style of all figures
    "backreferences_dir": "reference/examples",
    "doc_module": ("photosite",),
    "download_all_examples": False,
    "show_signature": False,
    "capture_repr": (),
    "show_memory": False,
    "min_reported_time": 10_000,
    "remove_config_comments": True,
    "plot_gallery": "True",
}

# The reference of the commands


def write_command_pages(app: Sphinx) -> None:
    """Write a page for each command; existing pages with the same text stay as they are."""
    folder = HERE / "reference" / "commands"
    folder.mkdir(exist_ok=True)
    for name in COMMANDS:
        module = "import_" if name == "import" else name
        text = f".. click:: photosite.cli.{module}:command\n   :prog: photosite {name}\n   :nested: full\n"
        page = folder / f"{name}.rst"
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def write_diagnostics_page(app: Sphinx) -> None:
    """Write the entries of the registry of diagnostics, which docs/reference/diagnostics.md includes."""
    from photosite.calibration.diagnostics import detection_entry, diagnostic_kinds
    from photosite.calibration.parameters import PARAMETER_LABELS

    lines = []
    for kind in diagnostic_kinds().values():
        figures = kind.concerns(PARAMETER_LABELS)
        every = len(figures) == len(PARAMETER_LABELS)
        named = {"Figures": "all" if every else ", ".join(f"`{name}`" for name in figures)} if figures else {}
        lines += [f"({kind.id})=", f"## {kind.id}", "", f"*{kind.severity}*", ""]
        entry = kind.entry | detection_entry(kind) | named
        lines += [f"- **{heading}:** {text}" for heading, text in entry.items()] + [""]
    page = Path(app.srcdir, "reference", "diagnostics", "entries.md")
    page.parent.mkdir(exist_ok=True)
    text = "\n".join(lines)
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def write_measurements_page(app: Sphinx) -> None:
    """Write the registry of measurements, which docs/howto/image-quality.md includes."""
    from photosite.metrics.registry import measurements

    lines = []
    for entry in measurements().values():
        charts = ", ".join(f"`{name}`" for name in entry.charts) or "any"
        options = ", ".join(f"`{name}={field.default}`" for name, field in entry.options.model_fields.items())
        lines += [f"### {entry.title}", "", f"`{entry.id}`, {entry.standard}. Charts: {charts}.", ""]
        lines += ["| value | unit | definition |", "|---|---|---|"]
        lines += [f"| `{name}` | {each.unit} | {each.definition} |" for name, each in entry.quantities.items()] + [""]
        lines += [f"- **Options:** {options}"] if options else []
        lines += [f"- **Compared with:** {entry.oracle}"]
        lines += [f"- **Left out:** {entry.left_out}"] if entry.left_out else []
        lines += [""]
    page = Path(app.srcdir, "howto", "image-quality", "entries.md")
    page.parent.mkdir(exist_ok=True)
    text = "\n".join(lines)
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def as_plain_text(app: Sphinx, context: click.Context, lines: list[str]) -> None:
    """Escape what reStructuredText would read as markup, except code in backticks; show examples as code."""
    outside_backticks = re.compile(r"([*|_\\])(?=[^`]*(?:`[^`]*`[^`]*)*$)")
    plain: list[str] = []
    for line in lines:
        if line.startswith("Example: "):
            plain += [".. code-block:: shell", "", f"    {line.removeprefix('Example: ')}", ""]
        elif line.lstrip().startswith((".. ", ":")):
            plain.append(line)
        else:
            required, text = re.fullmatch(r"(\s*\*\*Required\*\* ?|)(.*)", line).groups()
            plain.append(required + outside_backticks.sub(r"\\\1", text))
    lines[:] = plain


def write_math(translator: HTML5Translator, node: nodes.math | nodes.math_block) -> None:
    """Write LaTeX as MathML."""
    block = isinstance(node, nodes.math_block)
    mathml = convert(node.astext(), display="block" if block else "inline")
    translator.body.append(f'<div class="math">{mathml}</div>\n' if block else mathml)
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Connect the functions above."""
    app.add_html_math_renderer("mathml", inline_renderers=(write_math, None), block_renderers=(write_math, None))
    app.connect("builder-inited", write_command_pages, priority=100)
    app.connect("builder-inited", write_diagnostics_page, priority=100)
    app.connect("builder-inited", write_measurements_page, priority=100)
    for part in ("description", "options", "arguments", "epilog"):
        app.connect(f"sphinx-click-process-{part}", as_plain_text)
