"""Image quality of simulated cameras against the truth that the simulator knows."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.errors import InputError
from photosite.studies import simulated_charts
from photosite.studies.simulated_charts import ChartConditions, image_quality, measure_camera
from photosite.studies.sweep_file import load_sweep


@pytest.fixture(scope="module")
def camera() -> ps.Camera:
    sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=100)
    return ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)


def test_noise_is_the_budget_of_the_sensor(camera: ps.Camera) -> None:
    found = measure_camera(camera, ChartConditions(8, 3), charts=["macbeth"], only=["noise"]).charts["macbeth"]["noise"]
    sensor = camera.sensor
    white_e = (4095 - 100) / sensor.system_gain_dn_per_e
    budget = ps.noise_budget(sensor, [0.18 * white_e * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6])
    low, high = found["snr_18_db", "G"].interval_95 or (math.nan, math.nan)
    assert low - 0.1 < float(budget.total_db[0]) < high + 0.1


def test_response_without_noise_is_that_with_noise(camera: ps.Camera) -> None:
    charts = {"charts": ["slanted-edge"], "only": ["edge-sfr"]}
    clean, noisy = (measure_camera(camera, ChartConditions(n), **charts).charts["slanted-edge"] for n in (0, 4))
    low, high = noisy["edge-sfr"]["mtf50", "G"].interval_95 or (math.nan, math.nan)
    truth = clean["edge-sfr"]["mtf50", "G"].value
    assert truth is not None
    assert low < truth < high


def test_ranges_take_focal_length_and_pixel_width_from_the_camera(camera: ps.Camera) -> None:
    faint = {"target-detection": {"contrast": 0.01}}
    chosen = {"charts": ["slanted-edge"], "only": ["target-detection"], "options": faint}
    found = measure_camera(camera, ChartConditions(2), **chosen)
    result = found.charts["slanted-edge"]["target-detection"]
    resolved, distance = (result[name, "G"].value for name in ("resolved", "identification_range"))
    assert resolved is not None
    width_um, focal_mm = camera.sensor.pixel.width_um.value, 50.0
    # 8 cycles over a target of 2.3 m, whose image is focal length over distance as large.
    assert distance == pytest.approx(resolved * 2.3 * focal_mm * 1e-3 / (8 * width_um * 1e-6))


def test_two_measurements_of_one_chart_need_two_views(camera: ps.Camera) -> None:
    found = measure_camera(camera, ChartConditions(2), charts=["siemens-star"], only=["oecf", "star-sfr"])
    found = found.charts["siemens-star"]
    assert set(found.results) == {"oecf", "star-sfr"}


def test_unknown_charts_are_refused(camera: ps.Camera) -> None:
    with pytest.raises(InputError):
        measure_camera(camera, charts=["zone-plate"])
    with pytest.raises(InputError):
        measure_camera(camera, charts=["macbeth"], only=["edge-sfr"])
    for options in ({"edgesfr": {"order": 1}}, {"edge-sfr": {"order": 1}}):
        with pytest.raises(InputError):
            measure_camera(camera, ChartConditions(0), charts=["uniform"], options=options)


def test_columns_of_a_sweep(camera: ps.Camera) -> None:
    """A smaller aperture blurs more, by more than the noise; the noise at 18 % of saturation is the same."""
    found = ps.studies.sweep(
        camera,
        {"f_number": [4, 16]},
        partial(image_quality, values=["edge-sfr.mtf50.G", "noise.snr_18_db.G"], frames=2),
        progress=False,
    )
    sharp, spread = found["edge-sfr.mtf50.G"], found["u(edge-sfr.mtf50.G)"]
    assert sharp[0] - sharp[1] > 5 * math.hypot(*spread)
    assert abs(np.diff(found["noise.snr_18_db.G"])[0]) < 0.3


def test_names_of_columns_are_checked(camera: ps.Camera) -> None:
    for values in (["edge-sfr.mtf51"], ["edgesfr.mtf50"], ["mtf50"]):
        with pytest.raises(InputError):
            image_quality(camera, values=values)


def test_light_of_the_charts_is_swept(camera: ps.Camera, tmp_path: Path) -> None:
    """At a fixed exposure time, contrast is detected more often in more light."""
    name = "contrast-detection.probability.G, neutral 3.5 and neutral 5"
    file = tmp_path / "a.sweep.yaml"
    file.write_text(
        "photosite_sweep: 1\ncamera: {sensor: nikon-d200, optics: {f_number: 8, focal_length_mm: 50}}\n"
        f"values: {{rows: [264], cols: [392], mean_luminance_cd_m2: [20, 200]}}\n"
        f"measure: {{image_quality: {{values: ['{name}'], frames: 2, exposure: 1/200}}}}\n"
    )
    wanted = load_sweep(file)
    dim, bright = ps.studies.sweep(wanted.camera, wanted.values, wanted.measure, scene=wanted.scene)[name]
    assert dim < 0.4 < 0.9 < bright
    with pytest.raises(InputError):
        image_quality(camera, ps.charts.macbeth("D65", 40), values=[name])


def test_a_camera_without_a_value_does_not_end_a_sweep(camera: ps.Camera, tmp_path: Path) -> None:
    """An edge behind f/200 is wider than its profile: no MTF50, with the reason; the checkpoint keeps estimates."""
    arguments = (camera, {"f_number": [8, 200]}, partial(image_quality, values=["edge-sfr.mtf50"], frames=2))
    found = ps.studies.sweep(*arguments, checkpoint=tmp_path / "kept", progress=False)
    assert found.values == ("edge-sfr.mtf50.R", "edge-sfr.mtf50.G", "edge-sfr.mtf50.B")
    value, low, high = (found[name] for name in ("edge-sfr.mtf50.G", "low(edge-sfr.mtf50.G)", "high(edge-sfr.mtf50.G)"))
    assert low[0] < value[0] < high[0]
    assert np.isnan([value[1], low[1], high[1]]).all()
    assert ["f_number = 200" in note for note in found.notes] == [True] * 3
    again = ps.studies.sweep(*arguments, checkpoint=tmp_path / "kept", progress=False)
    assert repr((again.rows, again.notes)) == repr((found.rows, found.notes))
    axes = found.plot()
    assert axes.get_ylabel() == "edge-sfr: MTF50, B (cycles/pixel)"
    assert tuple(axes.collections[0].get_paths()[0].vertices[:, 1]) == (
        found["low(edge-sfr.mtf50.B)"][0],
        found["high(edge-sfr.mtf50.B)"][0],
    )


def test_comparisons_take_values_of_image_quality() -> None:
    sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=100)
    lenses = {f"f/{n}": ps.DiffractionLimited(f_number=n, focal_length_mm=50) for n in (4, 16)}
    values = ["edge-sfr.mtf50.G"]
    cameras = {name: ps.Camera(lens, sensor) for name, lens in lenses.items()}
    found = ps.studies.compare_cameras(cameras, values=values)
    sharp, blurred = (each["edge-sfr.mtf50.G"] for each in found.facts().values())
    assert sharp > 1.5 * blurred
    assert "edge-sfr.mtf50.G" in str(found)
    mono = sensor.with_(cfa=(("G",),), channels={"G": sensor.channels["G"]})
    of_sensors = ps.studies.compare_sensors({"color": sensor, "mono": mono}, values=["edge-sfr.mtf50"])
    facts = of_sensors.facts()
    assert facts["mono"]["edge-sfr.mtf50.R"] is None
    assert facts["color"]["edge-sfr.mtf50.R"] is not None
    content = of_sensors.to_dict()["quality"]
    red = content["color"]["edge-sfr.mtf50.R"]
    assert red["unit"] == "cycles/pixel"
    assert red["interval_95"][0] < red["value"] < red["interval_95"][1]
    assert content["mono"]["edge-sfr.mtf50.R"]["reason"]


def test_dark_current_is_no_signal(camera: ps.Camera) -> None:
    """The range is what dark current leaves, over the signal that equals read noise and the shot noise of both."""
    sensor = camera.sensor.with_(dark_current_e_per_s=400)
    warm = ps.Camera(camera.optics, sensor)
    conditions = ChartConditions(16, 1, luminance_cd_m2=4.0, exposure_s=2.0)
    found = measure_camera(warm, conditions, charts=["macbeth"], only=["noise"]).charts["macbeth"]["noise"]
    gain, dark_e = sensor.system_gain_dn_per_e, 800.0
    read_e = sensor.electrons(sensor.noise.read_noise_mv.value)
    floor = read_e**2 + dark_e + 1.0 / 12.0 / gain**2
    least = 0.5 + math.sqrt(0.25 + floor)  # S^2 = S + floor
    truth = 20.0 * math.log10(((4095 - 100) / gain - dark_e) / least)
    low, high = found["dynamic_range_db", "G"].interval_95 or (math.nan, math.nan)
    assert low < truth < high
    given = {"noise": {"dark_signal": 0.0}}
    raw = measure_camera(warm, conditions, charts=["macbeth"], only=["noise"], options=given)
    as_signal = raw.charts["macbeth"]["noise"]["dynamic_range_db", "G"].value
    assert as_signal is not None
    assert as_signal - truth > 3.0


def test_a_part_of_a_large_field_shows_responses_of_lenses_that_blur_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """The middle has the MTF50 of the whole; a lens that blurs the corners more is refused with what to do."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=600, cols=800, black_level_dn=100)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    chosen = {"values": ["sfr-map.mtf50"], "frames": 0}
    whole = image_quality(camera, **chosen)["sfr-map.mtf50.field"].value
    monkeypatch.setattr(simulated_charts, "_MOST_FIELD_CELLS", 25 * 420 * 560)
    seen = simulated_charts.seen_chart(camera, "slanted-squares", "field", ChartConditions(0))
    assert seen.mean_electrons.shape == (420, 560)
    assert image_quality(camera, **chosen)["sfr-map.mtf50.field"].value == pytest.approx(whole, rel=5e-3)
    distorted = ps.Lens(camera.optics, distortion=ps.optics.Distortion.polynomial(-0.1))
    monkeypatch.setattr(simulated_charts, "_MOST_FIELD_CELLS", 9 * 420 * 560)
    with pytest.raises(InputError) as caught:
        image_quality(ps.Camera(distorted, sensor), **chosen)
    assert caught.value.value == 480_000
    assert caught.value.hint
