"""Sensors behind the same lens: closed forms, frames, the page and the table."""

from __future__ import annotations

import math
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot

import photosite as ps
from photosite.errors import InputError
from photosite.studies.sensor_comparison import sensor_figures

NAMES = ("nikon-d200", "vendor-2.2um")


@pytest.fixture(scope="module")
def found() -> Any:
    return ps.studies.compare_sensors({name: ps.load_sensor(name) for name in NAMES})


def test_snr10_is_where_the_ratio_is_ten(found: Any) -> None:
    for facts in found.sensors.values():
        at = np.array([facts.snr10_cd_m2])
        assert float(facts.snr_db(at)[0]) == pytest.approx(20.0, abs=1e-9)
        assert facts.snr10_lux == pytest.approx(math.pi * at[0] / 0.18)
    ordered = [facts.snr10_lux for facts in found.sensors.values()]
    assert ordered == sorted(ordered)


def test_snr10_of_a_sensor_without_dark_noise_is_that_of_100_electrons() -> None:
    quiet = ps.load_sensor("vendor-2.2um").with_(read_noise_mv=0, dsnu_mv=0, prnu_percent=0, bits=16)
    facts = ps.studies.compare_sensors({"quiet": quiet}).sensors["quiet"]
    assert facts.snr10_cd_m2 * facts.electrons_per_cd_m2 == pytest.approx(100.0, rel=1e-3)
    assert facts.snr_max_db == pytest.approx(10 * math.log10(quiet.saturation_capacity_e), abs=1e-3)
    # The threshold of EMVA 1288 for no dark noise but a little rounding is about one electron.
    assert facts.dynamic_range_db == pytest.approx(20 * math.log10(quiet.saturation_capacity_e), abs=0.2)


def test_figures_by_hand() -> None:
    """An ideal sensor under CIE A, with the sums of radiometry and of EMVA 1288 written out once more.

    1 cd/m2 is 683 lm/W times the integral of radiance and V(lambda); pi / (1 + 4 N^2) of it reaches the sensor.
    """
    import colour

    grid = np.arange(380.0, 781.0)
    energy = colour.SDS_ILLUMINANTS["A"].copy().interpolate(colour.SpectralShape(380, 780, 1)).values
    seen = colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"].copy().align(colour.SpectralShape(380, 780, 1)).values
    radiance = energy / (683.002 * np.trapezoid(energy * seen, grid))
    photons = radiance * grid * 1e-9 / (6.62607015e-34 * 299792458.0)
    rate = 0.5 * np.trapezoid(photons, grid) * np.pi / (1 + 4 * 4.0**2) * (2e-6) ** 2
    flat = {"wavelength_nm": (380.0, 780.0), "quantum_efficiency": (0.5, 0.5)}
    sensor = ps.load_sensor("sony-imx174").with_(
        channels={"M": flat},
        pitch_um=2.0,
        bits=12,
        black_level_dn=95,
        full_well_e=9000,
        read_noise_e=3.0,
        dsnu_e=2.0,
        prnu_percent=0.0,
        dark_current_e_per_s=500.0,
        system_gain_dn_per_e=0.5,
    )
    facts = ps.studies.compare_sensors({"a": sensor}, f_number=4, exposure_s=2.0, illuminant="A").sensors["a"]
    assert facts.electrons_per_cd_m2 == pytest.approx(2.0 * rate, rel=2e-3)
    # 4000 DN / 0.5 are 8000 electrons, of which the dark current takes 1000.
    assert facts.saturation_cd_m2 == pytest.approx(7000 / (2.0 * rate), rel=2e-3)
    temporal_e2 = 3.0**2 + 1000.0 + 1 / 12 / 0.5**2
    assert facts.dynamic_range_db == pytest.approx(20 * math.log10(7000 / (math.sqrt(temporal_e2 + 0.25) + 0.5)))
    assert facts.snr_max_db == pytest.approx(20 * math.log10(7000 / math.sqrt(7000 + temporal_e2 + 2.0**2)))
    # S^2 = 100 (S + D)
    signal_e = 50 + math.sqrt(2500 + 100 * (temporal_e2 + 4.0))
    assert facts.snr10_lux == pytest.approx(signal_e / (2.0 * rate) * math.pi / 0.18, rel=2e-3)


def test_light_beyond_the_table_of_an_illuminant_is_missing_with_a_warning() -> None:
    """CIE D65 ends at 830 nm: a sensor that responds to 1000 nm has the signal of one to 830 nm, and a warning."""
    found = {}
    for last in (830.0, 1000.0):
        flat = {"wavelength_nm": (380.0, last), "quantum_efficiency": (0.5, 0.5)}
        mono = ps.load_sensor("vendor-2.2um").with_(cfa=(("M",),), channels={"M": flat})
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found[last] = ps.studies.compare_sensors({"m": mono}, illuminant="D65").sensors["m"].electrons_per_cd_m2
        assert len(caught) == (last > 830.0)
    assert found[1000.0] == pytest.approx(found[830.0], rel=1e-3)
    with pytest.raises(InputError) as error:
        ps.studies.compare_sensors({"a": ps.load_sensor("vendor-2.2um")}, illuminant="D66")
    assert error.value.what == "illuminant"


def test_limits_that_are_not_reached() -> None:
    sensor = ps.load_sensor("vendor-2.2um")
    patterned, shallow = sensor.with_(prnu_percent=15), sensor.with_(well_capacity_e=200)
    found = ps.studies.compare_sensors({"patterned": patterned, "shallow": shallow})
    assert [facts.snr10_lux for facts in found.sensors.values()] == [None, None]
    assert "not reached" in _page(found)


def test_curves_end_at_saturation(found: Any) -> None:
    curves = found.snr_db()
    for label, facts in found.sensors.items():
        known = np.isfinite(curves[label])
        assert (found.luminance_cd_m2[known] <= facts.saturation_cd_m2 * (1 + 1e-9)).all()
        assert (np.diff(curves[label][known]) > 0).all()
    assert found.to_dict()["snr_db"]["nikon-d200"][-1] is None or found.to_dict()["snr_db"]["vendor-2.2um"][-1] is None
    assert len(found.plot().get_lines()) == 2 * len(NAMES) + 2
    pyplot.close("all")


def test_a_monochrome_near_infrared_sensor_sees_sunlight() -> None:
    channel = {"wavelength_nm": (355.0, 700.0, 1000.0), "quantum_efficiency": (0.5, 0.6, 0.2)}
    mono = ps.load_sensor("vendor-2.2um").with_(cfa=(("M",),), channels={"M": channel})
    sun, day = (
        ps.studies.compare_sensors({"mono": mono}, illuminant=light).sensors["mono"] for light in ("sunlight", 5500.0)
    )
    assert sun.channel == "M"
    assert sun.electrons_per_cd_m2 == pytest.approx(day.electrons_per_cd_m2, rel=0.2)


def test_invalid_conditions() -> None:
    sensor = ps.load_sensor("vendor-2.2um")
    warm = sensor.with_(dark_current_e_per_s=1e4)
    for options in ({"f_number": 0.1}, {"exposure_s": 0}, {"exposure_s": 1}):
        with pytest.raises(InputError) as caught:
            ps.studies.compare_sensors({"a": warm}, **options)
        assert caught.value.what in options
    with pytest.raises(InputError) as caught:
        ps.studies.compare_sensors({})
    assert caught.value.what == "sensors"


def _page(found: Any) -> str:
    from photosite.report.write import render_page
    from photosite.studies.sensor_comparison import comparison_page

    return render_page(comparison_page(found))


def test_report_is_a_page(found: Any, tmp_path: Path, read_page: Any) -> None:
    found.report(tmp_path / "sensors.html")
    text = (tmp_path / "sensors.html").read_text(encoding="utf-8")
    page = read_page(text)
    assert all(name in text for name in NAMES)
    assert len(page.images("image/svg+xml")) == 1
    assert [row[0] for row in page.rows][-1] == "Saturates at (cd/m²)"


@pytest.fixture(scope="module")
def automotive() -> Any:
    return ps.studies.compare_sensors({"automotive": ps.load_sensor("split-pixel-automotive")})


@pytest.mark.parametrize("luminance_cd_m2", [0.5, 29.0, 100.0, 115.0, 200.0, 4000.0])
def test_several_captures_are_judged_by_their_combined_frame(automotive: Any, luminance_cd_m2: float) -> None:
    """The ratio of green pixels of one frame, at a false-alarm rate of 1e-4 for each luminance."""
    facts = automotive.sensors["automotive"]
    sensor = facts.sensor.with_(rows=200, cols=200)
    mean = np.full((200, 200), luminance_cd_m2 * facts.electrons_per_cd_m2, np.float32)
    camera = ps.Camera(ps.DiffractionLimited(f_number=2.8, focal_length_mm=50), sensor)
    rule = sensor.captures.combination
    dn = camera.expose(mean, facts.exposure_s, seed=3).dn
    light = (rule.companding.decompand(dn) - rule.black_level_dn.value) / rule.dn_per_e.value
    squares = (light - light.mean()) ** 2
    # Of the variance, as a fraction; the ratio has half of it.
    uncertainty_db = 10.0 / math.log(10.0) * float(squares.std() / squares.mean()) / light.size**0.5
    measured_db = 10.0 * math.log10(float(mean[0, 0]) ** 2 / float(squares.mean()))
    assert abs(float(facts.snr_db(np.array([luminance_cd_m2]))[0]) - measured_db) < 3.9 * uncertainty_db


def test_figures_of_several_captures(automotive: Any) -> None:
    """The automotive sensor has 790 000 electrons of light and 0.83 electrons of read noise."""
    facts = automotive.sensors["automotive"]
    sensor = facts.sensor
    assert facts.to_dict()["saturation_capacity_e"] == pytest.approx(790000.0)
    small_dark_e = sensor.captures["small"].dark_current_e_per_s.value * facts.exposure_s
    capacity_e = 790000.0 - 100.0 * small_dark_e
    assert facts.saturation_cd_m2 * facts.electrons_per_cd_m2 == pytest.approx(capacity_e)
    dark_e = sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value) * facts.exposure_s
    # Output steps of 1/16 electron.
    dark_e2 = 0.83**2 + dark_e + 1 / 12 / sensor.system_gain_dn_per_e**2 + 1 / 12 / 16**2
    threshold_e = 0.5 + math.sqrt(0.25 + dark_e2)
    assert facts.dynamic_range_db == pytest.approx(20 * math.log10(capacity_e / threshold_e), abs=0.01)
    assert float(facts.snr_db(np.array([facts.snr10_cd_m2]))[0]) == pytest.approx(20.0, abs=1e-6)
    switches = [step["luminance_cd_m2"] for step in automotive.to_dict()["transitions"]["automotive"]]
    assert switches == pytest.approx(facts.switches_cd_m2)
    # At the switch to the small photodiode, its shot noise is 20 dB more.
    before, after = (float(facts.snr_db(np.array([switches[1] * x]))[0]) for x in (0.9, 1.1))
    assert before == pytest.approx(facts.snr_max_db, abs=0.3)
    assert after < before - 15
    assert facts.to_dict()["captures_switch_cd_m2"] == "29.38, 119.9"
    above, below = facts.snr_db(facts.saturation_cd_m2 * np.array([1.01, 0.99]))
    assert np.isnan(above)
    assert np.isfinite(below)


def test_report_states_the_switches(automotive: Any, tmp_path: Path, read_page: Any) -> None:
    automotive.report(tmp_path / "a.html")
    rows = read_page((tmp_path / "a.html").read_text(encoding="utf-8")).rows
    assert ["Captures switch at (cd/m²)", "29.38, 119.9"] in [list(row) for row in rows]


def test_snr_and_sweeps_use_the_combined_frame() -> None:
    sensor = ps.load_sensor("split-pixel-automotive")
    camera = ps.Camera(ps.DiffractionLimited(f_number=2.8, focal_length_mm=50), sensor)
    light = {"exposure_s": 1 / 15, "illuminant": "3200K"}
    facts = ps.studies.compare_sensors({"a": sensor}).sensors["a"]
    found = ps.studies.snr(camera, luminance_cd_m2=100.0, **light)
    assert found["snr_db"] == pytest.approx(float(facts.snr_db(np.array([100.0]))[0]), abs=1e-9)
    assert found["snr_db"] > 30
    assert [found["switch_1_e"], found["switch_2_e"]] == [each.light_e for each in facts.transitions]
    table = ps.studies.sweep(camera, {"f_number": [2.8, 5.6]}, partial(sensor_figures, **light))
    assert table["dynamic_range_db"] == pytest.approx([facts.dynamic_range_db] * 2, abs=1e-6)
    assert table["switch_2_cd_m2"][1] == pytest.approx(
        (1 + 4 * 5.6**2) / (1 + 4 * 2.8**2) * table["switch_2_cd_m2"][0], rel=1e-3
    )
