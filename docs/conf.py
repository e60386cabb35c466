"""Sphinx configuration. `make docs` builds the site into docs/_build/html."""

from __future__ import annotations

import photosite

project = "photosite"
author = "The photosite developers"
copyright = "2026, The photosite developers"
version = release = photosite.__version__

extensions = ["myst_nb", "sphinx_copybutton"]
exclude_patterns = ["_build"]
language = "en"

html_theme = "furo"
html_title = f"photosite {release}"

myst_enable_extensions = ["attrs_block", "colon_fence", "deflist"]
myst_heading_anchors = 4

nb_execution_mode = "cache"
nb_execution_cache_path = "_build/notebooks"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

copybutton_exclude = ".linenos, .gp, .go"
