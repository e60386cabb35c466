"""The example scripts: short, described, and running."""

from __future__ import annotations

import ast
import importlib
import runpy
import sys
import warnings
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = {path.stem: path for path in sorted((ROOT / "examples").glob("*.py")) if path.stem != "drawing"}


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS.keys())
def test_an_example_is_short_and_has_a_title_and_a_caption(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 85
    title, underline, blank, *caption = (ast.get_docstring(ast.parse(text)) or "").splitlines()
    assert underline == "=" * len(title)
    assert not blank
    assert len(" ".join(caption)) > 80


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS.keys())
def test_what_an_example_imports_exists(script: Path) -> None:
    for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("photosite"):
            module = importlib.import_module(node.module or "")
            assert [name.name for name in node.names if not hasattr(module, name.name)] == []


@pytest.mark.parametrize("name", ["color_charts", "low_pass_filter"])
def test_an_example_draws_its_pictures(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "examples")
    with matplotlib.rc_context(), warnings.catch_warnings():
        plt.switch_backend("Agg")
        plt.close("all")
        warnings.simplefilter("ignore")
        try:
            runpy.run_path(str(SCRIPTS[name]))
            # What sphinx-gallery would save: all open figures at the end of the script.
            (figure,) = map(plt.figure, plt.get_fignums())
            figure.canvas.draw()
            assert len(set(bytes(figure.canvas.buffer_rgba())[::97])) > 100
        finally:
            plt.close("all")
            sys.modules.pop("drawing", None)
