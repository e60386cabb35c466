"""`photosite explain`."""

from __future__ import annotations

from typing import Any

import pytest


@pytest.mark.smoke("explain")
def test_an_entry_and_the_list(photosite: Any) -> None:
    listed = photosite("explain", "--json").json
    entry = photosite("explain", "unsteady-light", "--json").json
    assert entry["severity"] == listed["unsteady-light"]["severity"]
    assert "unsteady-light" in photosite("explain", "unsteady-light").out
    assert photosite("explain", "unsteady").status == 2
