"""The page of public sets: intervals in the owner's unit, sets that are missing, frames of the sets' layout."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import real_frames
from real_frames import Figure


@dataclass(frozen=True)
class Found:
    """An estimate."""

    value: float | None = 0.4
    standard_uncertainty: float = 0.004
    interval_95: tuple[float, float] = (0.392, 0.408)
    reason: str = "no light"


@pytest.mark.parametrize(
    ("owner", "inverse", "cells"),
    [
        ("0.405", False, ("0.4 ± 0.004", "yes")),
        ("2.45", True, ("2.5 ± 0.025", "no")),
        ("2.46 (stated)", True, ("2.5 ± 0.025", "yes")),
        ("mean of all: 0.4", False, ("0.4 ± 0.004", "-")),
    ],
)
def test_cells_are_in_the_unit_of_the_owner(owner: str, inverse: bool, cells: tuple[str, str]) -> None:
    assert Figure("K", owner, Found(), inverse=inverse).cells()[2:4] == cells
    assert Figure("K", owner, Found(None)).cells()[2] == "not estimated: no light"


def test_a_missing_set_keeps_its_section(tmp_path: Path) -> None:
    for each in real_frames.SETS:
        assert real_frames.section(each, tmp_path).endswith("The set was not at hand when this page was made.")


def test_frames_of_a_tap_are_measured(tmp_path: Path) -> None:
    """Frames of the layout of the rocket's camera, made here: K of each tap is found."""
    fits = pytest.importorskip("astropy.io.fits")
    rng = np.random.default_rng(1)
    folder = tmp_path / "msfc-ccd" / "led"
    folder.mkdir(parents=True)
    for name, electrons in (("04803", 3e4), ("04804", 3e4), ("04860", 0.0), ("04861", 0.0)):
        dn = 3000.0 + rng.poisson(electrons, (1040, 2152)) / 2.5 + rng.normal(0.0, 4.0, (1040, 2152))
        fits.PrimaryHDU(np.rint(dn).astype(np.uint16)).writeto(folder / f"ESIS1_{name}.fit.gz")
    rows: Iterator[Figure | str] = real_frames.sounding_rocket(tmp_path / "msfc-ccd")
    gains = [row for row in rows if isinstance(row, Figure) and row.name.startswith("K of tap")]
    assert [row.name for row in gains] == [f"K of tap {tap}, e⁻/DN" for tap in ("1/E", "4/F", "2/H", "3/G")]
    for row in gains:
        assert 1.0 / row.estimate.value == pytest.approx(2.5, rel=0.015)  # half a million pixels: 0.2 %
