"""Patch statistics against loops over pixels and against known noise."""

import math

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.values.cfa import NAMED
from photosite.values.region import Region


def random_frame(seed, cfa="rggb", shape=(24, 30)):
    dn = np.random.default_rng(seed).integers(0, 4096, shape).astype(np.uint16)
    return RawFrame(dn, bits=12, cfa=NAMED[cfa], black_level_dn=60.5)


@pytest.mark.parametrize("cfa", ["rggb", "gbrg", "mono"])
@pytest.mark.parametrize("region", [Region("a", 0, 10, 0, 10), Region("b", 3, 10, 5, 14), Region("c", 7, 24, 1, 30)])
def test_against_a_loop_over_pixels(cfa, region):
    frames = [random_frame(seed, cfa) for seed in (1, 2, 3)]
    found = patch_statistics(frames, [region])
    tile = NAMED[cfa]
    for k, channel in enumerate(found.channels):
        values = [[] for _ in frames]
        for r in range(region.r0, region.r1):
            for c in range(region.c0, region.c1):
                if tile[r % len(tile)][c % len(tile[0])] == channel:
                    for into, frame in zip(values, frames, strict=True):
                        into.append(float(frame.dn[r, c]))
        values = np.array(values)
        assert found.pixels[0, k] == values.shape[1]
        assert found.mean_dn[0, k] == pytest.approx(values.mean() - 60.5)
        spatial = math.sqrt(np.mean([v.var(ddof=1) for v in values]))
        temporal = math.sqrt(np.mean(values.var(axis=0, ddof=1)))
        assert found.spatial_noise_dn[0, k] == pytest.approx(spatial)
        assert found.temporal_noise_dn[0, k] == pytest.approx(temporal)
        error = values.mean(axis=0).std(ddof=1) / math.sqrt(values.shape[1])
        assert found.standard_error_dn[0, k] == pytest.approx(error)
        assert found.spatial_snr_db[0, k] == pytest.approx(20 * math.log10((values.mean() - 60.5) / spatial))
        assert found.temporal_snr_db[0, k] == pytest.approx(20 * math.log10((values.mean() - 60.5) / temporal))


def test_one_frame_has_no_temporal_noise():
    found = patch_statistics(random_frame(4), [Region("a", 0, 8, 0, 8)])
    assert found.frames == 1
    assert found.temporal_noise_dn is None
    assert found.temporal_snr_db is None
    assert found.mean_e is None


def test_electrons_by_the_system_gain():
    sensor = ps.load_sensor("nikon-d200")
    found = patch_statistics(random_frame(5), [Region("a", 0, 8, 0, 8)], sensor)
    np.testing.assert_allclose(found.mean_e * sensor.system_gain_dn_per_e, found.mean_dn)


def test_fixed_pattern_and_temporal_noise_are_separated():
    # 20 000 pixels, 8 frames: standard deviations have errors of 0.5 % (pattern and noise) and 0.2 % (noise alone);
    # the bounds are five of those.
    rng = np.random.default_rng(6)
    pattern = rng.normal(0, 12, (100, 200))
    frames = [
        RawFrame(np.rint(800 + pattern + rng.normal(0, 9, pattern.shape)).astype(np.uint16), bits=12) for _ in range(8)
    ]
    found = patch_statistics(frames, [Region("all", 0, 100, 0, 200)])
    assert found.spatial_noise_dn[0, 0] == pytest.approx(15.0, rel=0.025)
    assert found.temporal_noise_dn[0, 0] == pytest.approx(9.0, rel=0.010)
    # More frames do not reduce the pattern: sqrt(12^2 + 9^2 / 8) / sqrt(20 000).
    assert found.standard_error_dn[0, 0] == pytest.approx(math.sqrt((144 + 81 / 8) / 20_000), rel=0.025)


@pytest.mark.parametrize("noise_dn", [0.0, 0.15, 0.3, 1.0, 8.0])
def test_standard_error_is_the_scatter_of_means(noise_dn):
    # 2000 patches of 10 x 10 at levels anywhere between two steps: the ratio of the true squared error to the claimed
    # one has a standard error of about 3 to 5 %; 0.85 to 1.2 is more than three of those. With little noise
    # the claim is an upper bound (Sheppard's correction fails there), so only too small a claim is an error.
    rng = np.random.default_rng(7)
    level = rng.uniform(100, 200, 2000)
    seen = np.rint(level[:, None, None] + rng.normal(0, noise_dn, (2000, 10, 10))).astype(np.uint16)
    frame = RawFrame(seen.reshape(20_000, 10), bits=12)
    found = patch_statistics(frame, [Region(str(i), 10 * i, 10 * i + 10, 0, 10) for i in range(2000)])
    squared = np.mean((found.mean_dn[:, 0] - level) ** 2) / np.mean(found.standard_error_dn[:, 0] ** 2)
    assert squared < 1.2
    if noise_dn in (0.0, 1.0, 8.0):
        assert squared > 0.85


@pytest.mark.parametrize("kind", ["normal", "poisson", "two levels"])
def test_error_of_the_variance_for_any_distribution(kind):
    # 2000 patches of 200 pixels: the ratio has an error of about 4 %.
    rng = np.random.default_rng(8)
    shape = (2000, 10, 20)
    draw = {
        "normal": lambda: rng.normal(500, 20, shape),
        "poisson": lambda: rng.poisson(1.5, shape) * 30,
        "two levels": lambda: np.where(rng.random(shape) < 0.1, 900, 300),
    }[kind]
    frame = RawFrame(np.rint(draw()).astype(np.uint16).reshape(20_000, 20), bits=12)
    found = patch_statistics(frame, [Region(str(i), 10 * i, 10 * i + 10, 0, 20) for i in range(2000)])
    scatter = np.std(found.spatial_noise_dn[:, 0] ** 2)
    claimed = np.sqrt(np.mean(found.spatial_variance_error_dn2[:, 0] ** 2))
    assert claimed == pytest.approx(scatter, rel=0.1)


def test_a_single_defect_is_not_saturation():
    dn = np.full((40, 50), 500, np.uint16)
    dn[0, 0] = 4000
    frame = RawFrame(dn, bits=12, white_level_dn=4000)
    found = patch_statistics(frame, [Region("defect", 0, 40, 0, 50), Region("corner", 0, 10, 0, 10)])
    assert found.saturated_fraction[:, 0].tolist() == [1 / 2000, 1 / 100]
    assert found.saturated[:, 0].tolist() == [False, True]


def test_no_signal_and_no_noise():
    frame = RawFrame(np.full((8, 8), 64, np.uint16), bits=12, black_level_dn=64)
    found = patch_statistics(frame, [Region("dark", 0, 8, 0, 8)])
    assert found.spatial_snr_db[0, 0] == -np.inf
    clean = patch_statistics(RawFrame(frame.dn, bits=12), [Region("clean", 0, 8, 0, 8)])
    assert clean.spatial_snr_db[0, 0] == np.inf
    # All pixels are equal: only the rounding error remains.
    assert clean.standard_error_dn[0, 0] == pytest.approx(1 / math.sqrt(12))


def test_invalid_arguments():
    frame, patch = random_frame(9), Region("a", 0, 4, 0, 4)
    for frames, regions, what, where in (
        ([], [patch], "frames", None),
        (frame, [], "regions", None),
        (frame, [Region("far", 20, 25, 0, 4)], "region", "patch 'far'"),
        (frame, [Region("tiny", 0, 2, 0, 2)], "pixels of channel R", "patch 'tiny'"),
        ([frame, random_frame(9, shape=(24, 28))], [patch], "shape", "frame 2"),
        ([frame, random_frame(9, cfa="bggr")], [patch], "cfa", "frame 2"),
    ):
        with raises(InputError, what, where=where):
            patch_statistics(frames, regions)


def test_companded_frames_count_as_linear_numbers():
    """Saturation is at the linear level of the white level, which lies between two numbers."""
    stated = {"companding": "0:0 1024:1024 65535:4095"}
    dn = np.array([[2000, 2002, 1100, 1100]], np.uint16).repeat(4, axis=0)
    companded = RawFrame(dn, bits=12, black_level_dn=24, white_level_dn=2001, metadata=stated)
    found = patch_statistics(companded, [Region("left", 0, 4, 0, 2), Region("right", 0, 4, 2, 4)])
    slope = (65535 - 1024) / (4095 - 1024)
    assert found.mean_dn[:, 0] == pytest.approx([1024 + 977 * slope - 24, 1024 + 76 * slope - 24], abs=0.5)
    assert found.spatial_noise_dn[0, 0] == pytest.approx(slope * math.sqrt(8 / 7), rel=0.02)
    assert found.saturated_fraction[:, 0].tolist() == [0.5, 0.0]
