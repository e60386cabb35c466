"""Temporal row and column noise: separated without bias, and subtracted from the matching parts of the mean frame."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction.groups import Level
from photosite.calibration.spatial.line_noise import temporal_components
from photosite.engine.frame_sums import FrameSums
from photosite.engine.map_statistics import line_sums
from photosite.frames.frame_set import FrameSet
from photosite.studies.plain_camera import Disturbance, PlainCamera, bands
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.values.cfa import NAMED

MONO = np.zeros((1, 1), np.int64)
BAYER = np.array([[0, 1], [1, 2]])


def stack(rng, frames, shape, pixel, row, column, mean=200.0):
    """Frames with row and column noise and shifts of 3 DN; rounding adds 1/12 DN^2."""
    noise = rng.normal(0, pixel, (frames, *shape))
    noise += rng.normal(0, row, (frames, shape[0], 1)) + rng.normal(0, column, (frames, 1, shape[1]))
    return np.round(mean + noise + rng.normal(0, 3.0, (frames, 1, 1))).astype(np.uint16)


def levels(frames, tile):
    sums = FrameSums(frames.shape[1:], tile).add(frames)
    return [Level.of(totals) for totals in sums.label_totals()]


@pytest.mark.parametrize(("tile", "channel"), [(MONO, 0), (BAYER, 1)])
@pytest.mark.parametrize("frames", [2, 6])
def test_parts_are_unbiased_and_covered(frames, tile, channel):
    """150 stacks: means within four standard errors, coverage within 4.5 standard errors of 95 %.

    False alarms over all twelve comparisons of each kind: under 0.1 % of seeds.
    """
    rng = np.random.default_rng([1, frames, channel])
    truth = {"pixel": 9.0 + 1 / 12, "row": 1.0, "column": 0.25}
    found = {name: [] for name in truth}
    for _ in range(150):
        dn = stack(rng, frames, (40, 50), 3.0, 1.0, 0.5)
        parts = temporal_components(levels(dn, tile), line_sums(dn, tile.shape), tile)[channel]
        for name, values in found.items():
            part = getattr(parts, name)
            values.append((part.value, part.standard_uncertainty))
    for name, pairs in found.items():
        values, uncertainty = np.array(pairs).T
        error = values - truth[name]
        assert abs(error.mean()) < 4.0 * values.std() / np.sqrt(150), name
        assert np.mean(np.abs(error) < 1.96 * uncertainty) > 0.87, name


def test_parts_add_up_to_the_temporal_variance():
    """Except for the fraction of one line, which the mean of the frame contains."""
    dn = stack(np.random.default_rng(2), 5, (200, 300), 3.0, 1.0, 0.5)
    level = levels(dn, MONO)[0]
    assert temporal_components([level], line_sums(dn), MONO)[0].total.value == pytest.approx(level.variance, rel=2e-3)


def test_few_frames_of_a_stack_give_its_line_noise():
    dn = stack(np.random.default_rng(3), 40, (200, 300), 3.0, 1.0, 0.5)
    level = levels(dn, MONO)[0]
    (parts,) = temporal_components([level], line_sums(dn[::5]), MONO)
    assert parts.row.value == pytest.approx(1.0, abs=4 * parts.row.standard_uncertainty)
    assert parts.row.standard_uncertainty < 0.04


def test_row_noise_does_not_make_the_pixel_part_negative():
    """A sensor with row noise and without fixed pattern.

    If all noise counted as that of pixels, the pixel part would be -1.1 DN^2 / 20, nine standard uncertainties below 0.
    """
    rng = np.random.default_rng(4)
    frames = [("dark", 0.01, dn) for dn in stack(rng, 20, (160, 200), 2.0, 1.0, 0.3)]
    for step in range(1, 5):
        mean = 200.0 + 400.0 * step
        light = stack(rng, 4, (160, 200), np.sqrt(4.0 + 0.5 * (mean - 200.0)), 1.0, 0.3, mean)
        frames += [("light", 0.01 * step, dn) for dn in light]
    calibration = calibrate(FrameSet.from_arrays(frames, bits=12))
    for part in ("pixel", "row", "column"):
        estimate = getattr(calibration, f"dsnu1288_{part}_e")
        low, high = estimate.interval_95
        assert low == 0.0 < high, part
    assert "negative-variance" not in limits(calibration)


@pytest.mark.parametrize("cfa", ["mono", "rggb"])
def test_strong_flicker_on_few_rows_leaves_the_gain(cfa):
    # Bands of 5 % on 32 rows: without the frame means, which the variance of a level excludes, they vary by 6 % of the
    # shot noise less. Limit of 4 standard uncertainties: 1 false alarm in 16 000 seeds.
    camera = PlainCamera(
        shape=(32, 256),
        cfa=NAMED[cfa],
        gain=0.5,
        black_dn=100.0,
        read_noise_e=5.0,
        dsnu_dn=1.0,
        prnu=0.005,
        electrons_per_s=6e5,
    )
    darks = [Step(kind="dark", exposure_s=t, count=16 if t < 1e-3 else 4) for t in (1e-4, 0.002, 0.01)]
    lights = [Step(kind="light", exposure_s=t, count=16 if t == 0.006 else 4) for t in np.arange(1, 9) * 1e-3]
    protocol = ShootingProtocol(name="short", steps=(*darks, *lights))
    gain = calibrate(camera.frame_set(protocol, Disturbance(light=bands(0.05, 12.0)), 1)).system_gain_dn_per_e
    assert gain.standard_uncertainty < 0.01 * gain.value
    assert gain.value == pytest.approx(0.5, abs=4.0 * gain.standard_uncertainty)


@pytest.mark.parametrize("cfa", ["mono", "rggb"])
@pytest.mark.parametrize("row_dn", [0.0, 1.5])
def test_row_and_column_noise_of_an_independent_camera(cfa, row_dn):
    # Limits of 4 standard uncertainties: 1 false alarm in 16 000 seeds.
    camera = PlainCamera(
        shape=(80, 96), cfa=NAMED[cfa], gain=0.5, black_dn=100.0, read_noise_e=8.0, dsnu_dn=1.0, prnu=0.0,
        electrons_per_s=0.0,
    )  # fmt: skip
    protocol = ShootingProtocol("dark", (Step("dark", 1e-3, 16),))
    disturbance = Disturbance(numbers=lambda values, rng, _: values + rng.normal(0.0, row_dn, (len(values), 1)))
    found = calibrate(camera.frame_set(protocol, disturbance, 4))
    for estimate, truth in ((found.row_noise_dn, row_dn), (found.column_noise_dn, 0.0)):
        variance = estimate.value * abs(estimate.value)
        uncertainty = 2.0 * abs(estimate.value) * estimate.standard_uncertainty
        assert variance == pytest.approx(truth**2, abs=4.0 * uncertainty)
        assert uncertainty < 0.1 * 4.0**2
        assert (estimate.upper_limit_95 is None) == (truth > 0.0)
    assert found.read_noise_dn.value == pytest.approx(np.hypot(4.0, row_dn), rel=0.03)
    assert found.row_noise_e.value is None


@pytest.mark.parametrize(("axis", "name"), [(1, "row_noise_dn"), (0, "column_noise_dn")])
def test_lines_whose_means_the_camera_subtracts_are_named(axis, name):
    camera = PlainCamera(
        shape=(40, 48), gain=0.5, black_dn=100.0, read_noise_e=8.0, dsnu_dn=1.0, prnu=0.0, electrons_per_s=0.0
    )
    protocol = ShootingProtocol("dark", (Step("dark", 1e-3, 4),))
    disturbance = Disturbance(numbers=lambda values, *_: values - values.mean(axis=axis, keepdims=True) + values.mean())
    subtracted, clean = (calibrate(camera.frame_set(protocol, each, 4)) for each in (disturbance, Disturbance()))
    (found,) = (entry for entry in subtracted.diagnostics if entry.id == "lines-alike")
    assert name in found.parameters
    assert "lines-alike" not in limits(clean)
