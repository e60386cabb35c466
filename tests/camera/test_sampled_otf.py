"""Refinement of the table of a lens's transfer function that oscillates between the nodes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j1

from photosite.camera.sampled_otf import FREQUENCY_NODES, refined
from photosite.engine.transfer import RadialTransfer
from photosite.optics.diffraction import DiffractionLimited


def disc(frequency_per_m: np.ndarray, radius_m: float) -> np.ndarray:
    u = 2 * np.pi * radius_m * frequency_per_m
    return np.divide(2 * j1(u), u, out=np.ones_like(u), where=u > 0)


@pytest.mark.parametrize(("radius_m", "limit"), [(100e-6, 1.1e-5), (260e-6, 6e-5)])
def test_wide_disc_is_accurate_between_nodes(radius_m: float, limit: float) -> None:
    """Discs of 17 and 43 pixels radius of 6 um, cutoff 900 cycles/mm: lines between 4097 nodes err by 6e-4 and 4e-3."""
    nodes = np.linspace(0.0, 9e5, FREQUENCY_NODES)
    fine = refined(RadialTransfer(disc(nodes, radius_m)[None, None], float(nodes[1])))
    at = np.linspace(0.0, 1e5, 100_003)
    assert np.abs(fine.at(at)[0, 0] - disc(at, radius_m)).max() < limit


def test_diffraction_needs_no_refinement() -> None:
    lens = DiffractionLimited(f_number=8, focal_length_mm=50)
    nodes = np.linspace(0.0, lens.cutoff_per_m(550.0, 1.2), FREQUENCY_NODES)
    table = lens.otf(nodes, 550.0, 1.2)[None, None]
    assert refined(RadialTransfer(table, float(nodes[1]))).table is table
