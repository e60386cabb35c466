"""Sets like the published ones: a descriptor with PNG frames, of sensors that deviate from the model.

The first is simulated with 12 bits: response curved by 2 % at saturation, light that falls off by 3 % to the corners, a
sinusoidal pattern in the dark, 100 outlier pixels. The truth is known, and intervals must contain it. The second is an
8-bit camera with black level clamping, and exposure times in microseconds where a descriptor has nanoseconds.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import norm
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.frames.io import png
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame

ROWS, COLS = 120, 144


@dataclass(frozen=True)
class Imperfect:
    """A chip and its light; numbers in electrons."""

    seed: int
    bits: int = 12
    gain: float = 0.25
    black_dn: float = 60.0
    efficiency: float = 0.52
    read_e: float = 9.0
    dsnu_e: float = 5.0
    sine_e: float = 4.0
    outliers: int = 100
    outlier_e: float = 120.0
    prnu: float = 0.008
    fall_off: float = 0.03
    bend: float = 0.02
    dark_e_per_s: float = 400.0
    clamp_e_per_s: float = 0.0

    def __post_init__(self):
        rng = np.random.default_rng([self.seed, 61])
        rows, cols = np.mgrid[:ROWS, :COLS]
        offset = rng.normal(0.0, self.dsnu_e, (ROWS, COLS)) + self.sine_e * np.sin(2 * np.pi * cols / 50.0)
        outliers = rng.choice(offset.size, self.outliers, replace=False)
        offset.ravel()[outliers] += self.outlier_e
        radius = ((rows / (ROWS - 1) - 0.5) ** 2 + (cols / (COLS - 1) - 0.5) ** 2) / 0.5
        light = 1.0 - self.fall_off * radius
        for name, value in (
            ("offset", offset),
            ("ordinary", np.delete(offset.ravel(), outliers)),
            ("light_on", light / light.mean() * (1.0 + rng.normal(0.0, self.prnu, (ROWS, COLS)))),
            ("rng", rng),
        ):
            object.__setattr__(self, name, value)

    @property
    def top(self):
        return 2**self.bits - 1

    @property
    def full_e(self):
        return (self.top - self.black_dn) / self.gain

    def frame(self, photons, seconds):
        dark = self.dark_e_per_s * seconds
        electrons = self.rng.poisson(photons * self.efficiency * self.light_on + dark).astype(float)
        bent = electrons * (1.0 - self.bend * electrons / self.full_e)
        read = self.offset - self.clamp_e_per_s * seconds + self.rng.normal(0.0, self.read_e, bent.shape)
        return np.clip(np.rint(self.black_dn + self.gain * (bent + read)), 0, self.top).astype(np.uint16)


def write_set(folder, chip, *, levels, longest_s, ns_per_s, stack=16):
    """Like the published sets: pairs of flats up to 1.15 times saturation, pairs of darks, and a stack of each."""
    lines = ["# simulated", "v 3.0", f"n {chip.bits} {COLS} {ROWS}"]
    most = 1.15 * chip.full_e / chip.efficiency

    def series(kind, level, count):
        seconds, photons = longest_s * level, (most * level if kind == "b" else 0.0)
        lines.append(f"{kind} {seconds * ns_per_s:.1f}" + (f" {photons:.3f}" if kind == "b" else ""))
        for _ in range(count):
            name = f"{len(lines):04d}.png"
            png.write(
                RawFrame(chip.frame(photons, seconds), chip.bits, black_level_dn=chip.black_dn),
                folder / "images" / name,
            )
            lines.append(f"i images\\{name}")

    (folder / "images").mkdir(parents=True)
    for level in np.linspace(1 / levels, 1.0, levels):
        series("b", level, 2)
        series("d", level, 2)
    half = 0.5 / 1.15 + 1e-4
    series("b", half, stack)
    series("d", half, stack)
    path = folder / "EMVA1288_Data.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def photons_at_largest_variance(chip):
    """Photons at the largest mean temporal variance of clipped numbers: EMVA 1288's saturation."""
    photons = np.linspace(0.85, 1.1, 101) * chip.full_e / chip.efficiency
    sample = np.s_[:: max(1, ROWS // 40), :: max(1, COLS // 40)]
    light, offset = (getattr(chip, name)[sample].ravel() for name in ("light_on", "offset"))
    variances = []
    for amount in photons:
        electrons = amount * chip.efficiency * light
        slope = 1.0 - 2.0 * chip.bend * electrons / chip.full_e
        mean = chip.gain * (electrons * (1.0 - chip.bend * electrons / chip.full_e) + offset) + chip.black_dn
        sigma = chip.gain * np.sqrt(slope**2 * electrons + chip.read_e**2)
        a = (chip.top - mean) / sigma
        first = -norm.pdf(a) + a * norm.sf(a)  # E[min(z, a)]
        second = norm.cdf(a) - a * norm.pdf(a) + a**2 * norm.sf(a)
        variances.append((sigma**2 * (second - first**2)).mean())
    return float(photons[np.argmax(variances)])


def truth(chip):
    """By the definitions of the parameters; spreads are those of this chip, with the sinusoid and without outliers."""
    offset_e = chip.ordinary.std()
    return {
        "system_gain_dn_per_e": chip.gain,
        "quantum_efficiency_percent": 100 * chip.efficiency,
        "responsivity_dn_per_photon": chip.gain * chip.efficiency,
        "temporal_dark_noise_e": chip.read_e,
        "dsnu1288_e": offset_e,
        "dsnu_e": offset_e,
        "prnu1288_percent": 100 * chip.prnu,
        "dark_current_e_per_s": chip.dark_e_per_s,
        "saturation_capacity_photons": photons_at_largest_variance(chip),
        "black_level_dn": chip.black_dn + chip.gain * chip.ordinary.mean(),
        "saturation_dn": float(chip.top),
    }


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """Three chips: response curved downwards, curved upwards, straight."""
    outcomes = []
    for seed, bend in ((1, 0.02), (2, -0.02), (5, 0.0)):
        chip = Imperfect(seed, bend=bend)
        folder = tmp_path_factory.mktemp("set") / "frames"
        outcomes.append(
            (chip, calibrate(open_frames(write_set(folder, chip, levels=24, longest_s=0.05, ns_per_s=1e9))))
        )
    return outcomes


def test_the_truth_lies_inside_the_intervals(simulated):
    """Of 33 intervals of 95 %, one or two would miss on average; with these seeds none does."""
    for chip, calibration in simulated:
        for name, true in truth(chip).items():
            # The standard's saturation is at the largest variance.
            entry = getattr(calibration.by_line if name == "saturation_capacity_photons" else calibration, name)
            assert entry.value is not None, entry.reason
            low, high = entry.interval_95
            # The bounds of the largest variance assume a straight response; half of the curvature shifts it.
            moved = 0.5 * abs(chip.bend) * entry.value if name == "saturation_capacity_photons" else 1e-9
            assert low - moved <= true <= high + moved, (name, chip.bend, entry)
            assert entry.standard_uncertainty < 0.06 * entry.value, name


def test_only_a_curved_response_gives_a_warning(simulated):
    bent = {"bent-response", "bent-variance", "unclear-bend"}
    assert [bool(bent & set(limits(calibration))) for _, calibration in simulated] == [True, True, False]


def test_the_gain_of_the_line_misses_that_at_small_signal(simulated):
    """The scatter about the straight line explains a fifth of the error only."""
    chip, calibration = simulated[0]
    curve, line = calibration.curves["M"]["photon_transfer"], calibration.emva1288["K"]
    assert abs(curve.slope / chip.gain - 1) > 0.02
    assert line.value == pytest.approx(curve.slope)
    assert abs(line.value - chip.gain) > 3.0 * line.standard_uncertainty


def test_the_high_pass_removes_the_fall_off(simulated):
    for _, calibration in simulated:
        assert calibration.prnu1288_unfiltered_percent.value > 1.15 * calibration.prnu1288_percent.value


def test_exposure_times_in_microseconds_give_no_dark_current(tmp_path):
    """The dark level falls by 600 000 electrons per stated second: no value, but the factor of the unit."""
    chip = Imperfect(
        7, bits=8, gain=0.02, black_dn=12.0, read_e=40.0, dsnu_e=20.0, sine_e=10.0, outlier_e=500.0, bend=0.0,
        dark_e_per_s=0.0, clamp_e_per_s=600.0,
    )  # fmt: skip
    path = write_set(tmp_path / "frames", chip, levels=12, longest_s=0.018, ns_per_s=1e6)
    calibration = calibrate(open_frames(path))
    for name in ("dark_current_e_per_s", "dark_current_from_variance_e_per_s", "dcnu_percent"):
        entry = getattr(calibration, name)
        assert entry.value is None, entry
        assert entry.reason_id == "implausible"
    assert "implausible" in limits(calibration)
    for name, value in (("system_gain_dn_per_e", chip.gain), ("quantum_efficiency_percent", 100 * chip.efficiency)):
        entry = getattr(calibration, name)
        assert abs(entry.value - value) < 3.3 * entry.standard_uncertainty, entry
