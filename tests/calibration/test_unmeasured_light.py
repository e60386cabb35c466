"""Flat fields of one exposure time whose light nobody measured: the listing's levels give gain, noise and PRNU."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from tests.helpers.diagnosed import limits

import photosite as ps

GAIN, READ_E, PRNU = 0.25, 5.0, 0.01
ELECTRONS = np.geomspace(400.0, 12_000.0, 8)


class Chip:
    """A chip of 96 x 128 pixels in plain NumPy."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.response = 1.0 + self.rng.normal(0.0, PRNU, (96, 128))
        self.offset = 100.0 + self.rng.normal(0.0, 0.5, (96, 128))

    def frames(self, electrons: float, count: int) -> np.ndarray:
        """Return (count, rows, cols) digital numbers."""
        shape = (count, *self.response.shape)
        signal = self.rng.poisson(electrons * self.response, shape) + self.rng.normal(0.0, READ_E, shape)
        return np.clip(np.rint(self.offset + GAIN * signal), 0, 4095).astype(np.uint16)


def write(path: Path, dn: np.ndarray) -> None:
    """Write a frame, or a stack of frames, as a TIFF file."""
    tifffile.imwrite(path, dn, photometric="minisblack")


def check(found: ps.Calibration) -> None:
    """Compare gain, read noise and PRNU, each within 3.9 standard uncertainties (1 in 10 000), and what is withheld."""
    for name, truth in (("system_gain_dn_per_e", GAIN), ("read_noise_e", READ_E), ("prnu_percent", 100.0 * PRNU)):
        entry = getattr(found, name)
        assert abs(entry.value - truth) < 3.9 * entry.standard_uncertainty + (name[0] == "p") * 100 * PRNU / 150, name
    assert found.linearity_error_percent.reason_id == "unmeasured-light"
    assert not {"wrong-light", "wrong-light-levels", "other-offsets"} & set(limits(found))


def stacks(folder: Path, seed: int) -> None:
    """Write a stack of dark frames, and one of flat fields for each level."""
    chip = Chip(seed)
    write(folder / "dark_10ms.tif", chip.frames(0.0, 20))
    for number, electrons in enumerate(ELECTRONS):
        write(folder / f"flat_level{number}_10ms.tif", chip.frames(electrons, 4))


def test_each_stack_is_a_level(tmp_path: Path) -> None:
    stacks(tmp_path, 1)
    check(ps.calibrate(ps.open_frames(tmp_path, bits=12)))


def test_each_entry_of_a_protocol_is_a_level(tmp_path: Path) -> None:
    stacks(tmp_path, 2)
    lines = ["photosite_protocol: 1", "bits: 12", "frames:", "- {kind: dark, exposure: 0.01, files: dark_10ms.tif}"]
    lines += [f"- {{kind: light, exposure: 0.01, files: flat_level{n}_10ms.tif}}" for n in range(len(ELECTRONS))]
    (tmp_path / "protocol.yaml").write_text("\n".join(lines))
    check(ps.calibrate(ps.open_frames(tmp_path / "protocol.yaml")))


def test_each_folder_and_each_name_without_its_number_is_a_level(tmp_path: Path) -> None:
    chip = Chip(3)
    (tmp_path / "dark_10ms").mkdir()
    for number, dn in enumerate(chip.frames(0.0, 20)):
        write(tmp_path / "dark_10ms" / f"{number:03d}.tif", dn)
    for level, electrons in enumerate(ELECTRONS):
        folder = tmp_path / f"flat_10ms_{'abcd'[level // 2]}"
        folder.mkdir(exist_ok=True)
        for number, dn in enumerate(chip.frames(electrons, 3)):
            write(folder / f"{'dim' if level % 2 else 'bright'}_{number:03d}.tif", dn)
    check(ps.calibrate(ps.open_frames(tmp_path, bits=12)))


def test_levels_differ_above_the_black_level(tmp_path: Path) -> None:
    """Signals of 4 to 20 DN on 1000 DN: the means differ by less than 2 %, and the light by a factor of 5."""
    chip = Chip(8)
    chip.offset += 900.0
    write(tmp_path / "dark_10ms.tif", chip.frames(0.0, 20))
    for number, electrons in enumerate(np.linspace(16.0, 80.0, 5)):
        write(tmp_path / f"flat_level{number}_10ms.tif", chip.frames(electrons, 8))
    found = ps.calibrate(ps.open_frames(tmp_path, bits=12))
    assert found.linear_range["M"].abscissa == "signal_dn"
    gain = found.system_gain_dn_per_e
    assert abs(gain.value - GAIN) < 3.9 * gain.standard_uncertainty < 0.2 * GAIN


def test_two_levels_give_a_gain(tmp_path: Path) -> None:
    chip = Chip(4)
    write(tmp_path / "dark_10ms.tif", chip.frames(0.0, 20))
    for name, electrons in (("a", 3000.0), ("b", 9000.0)):
        write(tmp_path / f"flat_{name}_10ms.tif", chip.frames(electrons, 4))
    found = ps.calibrate(ps.open_frames(tmp_path, bits=12)).system_gain_dn_per_e
    assert abs(found.value - GAIN) < 3.9 * found.standard_uncertainty < 0.05 * GAIN


def test_a_hundred_levels_of_two_frames(tmp_path: Path) -> None:
    chip = Chip(5)
    write(tmp_path / "dark_10ms.tif", chip.frames(0.0, 20))
    for number, electrons in enumerate(np.geomspace(200.0, 12_000.0, 100)):
        write(tmp_path / f"flat_l{number:03d}x_10ms.tif", chip.frames(electrons, 2))
    found = ps.calibrate(ps.open_frames(tmp_path, bits=12))
    check(found)
    assert found.system_gain_dn_per_e.standard_uncertainty < 0.002 * GAIN


@pytest.mark.parametrize("name", ["{:03d}_flat_10ms", "flat_10ms_{:03d}"])
def test_numbered_frames_of_one_light_are_one_level(tmp_path: Path, name: str) -> None:
    chip = Chip(6)
    write(tmp_path / "dark_10ms.tif", chip.frames(0.0, 20))
    for number, dn in enumerate(chip.frames(9000.0, 6)):
        write(tmp_path / f"{name.format(number)}.tif", dn)
    lights = ps.open_frames(tmp_path, bits=12).of_kind("light")
    assert [(len(group), group.level) for group in lights] == [(6, None)]


def test_levels_of_the_same_light_keep_the_exposure_time_as_their_light(tmp_path: Path) -> None:
    """Two series of flat fields, of two times; the first of each is listed by itself."""
    chip = Chip(7)
    for t in (10, 20, 40):
        write(tmp_path / f"dark_{t}ms.tif", chip.frames(0.0, 8))
        for name in "ab":
            write(tmp_path / f"flat_{name}_{t}ms.tif", chip.frames(250.0 * t, 4))
    found = ps.calibrate(ps.open_frames(tmp_path, bits=12))
    assert found.linear_range["M"].abscissa == "exposure_s"
    assert "unmeasured-light" not in limits(found)
