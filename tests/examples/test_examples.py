"""The example scripts: short, complete in the gallery, and running."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
SCRIPTS = {path.stem: path for path in sorted((ROOT / "examples").glob("*.py")) if path.stem != "drawing"}
GALLERY = ROOT / "docs" / "gallery"


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS.keys())
def test_an_example_is_short_and_described(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert ast.get_docstring(ast.parse(text))


def test_the_gallery_shows_every_example() -> None:
    page = (GALLERY / "README.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"\(\.\./\.\./examples/(\w+)\.py\)", page)) == sorted(SCRIPTS)
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", page)
    drawn = {re.search(r'save\(.*"([^"]+)"\)', path.read_text(encoding="utf-8")) for path in SCRIPTS.values()}
    assert sorted(pictures) == sorted(match[1] for match in drawn if match)
    assert {file.name for file in GALLERY.iterdir()} == {"README.md", *pictures}
    assert sum(file.stat().st_size for file in GALLERY.iterdir()) < 4e6
    for name in pictures:
        with Image.open(GALLERY / name) as picture:
            assert 400 < picture.width <= 1250


@pytest.mark.parametrize("name", ["color_charts", "low_pass_filter"])
def test_an_example_draws_its_picture(name: str, tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    command = [sys.executable, str(SCRIPTS[name]), "--output", str(tmp_path / "new")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    (picture,) = (tmp_path / "new").iterdir()
    assert done.stdout.strip() == str(picture)
    with Image.open(picture) as drawn:
        assert len(drawn.convert("RGB").getcolors(1 << 20) or []) > 100
