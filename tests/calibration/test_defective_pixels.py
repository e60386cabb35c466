"""A few defective pixels of each kind decide no figure: frames of a plain NumPy sensor, with true figures.

Seeds are fixed. A figure must lie within four of its standard uncertainties, and its uncertainty be that of the sensor
without defects.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.reduction.defective_pixels import PixelSurvey
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, Level
from photosite.calibration.reduction.reduce import reduce_frames
from photosite.calibration.setting import reduced
from photosite.engine.frame_sums import FrameSums, PixelVariances
from photosite.frames.frame_set import FrameSet
from photosite.frames.repaired_frames import PixelReplacement, repaired
from photosite.report.effect import effect_figures

GAIN, READ_E, DSNU_E, PRNU, DARK_E_PER_S, BLACK_DN, TOP = 0.4, 4.0, 3.0, 0.01, 5.0, 64.0, 4095
SHAPE, RATE = (96, 160), 1e5
TRUTH = {
    "system_gain_dn_per_e": GAIN,
    "read_noise_e": READ_E,
    "dsnu_e": DSNU_E,
    "prnu_percent": 100 * PRNU,
    "dark_current_e_per_s": DARK_E_PER_S,
    "black_level_dn": BLACK_DN,
}
DARKS = ((0.01, 16), (0.1, 4), (1.0, 4), (5.0, 4), (20.0, 4))
LIGHTS = tuple(0.0116 * k for k in range(1, 11))


@dataclass
class Defective:
    """A sensor with defects: fields that a kind of them changes."""

    seed: int
    hot: np.ndarray = field(init=False)
    response: np.ndarray = field(init=False)
    jump_dn: np.ndarray = field(init=False)
    flicker: np.ndarray = field(init=False)
    stuck_dn: np.ndarray = field(init=False)
    cfa: tuple[tuple[str, ...], ...] = (("M",),)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, 7])
        self.offset = self.rng.normal(0.0, DSNU_E, SHAPE)
        self.response = 1.0 + self.rng.normal(0.0, PRNU, SHAPE)
        self.hot, self.jump_dn, self.stuck_dn = np.zeros(SHAPE), np.zeros(SHAPE), np.full(SHAPE, -1)
        self.flicker = np.zeros(SHAPE)

    def some(self, fraction: float) -> np.ndarray:
        chosen = np.zeros(SHAPE, bool)
        chosen.flat[self.rng.choice(chosen.size, round(fraction * chosen.size), replace=False)] = True
        return chosen

    def frame(self, kind: str, time_s: float) -> np.ndarray:
        light = RATE * time_s * self.response if kind == "light" else np.zeros(SHAPE)
        if self.flicker.any():
            light = light * (1.0 + self.flicker * (2 * self.rng.integers(0, 2, SHAPE) - 1))
        mean = (DARK_E_PER_S + self.hot) * time_s + light
        electrons = self.rng.poisson(mean) + self.offset + self.rng.normal(0.0, READ_E, SHAPE)
        jump = self.jump_dn * self.rng.integers(0, 2, SHAPE)
        dn = np.clip(np.rint(GAIN * electrons + BLACK_DN + jump), 0, TOP)
        return np.where(self.stuck_dn >= 0, self.stuck_dn, dn).astype(np.uint16)

    def frames(self) -> FrameSet:
        steps = [("dark", t) for t, count in DARKS for _ in range(count)]
        steps += [("light", t) for t in LIGHTS for _ in range(4)]
        return FrameSet.from_arrays([(kind, t, self.frame(kind, t)) for kind, t in steps], bits=12, cfa=self.cfa)


def clean(sensor: Defective) -> None:
    """No defects."""


def hot(sensor: Defective) -> None:
    """0.6 % hot pixels, of which most saturate in the longest dark frames."""
    chosen = sensor.some(0.006)
    sensor.hot[chosen] = 300.0 + sensor.rng.exponential(3000.0, chosen.sum())


def white(sensor: Defective) -> None:
    sensor.stuck_dn[sensor.some(0.0012)] = TOP


def stuck(sensor: Defective) -> None:
    chosen = sensor.some(0.01)
    sensor.stuck_dn[chosen] = sensor.rng.integers(0, TOP, chosen.sum())


def columns(sensor: Defective) -> None:
    sensor.stuck_dn[:, 40:42] = TOP


def row(sensor: Defective) -> None:
    sensor.stuck_dn[50] = TOP


def dead(sensor: Defective) -> None:
    sensor.response[sensor.some(0.01)] = 0.1


def cluster(sensor: Defective) -> None:
    sensor.response[20:25, 30:35] = 0.0


def blinking(sensor: Defective) -> None:
    """One pixel that jumps by half of the range."""
    sensor.jump_dn[40, 40] = 2000.0


def many_blinking(sensor: Defective) -> None:
    """1 % of the pixels jump so far that the frames differ from each other."""
    sensor.jump_dn[sensor.some(0.01)] = 2000.0


def blinking_if_lit(sensor: Defective) -> None:
    """0.2 % of the pixels, whose dark frames and whose mean response are like those of the others."""
    sensor.flicker[sensor.some(0.002)] = 0.12


KINDS = {
    hot: "hot", white: "stuck", stuck: "stuck", columns: "stuck", row: "stuck", dead: "dead", cluster: "dead",
    blinking: "noisy", many_blinking: "noisy", blinking_if_lit: "noisy",
}  # fmt: skip


def calibrated(kind, seed=1, cfa=(("M",),)):
    sensor = Defective(seed, cfa)
    kind(sensor)
    return ps.calibrate(sensor.frames())


@pytest.fixture(scope="module")
def usual():
    return calibrated(clean)


def assert_right(calibration, usual) -> None:
    for name, true in TRUTH.items():
        entry, other = getattr(calibration, name), getattr(usual, name)
        assert entry.value is not None, (name, entry.reason)
        assert abs(entry.value - true) < 4.0 * entry.standard_uncertainty, (name, entry)
        assert entry.standard_uncertainty < 1.3 * other.standard_uncertainty, (name, entry)


def test_clean_sensors_have_no_defects(usual) -> None:
    assert_right(usual, usual)
    for seed in range(2, 6):
        assert "defective-pixels" not in limits(calibrated(clean, seed))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_figures_are_those_of_the_other_pixels(kind, usual) -> None:
    calibration = calibrated(kind)
    assert_right(calibration, usual)
    assert set(limits(calibration)) - set(limits(usual)) == {"defective-pixels"}
    found = calibration.findings["pixel_defects"].left_out.pixels
    assert found.counts() == {KINDS[kind]: len(found)}
    sensor = Defective(1)
    plain = [sensor.hot, sensor.response, sensor.jump_dn, sensor.flicker, sensor.stuck_dn]
    before = [part.copy() for part in plain]
    kind(sensor)
    changed = np.any([part != other for part, other in zip(plain, before, strict=True)], axis=0)
    assert np.array_equal(np.flatnonzero(changed), found.index)


def test_a_mosaic_and_its_files(tmp_path) -> None:
    """Hot pixels of a Bayer sensor from TIFF files: the result is that of frames in memory."""
    import tifffile

    sensor = Defective(3, (("R", "G"), ("G", "B")))
    hot(sensor)
    sensor.stuck_dn[31] = 900  # a line
    frames = sensor.frames()
    in_memory = ps.calibrate(frames)
    for group in frames.groups:
        for k, source in enumerate(group.frames):
            tifffile.imwrite(tmp_path / f"{group.kind}_{group.exposure_s * 1000:g}ms_{k}.tif", source.read())
    stored = ps.calibrate(ps.open_frames(tmp_path, bits=12, cfa="RGGB"))
    found = [each.findings["pixel_defects"].left_out.pixels for each in (in_memory, stored)]
    assert found[0].counts() == found[1].counts()
    assert found[0].counts()["stuck"] == SHAPE[1]
    for name in TRUTH:
        one, other = getattr(in_memory, name), getattr(stored, name)
        assert one.value == pytest.approx(other.value, rel=1e-12), name
        assert one.standard_uncertainty == pytest.approx(other.standard_uncertainty, rel=1e-9), name


def test_corrected_sums_are_those_of_frames_with_replaced_pixels() -> None:
    """The frames are reduced again; a line and 1 % of the pixels of a Bayer sensor are replaced."""
    sensor = Defective(6, (("R", "G"), ("G", "B")))
    stuck(sensor)
    sensor.stuck_dn[17] = 3000
    many_blinking(sensor)
    with reduced(sensor.frames(), None, None) as (corrected, found):
        assert found.defects is not None
        with FrameReader(found.frames) as reader:
            again = reduce_frames(reader)
            for own, other in zip((*found.darks, *found.lights), (*again.darks, *again.lights), strict=True):
                assert own.frame_means == pytest.approx(other.frame_means, rel=1e-12)
                for level, expected in zip(own.levels, other.levels, strict=True):
                    for name in (
                        "mean",
                        "variance",
                        "spatial_variance",
                        "frame_shift",
                        "low_fraction",
                        "high_fraction",
                    ):
                        assert getattr(level, name) == getattr(expected, name), name
                    # The squared variances of pixels that jump, 10^5 times as large as the others', were subtracted.
                    assert level.variance_uncertainty == pytest.approx(expected.variance_uncertainty, rel=5e-5)
                assert np.array_equal(corrected.counts[id(own.group)], reader.counts[id(other.group)])
                assert np.array_equal(corrected.mean(own.group).sum, reader.mean(other.group).sum)
            assert np.array_equal(found.reference_mean.sum, again.reference_mean.sum)
            assert np.allclose(found.dark_slopes.slopes, again.dark_slopes.slopes, rtol=0, atol=1e-12)
            totals = [entry.total for entry in found.used]
            assert totals == [entry.total for entry in again.used]


def test_frames_are_read_again_only_where_pixels_were_not_yet_known(monkeypatch) -> None:
    """White pixels are found in the first dark frames; their numbers in later frames are kept when these are read."""
    again, read = [], FrameReader._read_numbers

    def reading(self, group, at):
        again.append(group)
        return read(self, group, at)

    monkeypatch.setattr(FrameReader, "_read_numbers", reading)
    sensor = Defective(6)
    white(sensor)
    frames = sensor.frames()
    with reduced(frames, None, None) as (_, found):
        assert found.defects is not None
    assert again == [frames.of_kind("dark")[0]]


def test_figures_of_all_pixels_are_stated() -> None:
    """Those of the frames as taken, by NumPy."""
    sensor = Defective(2)
    hot(sensor)
    dead(sensor)
    frames = sensor.frames()
    calibration = ps.calibrate(frames)
    left_out = calibration.findings["pixel_defects"].left_out
    darks, bright = frames.of_kind("dark"), frames.of_kind("light")[4]
    reference, longer = (np.stack([source.read() for source in group.frames]) for group in darks[:2])
    lit = np.stack([source.read() for source in bright.frames])
    variance, mean = reference.var(axis=0, ddof=1), reference.mean(axis=0)
    response = lit.mean(axis=0) - mean
    stated = left_out.all_pixels
    assert stated["read_noise_dn"] == pytest.approx(np.sqrt(variance.mean() - 1 / 12), rel=2e-3)
    assert stated["dsnu_dn"] == pytest.approx(np.sqrt(mean.var() - variance.mean() / len(reference)), rel=5e-3)
    assert stated["prnu_percent"] == pytest.approx(100 * response.std() / response.mean(), rel=0.02)
    rate = ((longer.mean(axis=0) - mean) / (darks[1].exposure_s - darks[0].exposure_s)).mean()
    assert stated["dark_current_dn_per_s"] == pytest.approx(rate, rel=0.02)
    assert left_out.without["dark_current_dn_per_s"] < 0.3 * rate
    (table,) = effect_figures()["pixel_defects"].blocks(calibration)
    assert [row[0] for row in table.rows] == ["Read noise", "DSNU", "PRNU", "Black level", "Dark current"]
    assert float(table.rows[1][2]) == pytest.approx(stated["dsnu_dn"], rel=1e-3)


def test_maps_and_histograms_have_all_pixels() -> None:
    sensor = Defective(4)
    dead(sensor)
    frames = sensor.frames()
    calibration = ps.calibrate(frames, maps=True)
    pixels = calibration.findings["pixel_defects"].left_out.pixels
    assert calibration.chip.defects.counts()["dead"] == len(pixels)
    row, col = pixels.place
    assert (calibration.chip.prnu[row, col] < -0.8).all()
    outliers = calibration.spatial["M"].light.outliers
    inside = (row > 10) & (row < SHAPE[0] - 10) & (col > 10) & (col < SHAPE[1] - 10)  # the filter leaves a border out
    assert set(zip(row[inside], col[inside], strict=True)) <= set(zip(outliers.row, outliers.col, strict=True))
    taken = sorted(hashlib.sha256(source.read()).hexdigest() for group in frames.groups for source in group.frames)
    assert list(calibration.frames_sha256) == taken


def test_the_sensor_file_has_the_defects_as_sections() -> None:
    base = ps.load_sensor("nikon-d200").with_(
        rows=SHAPE[0],
        cols=SHAPE[1],
        cfa="mono",
        channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}},
    )
    sensor = Defective(5)
    hot(sensor)
    sensor.stuck_dn[:, 70] = 1000
    sensor.response[np.s_[10:13, 10:13]] = 0.0
    blinking(sensor)
    calibration = ps.calibrate(sensor.frames(), base)
    effects = calibration.sensor.effects
    total = SHAPE[0] * SHAPE[1]
    assert effects.hot_pixels.fraction.value == pytest.approx(0.006, rel=0.05)
    rates = sensor.hot[sensor.hot > 0]
    assert effects.hot_pixels.median_e_per_s.value == pytest.approx(np.median(rates), rel=0.1)
    assert effects.telegraph_noise.fraction == 1 / total
    defects = effects.pixel_defects
    assert (defects.clusters, defects.cluster_pixels, defects.dead_fraction) == (1, 9, 0.0)
    (column,) = defects.listed
    assert (column.kind, column.cols, column.rows, column.value) == ("stuck", (70, 70), (0, SHAPE[0] - 1), 1000.0)
    read_e = calibration.sensor.electrons(calibration.sensor.noise.read_noise_mv.value)
    assert read_e == pytest.approx(READ_E, rel=0.02)


def test_pixels_that_blink_if_lit_are_no_telegraph_noise_of_the_dark() -> None:
    sensor = Defective(1)
    blinking_if_lit(sensor)
    base = ps.load_sensor("nikon-d200").with_(cfa="mono", channels={"M": ps.load_sensor("nikon-d200").channels["G"]})
    effects = ps.calibrate(sensor.frames(), base.with_(rows=SHAPE[0], cols=SHAPE[1])).sensor.effects
    assert effects is None or effects.telegraph_noise is None


def test_uneven_light_is_no_noise_of_pixels() -> None:
    """Corners at 30 % of the light: the flat field is not searched, and would show no pixel."""
    rng = np.random.default_rng(5)
    rows, cols = (np.linspace(-1.0, 1.0, length) for length in SHAPE)
    light = 20_000.0 * (1.0 - 0.35 * (rows[:, None] ** 2 + cols**2))
    dn = np.rint(64.0 + GAIN * rng.poisson(light, (8, *SHAPE))).astype(np.uint16)
    frames = FrameSet.from_arrays([("light", 0.1, each) for each in dn], bits=16)
    sums = FrameSums(SHAPE).add(dn)
    found = PixelSurvey(frames, np.zeros((1, 1), np.int64))
    entry = GroupStatistics(frames.groups[0], tuple(map(Level.of, sums.label_totals())))
    found.add(entry, sums, sums.label_totals())
    assert not found.noisy_flats([entry])
    assert not found.add_noise(PixelVariances(sums.variance(), 1.0), sums.count)


def survey(dark: np.ndarray, tile: tuple[int, int] = (1, 1)) -> int:
    """Number of defective pixels of a stack of dark frames, whose colors repeat with a tile."""
    frames = FrameSet.from_arrays([("dark", 0.1, dn) for dn in dark], bits=12)
    sums = FrameSums(dark.shape[1:]).add(dark)
    statistics = GroupStatistics(frames.groups[0], tuple(map(Level.of, sums.label_totals())))
    found = PixelSurvey(frames, np.zeros(tile, np.int64))
    found.add(statistics, sums, sums.label_totals())
    found.add_noise(PixelVariances(sums.variance(), 1.0), sums.count)
    index = found.found()
    return 0 if index is None else len(index)


@pytest.mark.parametrize("seed", range(4))
def test_skewed_and_uneven_chips_have_no_defects(seed) -> None:
    """Log-normal dark current and noise, a steep glow, columns of two gains, coarse numbers."""
    rng = np.random.default_rng(seed)
    rows, cols = shape = (128, 160)
    dark = 100.0 * rng.lognormal(0.0, 0.6, shape)
    assert survey(np.rint(60 + rng.poisson(dark, (8, *shape))).astype(np.uint16)) == 0
    noise = 3.0 * rng.lognormal(0.0, 0.35, shape)
    assert survey(np.rint(500 + rng.normal(0, noise, (16, *shape))).astype(np.uint16)) == 0
    glow = 800.0 * np.exp(-np.hypot(*np.ogrid[:rows, :cols]) / 12.0)
    assert survey(np.rint(60 + rng.normal(0, 2, (8, *shape)) + rng.poisson(glow, (8, *shape))).astype(np.uint16)) == 0
    taps = np.where(np.arange(cols) % 2, 40.0, 0.0)
    assert survey(np.rint(500 + taps + rng.normal(0, 2, (8, *shape))).astype(np.uint16)) == 0
    assert survey(np.rint(64.4 + rng.normal(0, 0.2, shape) + rng.normal(0, 0.15, (8, *shape))).astype(np.uint16)) == 0


def test_the_farthest_pixel_of_a_skewed_small_chip_is_no_defect() -> None:
    """A dark current of 5 standard deviations of its logarithm: 1 of 200 chips of this size has one; 7 is a defect.

    Limits of 3000 values count 9 of the 40.
    """
    counts = {}
    for deviations in (5.0, 7.0):
        found = 0
        for seed in range(40):
            rng = np.random.default_rng([seed, 8])
            rate = np.clip(rng.normal(size=(126, 126)), -4.2, 4.2)
            rate[50, 50] = deviations
            found += survey(np.rint(60 + rng.poisson(200.0 * np.exp(0.356 * rate), (4, 126, 126))).astype(np.uint16))
        counts[deviations] = found
    assert counts[5.0] <= 2
    assert counts[7.0] == 40


@pytest.mark.parametrize("tile", [(4, 4), (6, 6)])
def test_colors_of_few_pixels_have_no_defects_by_chance(tile) -> None:
    """At most 1 of 40 mosaics of 96 x 120 pixels; a pixel of 30 standard deviations is found in each."""
    rng = np.random.default_rng(1)
    alarms = 0
    for _ in range(40):
        dark = 40.0 * rng.lognormal(0.0, 0.3, (96, 120))
        frames = np.rint(60 + rng.poisson(dark, (16, 96, 120))).astype(np.uint16)
        alarms += survey(frames, tile) > 0
        frames[:, 50, 60] += 400
        assert survey(frames, tile) >= 1
    assert alarms <= 1


def test_too_many_are_a_part_of_the_distribution() -> None:
    rng = np.random.default_rng(1)
    dark = rng.normal(100.0, 2.0, (8, 100, 100))
    dark[:, rng.random((100, 100)) < 0.02] += 500.0
    assert survey(np.rint(dark).astype(np.uint16)) > 150
    dark[:, rng.random((100, 100)) < 0.02] += 500.0
    assert survey(np.rint(dark).astype(np.uint16)) == 0


def test_replaced_pixels_are_of_their_color_and_row() -> None:
    rng = np.random.default_rng(1)
    bad = rng.random((60, 80)) < 0.05
    bad[10] = True
    chosen = PixelReplacement.of(bad, (2, 2))
    assert chosen.lines == ((10, 26),)
    assert len(chosen.row) == bad.sum() - 80
    assert not bad[chosen.row, chosen.source_col].any()
    assert ((chosen.col - chosen.source_col) % 2 == 0).all()
    assert (np.abs(chosen.col - chosen.source_col) >= 16).mean() > 0.95
    dn = rng.integers(0, 4096, bad.shape).astype(np.uint16)
    frames = FrameSet.from_arrays([("dark", 0.1, dn)], bits=12)
    (source,) = repaired(frames, chosen).groups[0].frames
    found = source.read()
    assert np.array_equal(found[~bad], dn[~bad])
    assert np.array_equal(found[10], found[26])
    assert not (found[bad] == dn[bad]).mean() > 0.01
    assert not np.shares_memory(found, dn)
