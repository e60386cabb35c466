"""Tone and noise of gray patches against the closed forms of sensors that plain NumPy draws."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.measure import ImageQuality, measure
from photosite.studies.measurements.noise import truth_of
from photosite.studies.virtual_charts import VirtualNoise, virtual_noise
from photosite.studies.virtual_patches import (
    WHITE_DN,
    color_checker,
    patches_in_light,
    raw_patches,
    relative_luminances,
)


def drawn(
    noise: VirtualNoise, random: np.random.Generator, count: int, exponent: float = 1.0, edition: int = 2013
) -> ImageQuality:
    frames, _ = raw_patches(noise, random, count, exponent=exponent)
    options = {"noise": {"edition": edition}}
    return measure(frames, "macbeth", luminance_cd_m2=100.0, only=["oecf", "noise"], options=options)


def test_edition_2003_takes_the_noise_of_the_darkest_patch() -> None:
    """Of 40 sensors, 95 % intervals miss more than 6 in 1 of 100 runs; the other edition's miss all."""
    random = np.random.default_rng(20261201)
    missed, other = 0, 0
    for _ in range(40):
        noise = virtual_noise(random)
        white = WHITE_DN - noise.black
        signal = 0.85 * white * min(relative_luminances().values()) / max(relative_luminances().values())
        truth = 20 * math.log10(white / math.sqrt(noise.temporal_floor + noise.gain * signal))
        found = drawn(noise, random, 6, edition=2003)["noise"]
        low, high = found["dynamic_range_db"].interval_95 or (math.nan, math.nan)
        missed += not low <= truth <= high
        other += low <= truth_of(noise)["dynamic_range_db"] <= high
    assert (missed <= 6, other) == (True, 0), (missed, other)


def test_speed_needs_light_and_exposure() -> None:
    random = np.random.default_rng(4)
    frames = [
        RawFrame(dn, 12, black_level_dn=200)
        for dn in VirtualNoise(0.5, 3, 1, 0.005).frames(random, patches_in_light(4000.0), 2, WHITE_DN)
    ]
    for placing in ({}, {"luminance_cd_m2": 100.0}):
        with pytest.raises(InputError):
            measure(frames, "macbeth", only=["speed"], **placing)["speed"]


def test_exponent_of_the_oecf() -> None:
    random = np.random.default_rng(5)
    noise = VirtualNoise(0.5, 3.0, 1.0, 0.005)
    for exponent in (1.0, 0.8):
        found = drawn(noise, random, 4, exponent)["oecf"]
        assert found["exponent"].value == pytest.approx(exponent, abs=4 * (found["exponent"].standard_uncertainty or 0))
        assert (found["exponent"].standard_uncertainty or 1) < 0.001
        assert ("curved-tone" in {entry.id for entry in found.diagnostics}) == (exponent != 1.0)
    dn_per_cd = 0.85 * (WHITE_DN - noise.black) / color_checker().patch_xyz[:, 1].max()
    straight = drawn(noise, random, 4)["oecf"]["signal_per_luminance"]
    assert straight.value == pytest.approx(dn_per_cd, rel=0.01)


def test_a_single_frame_has_total_noise_only() -> None:
    found = drawn(VirtualNoise(0.5, 3.0, 1.0, 0.005), np.random.default_rng(6), 1)["noise"]
    assert "one-frame-noise" in {entry.id for entry in found.diagnostics}
    names: set[Any] = {quantity for quantity, _ in found.values}
    assert "snr_18_temporal_db" not in names
    assert found["snr_18_db"].value is not None


def test_averaged_neighbors_are_named() -> None:
    random = np.random.default_rng(7)
    noise = VirtualNoise(0.5, 3.0, 1.0, 0.005)
    made = noise.frames(random, patches_in_light(4000.0), 2, WHITE_DN)
    smooth = [((frame + np.roll(frame.astype(int), 1, axis=1)) // 2).astype(np.uint16) for frame in made]
    for frames, expected in ((made, False), (smooth, True)):
        raw = [RawFrame(dn, 12, black_level_dn=noise.black) for dn in frames]
        found = measure(raw, "macbeth", only=["noise"])["noise"]
        assert ("noise-reduction" in {entry.id for entry in found.diagnostics}) == expected


def test_frames_without_the_chart_are_refused() -> None:
    random = np.random.default_rng(8)
    noise = VirtualNoise(0.5, 3.0, 1.0, 0.005)
    mirrored = noise.frames(random, patches_in_light(4000.0)[:, ::-1], 2, WHITE_DN)
    even = noise.frames(random, np.full(color_checker().shape, 2000.0), 2, WHITE_DN)
    for made in (mirrored, even):
        frames = [RawFrame(dn, 12, black_level_dn=noise.black) for dn in made]
        found = measure(frames, "macbeth", only=["oecf", "noise"])
        for name in ("oecf", "noise"):
            with pytest.raises(InputError):
                found[name]
