"""`photosite develop` and `photosite validate`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.cli.main import run


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A chart twice under the same light, and once under a tenth more."""
    folder = tmp_path_factory.mktemp("shots")
    for name, seed, luminance in (("a", 1, 40), ("b", 2, 40), ("brighter", 3, 44)):
        size = ["--rows", "264", "--cols", "392", "--black-level", "64"]
        shot = ["--seed", str(seed), "--luminance", str(luminance), "-o", str(folder / f"{name}.dng")]
        assert run(["simulate", *size, *shot]) == 0
    return folder


@pytest.mark.parametrize("depth", [8, 16])
def test_develop_is_what_the_library_gives(photosite: Any, shots: Path, tmp_path: Path, depth: int) -> None:
    done = photosite("develop", shots / "a.dng", "-o", tmp_path / "a.png", "--depth", depth, "--json")
    assert (done.status, done.json["depth"]) == (0, depth)
    picture = ps.develop(ps.read_raw(shots / "a.dng"))
    with Image.open(tmp_path / "a.png") as image:
        # Pillow cuts 16-bit color to its upper 8 bits.
        expected = np.rint(picture * (2**depth - 1)).astype(int) >> (depth - 8)
        np.testing.assert_array_equal(np.asarray(image), expected)


def test_white_balance_gains(photosite: Any, shots: Path, tmp_path: Path) -> None:
    options = ("--white-balance", "2,1,1.5", "--brightness", "0.5")
    photosite("develop", shots / "a.dng", "-o", tmp_path / "a.png", *options)
    picture = ps.develop(ps.read_raw(shots / "a.dng"), white_balance=[2, 1, 1.5], exposure=0.5)
    with Image.open(tmp_path / "a.png") as image:
        np.testing.assert_array_equal(np.asarray(image), np.rint(picture * 255))


def test_files_without_the_lights_white_are_balanced_by_gray_world(photosite: Any, shots: Path, tmp_path: Path) -> None:
    """Which balance was used is in the JSON; the one that was not asked for is said."""
    frame = ps.read_raw(shots / "a.dng")
    unknown = {name: value for name, value in frame.metadata.items() if name != "as_shot_neutral"}
    replace(frame, metadata=unknown).save(tmp_path / "unknown.tif")
    for file, used, lines in ((shots / "a.dng", "as-shot", 0), (tmp_path / "unknown.tif", "gray-world", 1)):
        done = photosite("develop", file, "-o", tmp_path / f"{used}.png", "--json")
        assert (done.json["white_balance"], done.err.count("\n")) == (used, lines)
    with Image.open(tmp_path / "gray-world.png") as image:
        expected = ps.develop(frame, white_balance="gray-world")
        np.testing.assert_array_equal(np.asarray(image), np.rint(expected * 255))


@pytest.mark.smoke("validate")
def test_frames_of_one_light_agree(photosite: Any, shots: Path) -> None:
    # One chip: its fixed pattern is common to both frames, so the verdict errs on the side of agreeing.
    done = photosite("validate", shots / "a.dng", shots / "b.dng", "--json")
    assert (done.status, done.json["agrees"], done.err) == (0, True, "")
    assert len(done.json["patches"]) == 24


def test_frames_of_different_light_differ(photosite: Any, shots: Path, tmp_path: Path) -> None:
    done = photosite("validate", shots / "brighter.dng", shots / "a.dng")
    assert done.status == 0
    assert done.out.startswith("measured and simulated differ\n")
    assert "white" in done.out


def test_folders_are_series(photosite: Any, shots: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        for shot in "ab":
            (tmp_path / name / f"{shot}.dng").write_bytes((shots / f"{shot}.dng").read_bytes())
    assert photosite("validate", tmp_path / "one", tmp_path / "two", "--json").json["measured"]["frames"] == 2
