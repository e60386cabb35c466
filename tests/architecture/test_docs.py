"""The maps of the code in docs name files that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("page", ["development/contributing.md", "theory/model.md", "development/design-notes.md"])
def test_files_that_a_page_names_exist(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w./-]+\.(?:py|yaml))`", text)) - {"tests/scene/io/test_NAME.py"}
    folders = ROOT / "src" / "photosite", ROOT
    missing = sorted(name for name in named if not any((folder / name).exists() for folder in folders))
    assert not missing
    linked = {link.partition("#")[0] for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link}
    assert not [link for link in linked if link and not (ROOT / "docs" / page).parent.joinpath(link).exists()]
