"""`photosite optics trace`: a singlet into an optics file and a page, or the reason without rayoptics."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

import photosite as ps

TABLE = """# f_number: 8
# fields_deg: 0, 5
# wavelengths_nm: 550
radius_mm, thickness_mm, glass, stop
50, 4, 1.5, 1
inf, 97.333, , 0
"""


@pytest.mark.smoke("optics trace")
def test_a_singlet(photosite: Any, tmp_path: Path) -> None:
    """A plano-convex lens of 50 mm and n = 1.5 has 100 mm, by the lensmaker's formula."""
    lens, output, page = tmp_path / "lens.csv", tmp_path / "lens.optics.yaml", tmp_path / "lens.html"
    lens.write_text(TABLE)
    done = photosite("optics", "trace", lens, "-o", output, "--page", page, "--fields", 2, "--json")
    if importlib.util.find_spec("rayoptics") is None:
        assert done.status == 2
        assert "needs rayoptics, which is missing. Run pip install" in done.err
        assert not output.exists()
        return
    assert done.json["focal_length_mm"] == pytest.approx(100, rel=1e-9)
    assert [row["field_deg"] for row in done.json["fields"]] == [0, 5]
    assert ps.load_optics(output).base.f_number == pytest.approx(8, rel=1e-9)
    assert "Distortion, relative to f tan(angle), and relative illumination" in page.read_text()
