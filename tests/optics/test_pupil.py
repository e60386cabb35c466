"""Pupils: areas and OTFs against closed forms and counted cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises

from photosite.errors import InputError
from photosite.optics.annular import aberration_free_otf
from photosite.optics.pupil import Pupil

Array = NDArray[np.float64]
S = np.linspace(0, 1.1, 1101)


def oneill(s: Array, ratio: float) -> Array:
    """O'Neill 1956 as printed, in three terms; s relative to the cutoff."""

    def disc(r: Array) -> Array:
        r = np.minimum(r, 1.0)
        return 2 / math.pi * (np.arccos(r) - r * np.sqrt(1 - r * r))

    angle = np.arccos(np.clip((1 + ratio**2 - 4 * s**2) / (2 * ratio), -1, 1))
    between = (
        2 * ratio / math.pi * np.sin(angle)
        + (1 + ratio**2) / math.pi * angle
        - 2 * (1 - ratio**2) / math.pi * np.arctan((1 + ratio) / (1 - ratio) * np.tan(angle / 2))
        - 2 * ratio**2
    )
    cross = np.where(s < (1 - ratio) / 2, -2 * ratio**2, np.where(s <= (1 + ratio) / 2, between, 0.0))
    return (disc(s) + ratio**2 * disc(s / ratio) + cross) / (1 - ratio**2)


@pytest.mark.parametrize("ratio", [0.05, 0.3, 0.5, 0.9])
def test_annulus_against_oneill(ratio: float) -> None:
    assert Pupil(obscuration=ratio).transfer(0.6 * S, -0.8 * S) == pytest.approx(oneill(S, ratio), abs=2e-12)


def test_nearly_round_blades_by_chords_agree_with_the_circle() -> None:
    """Blades slightly flatter than the circle use the chords and the table."""
    nearly = Pupil(blades=7, roundness=1 - 1e-9, rotation_deg=20)
    assert not nearly.rotationally_symmetric
    assert nearly.area == pytest.approx(1.0, abs=2e-5)
    for angle in (0.0, 0.7, 2.0, 4.0):
        got = nearly.transfer(S * math.sin(angle), S * math.cos(angle))
        assert got == pytest.approx(aberration_free_otf(S), abs=2e-5)
    assert Pupil(blades=7, roundness=1).rotationally_symmetric


def test_annulus_by_chords_agrees_with_the_closed_form() -> None:
    ring = Pupil(obscuration=0.4, blades=9, roundness=1 - 1e-9)
    got = ring.transfer(S * 0.28, S * 0.96)
    assert got == pytest.approx(aberration_free_otf(S, 0.4), abs=4e-5)


@pytest.mark.parametrize("rotation", [13.0, 45.0])
def test_square_pupil(rotation: float) -> None:
    pupil = Pupil(blades=4, rotation_deg=rotation)
    assert pupil.area == pytest.approx(2 / math.pi, abs=1e-5)
    y, x = np.random.default_rng(4).uniform(-1, 1, (2, 20_000))
    turn = math.radians(rotation - 45)
    u, v = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
    side = math.sqrt(0.5)  # half side in radii; also the cutoff along the sides
    exact = np.maximum(1 - np.abs(u) / side, 0) * np.maximum(1 - np.abs(v) / side, 0)
    error = pupil.transfer(y, x) - exact
    assert np.abs(error).max() < 3e-4
    assert math.sqrt((error**2).mean()) < 1e-5


@pytest.mark.parametrize("blades", [3, 8])
def test_area_and_cutoffs_of_polygons(blades: int) -> None:
    pupil = Pupil(blades=blades, rotation_deg=90)
    assert pupil.area * math.pi == pytest.approx(blades / 2 * math.sin(2 * math.pi / blades), rel=2e-5)
    for angle in np.radians([0.0, 17.0, 90.0]):
        corners = np.radians(90 + 360 * np.arange(blades) / blades)
        # Copies shifted by more than the longest chord do not overlap.
        chord = longest_chord(np.cos(corners), np.sin(corners), angle) / 2
        near, beyond = (np.array([chord + d]) for d in (-0.01, 2e-3))
        assert pupil.transfer(near * math.sin(angle), near * math.cos(angle))[0] > 1e-5
        assert pupil.transfer(beyond * math.sin(angle), beyond * math.cos(angle))[0] < 1e-12


def longest_chord(x: Array, y: Array, angle: float) -> float:
    """Longest chord of a convex polygon along a direction: it begins or ends in a corner."""
    along, across = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
    best = 0.0
    for p in across:
        hits = []
        for i in range(x.size):
            j = (i + 1) % x.size
            a, b = across[i] - p, across[j] - p
            if min(a, b) <= 1e-12 and max(a, b) >= -1e-12:
                hits += [along[i], along[j]] if abs(a - b) < 1e-12 else [along[i] + (along[j] - along[i]) * a / (a - b)]
        best = max(best, max(hits) - min(hits))
    return best


def test_all_shapes_together_against_counted_cells() -> None:
    """Rounded blades, obscuration and vanes: a mask of 1.7 million points, overlapped with itself."""
    pupil = Pupil(0.3, 5, 11.0, 0.4, 3, 0.03, 25.0)
    n = 1300
    at = (np.arange(n) + 0.5) * 2 / n - 1
    x, y = np.meshgrid(at, at)
    mask = np.hypot(x, y) > 0.3
    half = math.pi / 5
    center = math.cos(half) - math.sqrt(2.5**2 - math.sin(half) ** 2)
    for k in range(5):
        normal = math.radians(11) + (2 * k + 1) * half
        mask &= np.hypot(x - center * math.cos(normal), y - center * math.sin(normal)) < 2.5
    for k in range(3):
        vane = math.radians(25 + 120 * k)
        along, aside = x * math.cos(vane) + y * math.sin(vane), y * math.cos(vane) - x * math.sin(vane)
        mask &= ~((along > 0) & (np.abs(aside) < 0.03))
    assert pupil.area == pytest.approx(mask.mean() * 4 / math.pi, abs=2e-4)
    for down, right in [(0, 20), (31, 7), (150, -222), (-400, 60), (600, 600), (17, -800)]:
        a = mask[max(down, 0) : n + min(down, 0), max(right, 0) : n + min(right, 0)]
        b = mask[max(-down, 0) : n + min(-down, 0), max(-right, 0) : n + min(-right, 0)]
        counted = (a & b).sum() / mask.sum()
        got = pupil.transfer(np.array(down / n), np.array(right / n))
        assert float(got) == pytest.approx(counted, abs=6e-4)


def test_area_and_moments_of_cells() -> None:
    amplitude, y, _ = Pupil(blades=3, rotation_deg=90).cells(40)
    area = amplitude.sum() * (2 / 40) ** 2
    assert area == pytest.approx(3 * math.sqrt(3) / 4, rel=1e-4)
    assert (amplitude * y).sum() == pytest.approx(0, abs=0.1)
    # Second moment of an equilateral triangle about its center: side^4 sqrt(3) / 96, side sqrt(3).
    assert (amplitude * y * y).sum() * (2 / 40) ** 2 == pytest.approx(9 * math.sqrt(3) / 96, rel=2e-3)
    assert amplitude[-3:].sum() < amplitude[8:11].sum()  # the corner is at the top, y up


def test_array_pupil_consists_of_uniform_cells() -> None:
    square = np.zeros((16, 16))
    square[4:12, 4:12] = 1.0
    pupil = Pupil(amplitude=square)
    assert pupil.area == pytest.approx(1 / math.pi)
    y, x = np.random.default_rng(1).uniform(-1, 1, (2, 500))
    exact = np.maximum(1 - 2 * np.abs(x), 0) * np.maximum(1 - 2 * np.abs(y), 0)
    assert pupil.transfer(y, x) == pytest.approx(exact, abs=1e-12)
    lopsided = np.zeros((16, 16))
    lopsided[2:5, 8:10] = 1.0  # at the top
    amplitude, y, _ = Pupil(amplitude=lopsided).cells(10)
    assert (amplitude * y).sum() / amplitude.sum() == pytest.approx((16 - 7) / 16, abs=1e-12)


def test_edge_ratio_against_the_slope_of_the_otf() -> None:
    assert Pupil().edge_ratio == pytest.approx(1, abs=1e-4)
    assert Pupil(obscuration=0.5).edge_ratio == pytest.approx(1.5 / 0.75, rel=1e-4)
    hexagon = 6 / (3 * math.sqrt(3) / 2) / 2
    assert Pupil(blades=6).edge_ratio == pytest.approx(hexagon, rel=3e-3)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"obscuration": 1.0}, "obscuration"),
        ({"blades": 2}, "blades"),
        ({"blades": 6, "roundness": 1.5}, "roundness"),
        ({"vanes": 4}, "vane_width"),
        ({"rotation_deg": math.nan}, "rotation_deg"),
        ({"vanes": 12, "vane_width": 0.4}, "the pupil transmits less than"),
        ({"amplitude": np.ones((16, 16))}, "amplitude"),
        ({"amplitude": np.ones((16, 12))}, "amplitude"),
        ({"amplitude": np.full((16, 16), 2.0)}, "amplitude"),
        ({"amplitude": np.zeros((16, 16))}, "amplitude"),
        ({"amplitude": np.zeros((16, 16)), "blades": 5}, "a pupil cannot be an array"),
    ],
)
def test_invalid_pupils(change: dict[str, float], what: str) -> None:
    with raises(InputError, what):
        Pupil(**change)  # type: ignore[arg-type]
