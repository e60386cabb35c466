"""The example scripts: short, described, and running."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

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


@pytest.mark.parametrize("name", ["color_charts", "low_pass_filter"])
def test_an_example_draws_its_pictures(name: str) -> None:
    # What sphinx-gallery would save: all open figures at the end of the script.
    program = (
        "import runpy, sys, matplotlib.pyplot as plt\n"
        "runpy.run_path(sys.argv[1])\n"
        "for number in plt.get_fignums():\n"
        "    plt.figure(number).canvas.draw()\n"
        "    print(len(set(bytes(plt.figure(number).canvas.buffer_rgba())[::97])))\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT / "examples")])}
    environment["MPLBACKEND"] = "Agg"
    command = [sys.executable, "-W", "ignore", "-c", program, str(SCRIPTS[name])]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert [int(count) > 100 for count in done.stdout.split()] == [True]
