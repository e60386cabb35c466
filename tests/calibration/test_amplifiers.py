"""Amplifiers that FITS files name: each has its gain and noise, and the chip has the mean gain."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps

fits = pytest.importorskip("astropy.io.fits")

ROWS, COLS = 96, 64
READ_E, DARK_E_PER_S, QE = 5.0, 20.0, 0.5
QUADRANTS = {"A": (0.25, 64.0), "B": (0.35, 74.0), "C": (0.30, 60.0), "D": (0.27, 70.0)}


def write(folder: Path, amplifiers: dict[str, tuple[float, float]], seed: int, columns: tuple[int, ...] = ()) -> Path:
    """Write dark frames and flat fields, a unit for each amplifier: two in a row, or four in two.

    `columns` are the widths of the amplifiers, `COLS` by default.
    """
    rng = np.random.default_rng(seed)
    wide = columns or (COLS,) * len(amplifiers)
    response = [1.0 + rng.normal(0.0, 0.01, (ROWS, width)) for width in wide]
    offset = [rng.normal(0.0, 2.0, (ROWS, width)) for width in wide]
    for kind, times, count in (("dark", (0.001, 2.0, 8.0), 6), ("flat", np.linspace(0.02, 0.3, 10), 4)):
        for t in times:
            for number in range(count):
                units: list[Any] = [fits.PrimaryHDU()]
                units[0].header.update(EXPTIME=float(t), IMAGETYP=kind)
                for k, (name, (gain, black)) in enumerate(amplifiers.items()):
                    light = 30_000.0 * t * response[k] if kind == "flat" else 0.0
                    electrons = rng.poisson(light + DARK_E_PER_S * t, (ROWS, wide[k])) + offset[k]
                    electrons = electrons + READ_E * rng.normal(size=electrons.shape)
                    dn = np.clip(np.rint(black + gain * electrons), 0, 4095).astype(np.uint16)
                    row, left = (k // 2, k % 2 * COLS) if len(amplifiers) == 4 else (0, sum(wide[:k]))
                    unit = fits.ImageHDU(dn, name=name)
                    place = f"[{left + 1}:{left + wide[k]},{row * ROWS + 1}:{(row + 1) * ROWS}]"
                    unit.header["DETSEC"] = place
                    units.append(unit)
                fits.HDUList(units).writeto(folder / f"{kind}_{t:.4f}_{number}.fits")
    return folder


@pytest.fixture(scope="module")
def quadrants(tmp_path_factory: pytest.TempPathFactory) -> ps.Calibration:
    return ps.calibrate(ps.open_frames(write(tmp_path_factory.mktemp("quadrants"), QUADRANTS, 1), bits=12))


def near(entry: Any, truth: float) -> None:
    """Fail beyond 3.9 standard uncertainties: 1 in 10 000."""
    assert abs(entry.value - truth) < 3.9 * entry.standard_uncertainty


def test_each_amplifier_has_its_gain_noise_and_black_level(quadrants: ps.Calibration) -> None:
    found = quadrants
    assert list(found.amplifiers) == list(QUADRANTS)
    for name, (gain, black) in QUADRANTS.items():
        own = found.amplifiers[name].parameters
        near(own.system_gain_dn_per_e, gain)
        near(own.read_noise_e, READ_E)
        near(own.black_level_dn, black)
    assert found.amplifiers["D"].region.shape == (ROWS, COLS)
    assert found.to_dict()["amplifiers"]["D"]["rows"] == [ROWS, 2 * ROWS]


def test_no_pixel_beside_the_step_between_amplifiers_is_defective(tmp_path: Path) -> None:
    """A step of 170 DN, 65 times the noise: the surface through the medians of blocks leaves it."""
    found = ps.calibrate(ps.open_frames(write(tmp_path, {"A": (0.25, 64.0), "B": (0.35, 234.0)}, 3), bits=12))
    assert not [entry for entry in found.diagnostics if entry.id == "defective-pixels"]


def test_the_chip_has_the_mean_gain(quadrants: ps.Calibration) -> None:
    """The gain of all pixels together, which the standard's block keeps, is 1.6 % higher, 5 standard uncertainties."""
    found, gains = quadrants, np.array([gain for gain, _ in QUADRANTS.values()])
    gain = found.system_gain_dn_per_e
    near(gain, gains.mean())
    assert gain.standard_uncertainty < 0.004 * gains.mean()
    near(found.read_noise_e, READ_E)
    near(found.dark_current_e_per_s, DARK_E_PER_S)
    near(found.dark_current_from_variance_e_per_s, DARK_E_PER_S)
    near(found.emva1288["K"], (gains**2).mean() / gains.mean())
    assert limits(found)["amplifier-gains"] == pytest.approx(0.1 / gains.mean(), rel=0.02)


def test_the_sensor_file_has_the_amplifiers(quadrants: ps.Calibration) -> None:
    """Gains and offsets of the quadrants; the offset of a channel is in front of its gain."""
    channels = quadrants.readout_channels
    assert channels is not None
    assert (channels.arrangement, channels.shape) == ("blocks", (2, 2))
    gains = np.array([[0.25, 0.35], [0.30, 0.27]])
    blacks = np.array([[64.0, 74.0], [60.0, 70.0]])
    relative, offsets = channels.tables()
    assert np.allclose(relative, gains / gains.mean(), atol=0.004)
    assert np.allclose(offsets, (blacks - blacks.mean()) / gains, atol=0.3)


def test_nonuniformity_is_that_within_the_amplifiers(quadrants: ps.Calibration) -> None:
    """Pixels of 1 % PRNU and 2 electrons of DSNU; all amplifiers together have 13 % and 18 electrons."""
    found = quadrants.pixel_nonuniformity
    near(found["prnu_percent"], 1.0)
    near(found["dsnu_e"], 2.0)
    near(found["dsnu_dn"], 2.0 * 0.2925)
    near(found["dcnu_percent"], 0.0)
    assert quadrants.prnu_percent.value > 12.0
    assert quadrants.emva1288["DSNU1288"].value > 15.0
    entries = quadrants.to_dict()["readout_channels"]
    assert entries["prnu_within_channels_percent"]["value"] == found["prnu_percent"].value


def test_amplifiers_of_equal_gain_and_other_offsets(tmp_path: Path) -> None:
    """Five in a row: no halves or quadrants."""
    blacks = (64.0, 80.0, 70.0, 90.0)
    names = {name: (0.3, black) for name, black in zip(("A1", "A2", "A3", "A4", "A5"), (*blacks, 75.0), strict=True)}
    found = ps.calibrate(ps.open_frames(write(tmp_path, names, 5, columns=(32,) * 5), bits=12))
    channels = found.readout_channels
    assert channels is not None
    assert (channels.shape, channels.relative_gain) == ((1, 5), None)
    expected = (np.array([*blacks, 75.0]) - np.mean([*blacks, 75.0])) / 0.3
    assert np.allclose(channels.tables()[1][0], expected, atol=0.5)
    near(found.pixel_nonuniformity["dsnu_e"], 2.0)
    assert found.dsnu_dn.value > 8.0


def test_equal_amplifiers_leave_the_gain_as_it_is(tmp_path: Path) -> None:
    """The result is that of the same frames without the names of the parts."""
    frames = ps.open_frames(write(tmp_path, {"A": (0.3, 64.0), "B": (0.3, 64.0)}, 2), bits=12)
    found = ps.calibrate(frames)
    assert list(found.amplifiers) == ["A", "B"]
    assert "amplifier-gains" not in limits(found)
    plain = ps.calibrate(replace(frames, amplifiers=()))
    assert found.system_gain_dn_per_e == plain.system_gain_dn_per_e
    assert not plain.amplifiers


def test_unequal_parts_are_reported_and_weighted_by_their_pixels(tmp_path: Path) -> None:
    """A sensor file cannot hold parts of 64 and 32 columns."""
    amplifiers = {"WIDE": (0.25, 64.0), "NARROW": (0.35, 64.0)}
    found = ps.calibrate(ps.open_frames(write(tmp_path, amplifiers, 3, columns=(64, 32)), bits=12))
    near(found.system_gain_dn_per_e, (2.0 * 0.25 + 0.35) / 3.0)
    near(found.amplifiers["NARROW"].parameters.system_gain_dn_per_e, 0.35)
    assert found.readout_channels is None


def test_a_region_cuts_the_amplifiers(tmp_path: Path) -> None:
    """Within one of them, it is the whole chip."""
    folder = write(tmp_path, {"A": (0.25, 64.0), "B": (0.35, 74.0)}, 4)
    frames = ps.open_frames(folder, bits=12, region="0:96,40:100")
    assert [(each.name, each.c0, each.c1) for each in frames.amplifiers] == [("A", 0, 24), ("B", 24, 60)]
    alone = ps.open_frames(folder, bits=12, region="0:96,0:60")
    found = ps.calibrate(alone)
    near(found.system_gain_dn_per_e, 0.25)
    assert not found.amplifiers
