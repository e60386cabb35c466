"""Frame sets that show only some parameters: the others are missing, each with its reason.

The expected values are those of cameras of plain NumPy. Deviations of 3.5 standard uncertainties are allowed: 5 of
10 000 correct results exceed them.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import convolve
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.calibration.export.emva_xml import emva_results
from photosite.calibration.result import Calibration
from photosite.errors import PhotositeWarning
from photosite.frames.frame_set import FrameSet
from photosite.frames.frame_settings import Kind
from photosite.studies.plain_camera import Disturbance, PlainCamera, bent, convolved
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.values.cfa import cfa_from
from photosite.values.estimate import Estimate

SHAPE = (96, 128)
GAIN, READ_DN, BLACK_DN, DSNU_DN = 0.3, 1.8, 64.0, 0.6
DARK_DN_PER_S, LIGHT_E_PER_S = 9.0, 1.5e5


def measured(
    dark_s: tuple[float, ...], light_s: tuple[float, ...] = (), frames: int = 8, black_dn: float = BLACK_DN
) -> Calibration:
    rng = np.random.default_rng(5)
    offset = black_dn + DSNU_DN * rng.normal(size=SHAPE)

    def take(kind: Kind, exposure_s: float) -> list[tuple[Kind, float, NDArray[np.uint16]]]:
        electrons = exposure_s * (DARK_DN_PER_S / GAIN + (LIGHT_E_PER_S if kind == "light" else 0.0))
        shots = []
        for _ in range(frames):
            dn = offset + GAIN * rng.poisson(electrons, SHAPE) + READ_DN * rng.normal(size=SHAPE)
            shots.append((kind, exposure_s, np.uint16(dn.clip(0) + 0.5)))
        return shots

    groups = [*(take("dark", t) for t in dark_s), *(take("light", t) for t in light_s)]
    return calibrate(FrameSet.from_arrays([shot for group in groups for shot in group], bits=12))


CAMERA = PlainCamera(
    shape=SHAPE,
    gain=GAIN,
    black_dn=BLACK_DN,
    read_noise_e=READ_DN / GAIN,
    dsnu_dn=DSNU_DN,
    prnu=0.008,
    electrons_per_s=LIGHT_E_PER_S,
    dark_e_per_s=DARK_DN_PER_S / GAIN,
    dcnu=0.3,
    quantum_efficiency=0.5,
)

DARK_1 = (("dark", 0.01, 1),)
DARKS_1 = (("dark", 0.01, 1), ("dark", 0.1, 1), ("dark", 1.0, 1))
FLATS_1 = (("light", 0.01, 1), ("light", 0.02, 1), ("light", 0.04, 1))
FLATS = (("light", 0.01, 4), ("light", 0.02, 4), ("light", 0.03, 4), ("light", 0.04, 4))
DIM_FLATS = (("light", 0.003, 8), ("light", 0.006, 8), ("light", 0.012, 8))

NO_DARKS, SINGLE = "there are no dark frames", "each dark exposure has one frame"


def frames_of(
    *steps: tuple[Kind, float, int], camera: PlainCamera = CAMERA, disturbance: Disturbance | None = None, seed: int = 7
) -> FrameSet:
    protocol = ShootingProtocol("set", tuple(Step(*step) for step in steps))
    return camera.frame_set(protocol, disturbance or Disturbance(), seed)


def holds(estimate: Estimate, truth: float) -> None:
    # The uncertainties are below a tenth of the value.
    assert estimate.value == pytest.approx(truth, abs=3.5 * estimate.standard_uncertainty)
    assert estimate.standard_uncertainty < 0.1 * truth


def missing(calibration: Calibration, *names: str, reason: str = "") -> None:
    for name in names:
        estimate = getattr(calibration, name)
        assert estimate.value is None, name
        assert estimate.reason, name
        assert reason in estimate.reason, name


def given(calibration: Calibration) -> set[str]:
    return {name for name, entry in calibration.estimates().items() if entry.value is not None}


def test_dark_frames_of_one_exposure() -> None:
    calibration = measured((0.01,))
    holds(calibration.read_noise_dn, READ_DN)
    holds(calibration.dsnu_dn, DSNU_DN)
    holds(calibration.black_level_dn, BLACK_DN + 0.09)
    missing(
        calibration, "dark_current_dn_per_s", "dcnu_percent", "system_gain_dn_per_e", "prnu_percent", "read_noise_e"
    )


def test_clipped_dark_frames_of_one_exposure() -> None:
    calibration = measured((0.01,), black_dn=1.0)
    holds(calibration.read_noise_dn, READ_DN)
    holds(calibration.black_level_dn, 1.09)


def test_dark_frames_of_several_exposures() -> None:
    calibration = measured((0.01, 0.1, 1.0))
    holds(calibration.dark_current_dn_per_s, DARK_DN_PER_S)
    holds(calibration.read_noise_dn, READ_DN)
    missing(calibration, "dark_current_e_per_s", "system_gain_dn_per_e")


@pytest.mark.parametrize(("frames", "largest"), [(2, 0.02), (8, 0.007)])
def test_bias_frames_and_one_level_of_light(frames: int, largest: float) -> None:
    """The two-point method: K is the difference of the variances over the difference of the means."""
    calibration = measured((0.01,), (0.04,), frames)
    holds(calibration.system_gain_dn_per_e, GAIN)
    assert calibration.system_gain_dn_per_e.standard_uncertainty < largest * GAIN
    holds(calibration.read_noise_e, READ_DN / GAIN)
    missing(calibration, "prnu_percent", "saturation_dn", "linearity_error_percent", "dark_current_dn_per_s")
    assert limits(calibration)["few-light-levels"] == 1


@pytest.mark.parametrize("dark_e_per_s", [0.0, 1000.0])
def test_responsivity_includes_the_dark_current_that_one_exposure_leaves_open(dark_e_per_s: float) -> None:
    """A dark current of 1000 e-/s is 0.7 % of the light."""
    camera = replace(CAMERA, dark_e_per_s=dark_e_per_s)
    flats = [("light", 0.01 * t, 4) for t in range(1, 8)]
    for dark_s, largest in ((0.005, 0.02), (0.03, 0.012)):
        calibration = calibrate(frames_of(("dark", dark_s, 8), *flats, camera=camera))
        for estimate, truth in (
            (calibration.responsivity_dn_per_photon, 0.5 * GAIN),
            (calibration.quantum_efficiency_percent, 50.0),
        ):
            low, high = estimate.interval_95
            assert low < truth < high
            assert estimate.standard_uncertainty < largest * truth
        assert limits(calibration)["unknown-dark-current"] > 0.0
    calibration = calibrate(frames_of(("dark", 1e-5, 8), *flats, camera=camera))
    missing(calibration, "responsivity_dn_per_photon", "quantum_efficiency_percent", reason="dark current is not known")
    holds(calibration.system_gain_dn_per_e, GAIN)


def test_the_dark_current_that_one_exposure_leaves_open_is_that_of_all_channels() -> None:
    """Without dark current the truth is at the end of the interval in all three channels."""
    camera = replace(CAMERA, dark_e_per_s=0.0, cfa=cfa_from("rggb"))
    flats = [("light", 0.01 * t, 4) for t in range(1, 8)]
    found = calibrate(frames_of(("dark", 0.005, 8), *flats, camera=camera)).responsivity_dn_per_photon
    low, high = found.interval_95
    assert low < 0.5 * GAIN < high


def test_single_dark_frame() -> None:
    """The spread over pixels is an upper limit of read noise and of DSNU; hot pixels are listed."""
    disturbance = Disturbance(hot=(3.0 / math.prod(SHAPE), 2e4))
    calibration = calibrate(frames_of(*DARK_1, disturbance=disturbance, seed=11))
    # Noise and pattern are 2 DN, and their limit 9 DN.
    assert calibration.spatial["M"].dark.outliers.deviation == pytest.approx([60.0, 60.0, 60.0], rel=0.2)
    calibration = calibrate(frames_of(*DARK_1))
    assert given(calibration) == {"black_level_dn"}
    holds(calibration.black_level_dn, BLACK_DN + 0.01 * DARK_DN_PER_S)
    missing(calibration, "read_noise_dn", "dsnu_dn", "dsnu1288_e")
    spread = math.hypot(READ_DN, DSNU_DN)
    for estimate in (calibration.read_noise_dn, calibration.dsnu_dn):
        assert SINGLE in estimate.reason
        assert spread < estimate.upper_limit_95 < 1.1 * spread
    missing(calibration, "system_gain_dn_per_e", "prnu_percent", reason="no light frames")
    assert "unknown-dark-noise" in limits(calibration)
    assert calibrate(frames_of(*DARK_1), maps=True).no_maps_reason.startswith(SINGLE)


def test_single_dark_frame_clipped_at_0() -> None:
    camera = PlainCamera(**{**vars(CAMERA), "black_dn": 1.0})
    calibration = calibrate(frames_of(*DARK_1, *FLATS, camera=camera))
    missing(calibration, "black_level_dn", "read_noise_dn", reason="the dark frames are clipped at 0")
    holds(calibration.system_gain_dn_per_e, GAIN)


def test_single_dark_frames_of_several_exposures() -> None:
    calibration = calibrate(frames_of(*DARKS_1))
    assert given(calibration) == {"black_level_dn", "dark_current_dn_per_s"}
    holds(calibration.black_level_dn, BLACK_DN)
    holds(calibration.dark_current_dn_per_s, DARK_DN_PER_S)
    missing(calibration, "dcnu_percent", reason=SINGLE)


def test_single_dark_frames_and_flat_fields() -> None:
    """The gain is the slope of variance against mean; the spread of the dark slopes widens PRNU."""
    calibration = calibrate(frames_of(*DARKS_1, *FLATS))
    for name, truth in {
        "black_level_dn": BLACK_DN,
        "dark_current_e_per_s": DARK_DN_PER_S / GAIN,
        "system_gain_dn_per_e": GAIN,
        "prnu_percent": 0.8,
        "responsivity_dn_per_photon": 0.5 * GAIN,
        "quantum_efficiency_percent": 50.0,
    }.items():
        holds(getattr(calibration, name), truth)
    missing(calibration, "temporal_dark_noise_e", "sensitivity_threshold_photons", "prnu1288_percent")
    assert READ_DN / GAIN < calibration.read_noise_e.upper_limit_95 < 1.2 * READ_DN / GAIN

    calibration = calibrate(frames_of(*DARK_1, *FLATS))
    holds(calibration.system_gain_dn_per_e, GAIN)
    missing(calibration, "prnu_percent", "responsivity_dn_per_photon", reason="dark current that is not known")


def test_one_frame_of_each_level() -> None:
    calibration = calibrate(frames_of(*DARKS_1, *FLATS_1))
    assert given(calibration) == {"black_level_dn", "dark_current_dn_per_s", "responsivity_dn_per_photon"}
    holds(calibration.responsivity_dn_per_photon, 0.5 * GAIN)
    missing(calibration, "system_gain_dn_per_e", "prnu_percent", reason="two frames")


@pytest.mark.parametrize("cfa", [(("M",),), (("R", "G"), ("G", "B"))])
def test_flat_fields_without_dark_frames(cfa: tuple[tuple[str, ...], ...]) -> None:
    camera = PlainCamera(**{**vars(CAMERA), "cfa": cfa})
    calibration = calibrate(frames_of(*FLATS, camera=camera))
    assert given(calibration) == {"system_gain_dn_per_e"}
    holds(calibration.system_gain_dn_per_e, GAIN)
    dark = ("black_level_dn", "read_noise_dn", "dsnu_e", "dark_current_dn_per_s", "temporal_dark_noise_e")
    missing(calibration, *dark, "prnu_percent", "responsivity_dn_per_photon", reason=NO_DARKS)
    assert "unknown-dark-noise" in limits(calibration)
    # Within 10 ms, dark current is negligible.
    calibration = calibrate(frames_of(*DIM_FLATS, camera=camera))
    for name, truth in {
        "system_gain_dn_per_e": GAIN,
        "prnu_percent": 0.8,
        "responsivity_dn_per_photon": 0.5 * GAIN,
        "quantum_efficiency_percent": 50.0,
    }.items():
        assert getattr(calibration, name).value == pytest.approx(
            truth, abs=3.5 * getattr(calibration, name).standard_uncertainty
        )
    missing(calibration, "black_level_dn", "saturation_capacity_e", "linearity_error_percent")


def test_brighter_fatter_noise_is_within_the_uncertainty_of_the_gain() -> None:
    """0.2 % of the charge moves to each next pixel at 10 000 electrons; the straight line is 1.4 % low."""

    def fatter(charge: NDArray[np.float64], rng: np.random.Generator, frame: int) -> NDArray[np.float64]:
        fraction = 0.002 * charge.mean() / 1e4
        next_pixels = np.array([[0.0, 1.0, 0.0], [1.0, -4.0, 1.0], [0.0, 1.0, 0.0]])
        return np.asarray(charge + fraction * convolve(charge, next_pixels, mode="nearest"))

    camera = replace(CAMERA, electrons_per_s=1e5)
    flats: list[tuple[Kind, float, int]] = [("light", t, 8) for t in (0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1)]
    for seed in range(3):
        frames = frames_of(*flats, camera=camera, disturbance=Disturbance(charge=fatter), seed=seed)
        gain = calibrate(frames).system_gain_dn_per_e
        assert gain.value == pytest.approx(GAIN, abs=2.5 * gain.standard_uncertainty)
        assert 0.005 * GAIN < gain.standard_uncertainty < 0.012 * GAIN


def test_saturation_without_dark_frames() -> None:
    calibration = calibrate(frames_of(*FLATS, ("light", 0.2, 4)))
    assert calibration.saturation_dn.value == 4095.0
    missing(calibration, "saturation_capacity_e", "linearity_error_percent", "snr_max_db", reason=NO_DARKS)
    holds(calibration.system_gain_dn_per_e, GAIN)


@pytest.mark.parametrize("steps", [(("light", 0.02, 1),), (("light", 0.02, 4),)])
def test_one_level_of_light_and_nothing_else(steps: tuple[tuple[Kind, float, int], ...]) -> None:
    calibration = calibrate(frames_of(*steps))
    assert given(calibration) == set()
    missing(calibration, *calibration.estimates())
    mean = BLACK_DN + 0.02 * (GAIN * LIGHT_E_PER_S + DARK_DN_PER_S)
    assert calibration.linear_range["M"].highest_dn == pytest.approx(mean, rel=1e-3)
    assert "unknown-dark-noise" in limits(calibration)


@pytest.mark.parametrize(("size", "power"), [(-0.05, 2), (-0.04, 3)])
def test_bent_response_without_dark_frames(size: float, power: int) -> None:
    """A bend and a light out of proportion look alike: the interval holds both."""
    steps = [("light", 0.08 * i / 12, 6) for i in range(1, 9)]
    disturbance = Disturbance(charge=bent(size, power, (4095 - BLACK_DN) / GAIN))
    calibration = calibrate(frames_of(*steps, disturbance=disturbance))
    low, high = calibration.system_gain_dn_per_e.interval_95
    assert low < GAIN < high
    assert "bend-or-light" in limits(calibration)


def test_smoothed_frames_without_dark_frames() -> None:
    disturbance = Disturbance(numbers=convolved([[0.0, 0.1, 0.0], [0.1, 0.6, 0.1], [0.0, 0.1, 0.0]]))
    calibration = calibrate(frames_of(*FLATS, disturbance=disturbance))
    missing(calibration, "system_gain_dn_per_e", "prnu_percent", reason="the noise is correlated between neighboring")


SETS = {
    "dark frame": DARK_1,
    "dark frame, flat fields": (*DARK_1, *FLATS),
    "single frames": (*DARKS_1, *FLATS_1),
    "flat fields": FLATS,
    "flat field": FLATS[:1],
}


@pytest.mark.parametrize("steps", SETS.values(), ids=list(SETS))
def test_results_of_incomplete_sets_are_shown_and_saved(steps: tuple[tuple[Kind, float, int], ...]) -> None:
    calibration = calibrate(frames_of(*steps))
    found = json.loads(json.dumps(calibration.to_dict(), allow_nan=False))
    for entry in (*found["parameters"].values(), *found["emva1288"].values()):
        assert entry["value"] is not None or entry["reason"]
    xml = ElementTree.fromstring(emva_results(calibration))
    value, reason = xml.findtext("sensitivity/u_p_min/value"), xml.findtext("sensitivity/u_p_min/reason")
    assert (value, bool(reason)) == ("None", True)
    assert repr(calibration)
    assert calibration._repr_html_()
    assert len(calibration.to_dataframe()) == len(found["parameters"])
    for kind in calibration.curves["M"]:
        calibration.plot(kind)


@pytest.mark.slow
@pytest.mark.parametrize("steps", SETS.values(), ids=list(SETS))
def test_reports_of_incomplete_sets(steps: tuple[tuple[Kind, float, int], ...], tmp_path: Path) -> None:
    calibrate(frames_of(*steps)).report(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert (NO_DARKS if steps[0][0] == "light" else SINGLE) in text


def test_a_saved_file_warns_of_assumed_values_that_remain(tmp_path: Path) -> None:
    known = ps.load_sensor("nikon-d200")
    known = known.with_(cfa="mono", channels={"M": known.channels["G"]})
    gain = replace(known.measured("conversion_gain_uv_per_e"), assumed=True)
    well = replace(known.measured("well_capacity_e"), assumed=True)
    base = known.with_(conversion_gain_uv_per_e=gain, well_capacity_e=well)
    single = frames_of(("dark", 0.01, 4), ("dark", 0.1, 4), *FLATS_1)
    with pytest.warns(PhotositeWarning) as caught:
        calibrate(single, base).save(tmp_path / "single.sensor.yaml")
    [text] = [str(each.message) for each in caught if "assumed" in str(each.message)]
    assert "conversion_gain_uv_per_e" in text
    assert "well_capacity_e" in text
    assert "read_noise_mv" not in text
    assert ps.load_sensor(tmp_path / "single.sensor.yaml").measured("well_capacity_e") == well


def test_a_channel_of_unknown_dark_current_leaves_no_mean_responsivity() -> None:
    """Green has two levels below saturation; red and blue bend by a dark current of 36 DN/s, which is not known.

    Before, the responsivity was that of green alone, 20 % above the mean, and the bend was blamed on lamp and shutter.
    """
    flats = [("light", 0.09 * t, 8) for t in range(1, 5)]
    camera = replace(CAMERA, cfa=cfa_from("grbg"), gain=0.66, black_dn=173.0, read_noise_e=12.6, dsnu_dn=3.9)
    camera = replace(camera, electrons_per_s=6146.0, dark_e_per_s=55.0, shape=(70, 74))
    color = np.tile([[1.0, 0.75], [0.6, 1.0]], (35, 37))
    change = Disturbance(
        light=lambda values, *_: np.asarray(values * color), charge=lambda values, *_: np.minimum(values, 2004.0)
    )
    found = calibrate(frames_of(("dark", 0.09, 8), *flats, camera=camera, disturbance=change))
    assert found.channels["R"].responsivity_dn_per_photon.reason_id == "unknown-dark-current"
    assert found.responsivity_dn_per_photon.reason_id == "unknown-dark-current"
    assert found.quantum_efficiency_percent.reason_id == "unknown-dark-current"
    assert "unclear-bend" not in limits(found)
