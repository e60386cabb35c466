"""Chart of gray steps: densities, places, and what is measured on it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.errors import InputError
from photosite.metrics.measure import measure
from photosite.report.printed_chart import write_printed_chart
from photosite.scene import charts


@pytest.mark.parametrize("steps", [4, 12, 20, 24])
def test_patches_have_their_densities_and_one_distance_from_the_middle(steps: int) -> None:
    chart = charts.gray_steps.chart(steps=steps, density_range=2.0)
    weights = chart.weights[0]
    occupied = np.zeros(weights.shape, int)
    for number, region in enumerate(chart.regions):
        part = weights[region.r0 : region.r1, region.c0 : region.c1]
        assert np.ptp(part) == 0
        assert -math.log10(float(part[0, 0])) == pytest.approx(2.0 * number / (steps - 1), abs=1e-6)
        assert region.name == f"density {2.0 * number / (steps - 1):.2f}"
        row, col = (region.r0 + region.r1) / 2 - 180, (region.c0 + region.c1) / 2 - 240
        assert math.hypot(row, col) == pytest.approx(0.36 * 360, abs=1.5)
        occupied[region.r0 - 1 : region.r1 + 1, region.c0 - 1 : region.c1 + 1] += 1
    assert occupied.max() == 1


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(InputError):
        charts.gray_steps.chart(steps=24, rows=60, cols=60)


def test_tone_and_noise_are_measured() -> None:
    """Frames of the chart have the exponent of its exact image, and the signal-to-noise ratio of the ColorChecker's.

    The exact image has an exponent of almost 1. Four standard
    uncertainties are exceeded by chance once in 16 000.
    """
    sensor = ps.load_sensor("nikon-d200").with_(rows=360, cols=480, black_level_dn=64)
    camera = ps.Camera(ps.DiffractionLimited(4, 50), sensor)
    found = {}
    for name, scene in (("gray-steps", charts.gray_steps("D65", 100)), ("macbeth", charts.macbeth("D65", 100))):
        time_s = camera.auto_exposure_s(camera.mean_electrons(scene, 1.0))
        frames = [camera.capture(scene, time_s, seed=seed) for seed in range(4)]
        found[name] = measure(frames, name, only=["oecf", "noise"])
        if name == "gray-steps":
            green = camera.mean_electrons(scene, time_s)[0::2, 1::2]
            exact = measure(green, name, only=["oecf"])["oecf"]["exponent", "M"]
    assert exact.value == pytest.approx(1.0, abs=0.01)
    exponent = found["gray-steps"]["oecf"]["exponent", "G"]
    assert exponent.value == pytest.approx(exact.value, abs=4.0 * exponent.standard_uncertainty)
    assert exponent.standard_uncertainty < 0.003
    one, other = (each["noise"]["snr_18_db", "G"].value or 0 for each in found.values())
    assert one == pytest.approx(other, abs=0.3)


def test_it_prints_with_its_reflectances(tmp_path: Path) -> None:
    field, patches = write_printed_chart(
        charts.gray_steps.chart(), tmp_path / "steps.pdf", width_mm=120, dots_per_inch=100
    )
    assert str(field) == "reflectance 0.900, L* 96.0"
    assert [round(patch.factor, 4) for patch in patches[:2]] == [0.9, round(0.9 * 10 ** (-1.6 / 11), 4)]
    assert (tmp_path / "steps.pdf").read_bytes().startswith(b"%PDF")


def test_film_has_transmittances(tmp_path: Path) -> None:
    chart = charts.gray_steps.chart(density_range=3.0)
    field, patches = write_printed_chart(chart, tmp_path / "steps.pdf", width_mm=120, dots_per_inch=100)
    assert (str(field), str(patches[-1])) == ("transmittance 1.000, density 0.00", "transmittance 0.001, density 3.00")


def test_film_is_not_darker_than_8_bits_show(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="density 3"):
        write_printed_chart(charts.hdr_patches.chart(), tmp_path / "hdr.pdf", width_mm=120, dots_per_inch=100)
    field, _ = write_printed_chart(
        charts.hdr_patches.chart(decades=3), tmp_path / "hdr.pdf", width_mm=120, dots_per_inch=100
    )
    assert (field.quantity, field.factor) == ("transmittance", 1.0)
