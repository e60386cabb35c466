"""EMVA descriptors written: what comes back when they are read, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.frames.frame_set import frame_set_from_arrays
from photosite.frames.io.emva_write import write_descriptor

EXPOSURES = (1 / 8000, 1 / 3, 0.01, 1e-5, 30.0, 0.1 + 1e-16)


def measurement(photons=True):
    rng = np.random.default_rng(2)
    frames = []
    for exposure_s in EXPOSURES:
        for kind, light in (("dark", 0.0), ("light", 1234.567 * exposure_s)):
            for _ in range(2):
                dn = rng.integers(0, 4096, (5, 7)).astype(np.uint16)
                frames.append((kind, exposure_s, dn, light) if photons else (kind, exposure_s, dn))
    return frame_set_from_arrays(frames, bits=12)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_round_trip(tmp_path, suffix):
    written = measurement()
    path = write_descriptor(written, tmp_path / "set", suffix=suffix)
    again = ps.open_frames(path)
    assert (again.rows, again.cols, again.bits, again.frame_count) == (5, 7, 12, written.frame_count)
    for before, after in zip(written.groups, again.groups, strict=True):
        assert (after.kind, after.exposure_s) == (before.kind, before.exposure_s)
        assert after.photons_per_pixel == before.photons_per_pixel
        for one, other in zip(before, after, strict=True):
            np.testing.assert_array_equal(one, other)


def test_lines_are_the_standards(tmp_path):
    path = write_descriptor(measurement(), tmp_path / "set")
    lines = path.read_text().splitlines()
    assert lines[:2] == ["v 4.0", "n 12 7 5"]
    assert lines[2] == "d 10000.0"
    assert lines[3] == r"i images\d0_0000.png"
    with Image.open(tmp_path / "set" / "images" / "d0_0000.png") as image:
        assert image.mode == "I;16"


def test_photons_are_not_guessed(tmp_path):
    with pytest.raises(InputError, match="light frames at 1e-05 s do not; say photons_per_pixel"):
        write_descriptor(measurement(photons=False), tmp_path / "set")
    assert not (tmp_path / "set").exists()


def test_one_gain_setting(tmp_path):
    dn = np.zeros((2, 2), np.uint16)
    two = frame_set_from_arrays([("dark", 0.1, dn, 0.0, 100.0), ("dark", 0.1, dn, 0.0, 200.0)], bits=8)
    with pytest.raises(InputError, match="one gain setting, and there are 100, 200"):
        write_descriptor(two, tmp_path / "set")


def test_a_full_folder_is_not_touched(tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "mine.txt").write_text("mine")
    with pytest.raises(FileError, match="not an empty folder"):
        write_descriptor(measurement(), tmp_path / "set")
    assert [p.name for p in (tmp_path / "set").iterdir()] == ["mine.txt"]
