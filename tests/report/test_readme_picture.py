from __future__ import annotations

from pathlib import Path

from PIL import Image

from photosite.studies.readme_picture import write_readme_picture


def test_picture_is_small_and_made_again_alike(tmp_path: Path) -> None:
    for name in ("one.png", "two.png"):
        write_readme_picture(tmp_path / name, rows=264, cols=392)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert (tmp_path / "one.png").stat().st_size < 300_000
    assert Image.open(tmp_path / "one.png").width > 1000
