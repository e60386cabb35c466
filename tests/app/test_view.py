"""The picture on the page: previews are close to the frame, the exact frame is that of the library and the command."""

from __future__ import annotations

import json
import shlex
import time
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.app.copy_text import command_text, python_text
from photosite.app.exact_frame import exact_frame
from photosite.app.form import parameters_of
from photosite.app.kept_scenes import scene_of
from photosite.app.places import Places
from photosite.app.preview_light import approximate_rate
from photosite.app.preview_sensor import of_size
from photosite.app.state import CameraState, prepared
from photosite.app.view import view_bytes
from photosite.app.view_pixels import View, view_pixels
from photosite.cli.main import run
from photosite.engine.mosaic_means import mosaic_means

SMALL = {"rows": 130, "cols": 194}
BLINKING = {"fraction": 0.01, "amplitude_e": 20}
DARK = {"dark_current_temperature_c": 25, "dark_doubling_c": 6, "dark_current_e_per_s": 40}
STATES = [
    {"sensor": {"changes": SMALL}},
    {
        "scene": {"source": "siemens-star", "illuminant": "led 4000", "options": {"cycles": 24}},
        "lens": {"f_number": 2.8, "focal_length_mm": 35, "transmittance": 0.9, "falloff": "cos4"},
        "sensor": {
            "changes": SMALL | {"read_noise_e": 3.5, "serial": "7", "telegraph_noise": BLINKING}
        },
        "capture": {"exposure_s": 0.0123, "seed": 5},
    },
    {
        "sensor": {"source": "sony-imx174", "changes": SMALL | DARK},
        "scene": {"source": "slanted-edge", "distance_m": 2.5, "options": {"contrast": 8.5}},
        "capture": {"temperature_c": 37.5, "cells_per_pixel": 3, "exposure_s": 1 / 125},
    },
    {"sensor": {"changes": SMALL}, "capture": {"noise": False}},
    {
        "scene": {
            "flicker": {"kind": "pulse", "frequency_hz": 130, "duty": 0.3, "phase_deg": 75},
            "motion": {"cols_per_s": 300, "rotation_deg_per_s": 5, "scale_per_s": 0.1},
        },
        "sensor": {"changes": SMALL | {
            "shutter": {"kind": "rolling", "line_time_us": 60},
            "infrared_filter": {"wavelength_nm": [380, 640, 700, 1100], "transmittance": [0.95, 0.95, 0, 0]},
            "crosstalk": {"electrical": {key: [[0, 0.01, 0], [0.01, 0.96, 0.01], [0, 0.01, 0]] for key in "RGB"}},
            "response_curve": {"charge_e": [0, 20000, 40000], "deviation_percent": [0, -0.4, -1.9]},
        }},
        "capture": {"exposure_s": 0.004},
    },
    {
        "scene": {"flicker": {"kind": "table", "frequency_hz": 99.5, "table": [1, 2.7, 0.4]}},
        "sensor": {"changes": SMALL | {
            "cfa": "mono", "shutter": {"line_time_us": 40},
            "channels": {"M": {"wavelength_nm": [400, 550, 700], "quantum_efficiency": [0.2, 0.6, 0.3]}},
        }, "binning": {"factor": 2, "kind": "mean"}},
        "capture": {"exposure_s": 0.003, "noise": False},
    },
    {
        "sensor": {"changes": SMALL | {"captures": {
            "parts": [{"name": "long"}, {"name": "short", "relative_exposure": 0.0625, "read_noise_e": 9}],
            "combination": {"dn_per_e": 1.5, "bits": 16},
        }}},
    },
    {
        "lens": {
            "f_number": 4, "focus_distance_m": 1.15,
            "blur": {"zernike": {"11": 60, "4": 30}, "pupil": {"obscuration": 0.3}, "chromatic_focus": {}},
            "relative_illumination": {"places_are": "height_mm", "places": [0, 0.5, 2], "relative": [1, 0.8, 0.6]},
            "distortion": {"k1": -0.2, "k2": 0.1}, "lateral_color": {}, "veiling_glare": {"spread_mm": 1},
        },
        "sensor": {"source": "google-pixel-4a", "gain_setting": 100, "changes": SMALL | {
            "gain_settings": [{"setting": 100, "analog_gain": 2.5, "read_noise_e": 7}], "row_noise_e": 1,
        }},
    },
]  # fmt: skip


def decoded(content: bytes) -> tuple[dict, np.ndarray, np.ndarray, np.ndarray | None]:
    length = int.from_bytes(content[:4], "little")
    header = json.loads(content[4 : 4 + length])
    rows, cols = header["rows"], header["cols"]
    count, start = rows * cols, 4 + length
    mean = np.frombuffer(content, np.float32, count, start)
    dn = np.frombuffer(content, header["dn_type"], count, start + mean.nbytes)
    rest = np.frombuffer(content, np.uint8, -1, start + mean.nbytes + dn.nbytes)
    picture = rest.reshape(rows, cols, 4)[..., :3] if rest.size else None
    return header, dn.reshape(rows, cols).astype(np.float32), mean.reshape(rows, cols), picture


@pytest.mark.filterwarnings("ignore::photosite.errors.PhotositeWarning")
@pytest.mark.parametrize("number", range(len(STATES)))
def test_python_and_command_reproduce_the_frame_on_the_page_exactly(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, places = CameraState.model_validate(STATES[number]), Places()
    exact_frame(state, places, tmp_path)
    header, on_page, _, picture = decoded(view_bytes(state, places, View(height=200, width=300), tmp_path))
    assert (header["exact"], header["step"]) == (True, 1)
    names: dict = {}
    code = python_text(state, places)
    assert [line for line in code.splitlines() if "import" in line] == ["import photosite as ps"]
    exec(code, names)
    assert np.array_equal(on_page, names["dn"].astype(np.float32))
    if state.capture.noise:
        assert np.array_equal(picture, (names["picture"] * np.float32(255) + np.float32(0.5)).astype(np.uint8))

    monkeypatch.chdir(tmp_path)
    *file, command = command_text(state, places).split("\nEND\n")
    if file:
        first, content = file[0].split("\n", 1)
        Path(first.split()[2]).write_text(content)
    words = shlex.split(command)
    assert words[0] == "photosite"
    assert run([*words[1:], "--json"]) == 0
    if state.capture.noise:
        written = ps.read_raw("shot.tif").dn
    else:
        import tifffile

        written = tifffile.imread("clean.tif")
    assert np.array_equal(on_page, written.astype(np.float32))


@pytest.mark.parametrize(
    ("scene", "f_number", "step", "limit"),
    [
        *(("macbeth", 8.0, 1, 0.01), ("macbeth", 8.0, 3, 0.03), ("uniform", 4.0, 1, 1e-5), ("uniform", 4.0, 3, 1e-5)),
        *(("sinusoid", 22.0, 1, 0.004), ("sinusoid", 22.0, 3, 0.002)),
    ],
)
def test_the_preview_is_close_to_the_frame(
    scene: str, f_number: float, step: int, limit: float, tmp_path: Path
) -> None:
    options = {"frequency": 0.02} if scene == "sinusoid" else {}
    state = CameraState.model_validate(
        {
            "scene": {"source": scene, "options": options},
            "lens": {"f_number": f_number},
            "sensor": {"changes": {"rows": 240, "cols": 360}},
        }
    )
    found = prepared(state, Places())
    exact = found.camera.mean_electrons(scene_of(found), 1.0)
    rows, cols = (step * np.arange(size // step) for size in exact.shape)
    preview, notes = approximate_rate(found.camera, scene_of(found), rows, cols, step)
    if step > 1:
        exact = mosaic_means(exact, (0, 0), preview.shape, (2, 2), step)

    def error(shown: np.ndarray) -> float:
        return float(np.sqrt(((shown - exact) ** 2).mean()) / np.sqrt((exact**2).mean()))

    assert not notes
    assert error(preview) < limit
    if scene != "uniform":
        assert error(np.roll(preview, 2, axis=1)) > 4 * limit  # one tile beside its place


def test_a_view_of_single_pixels_is_exact_once_the_mean_image_is_known(tmp_path: Path) -> None:
    state, places = CameraState.model_validate(STATES[0]), Places()
    exact_frame(state, places, tmp_path)
    other = CameraState.model_validate(STATES[0] | {"capture": {"exposure_s": 0.01, "seed": 9}})
    view = View(row=20, col=30, rows=40, cols=60, height=400, width=600)
    header, dn, *_ = decoded(view_bytes(other, places, view, tmp_path))
    assert header["exact"]
    found = prepared(other, places)
    whole = found.camera.capture(scene_of(found), 0.01, seed=9).dn
    assert np.array_equal(dn, whole[header["row"] : header["row"] + 40, header["col"] : header["col"] + 60])


def test_a_change_of_the_luminance_scales_the_preview(tmp_path: Path) -> None:
    for luminance in (40.0, 3.0, 900.0):
        state = CameraState.model_validate({"scene": {"mean_luminance_cd_m2": luminance}, "sensor": {"changes": SMALL}})
        header, _, mean, _ = decoded(view_bytes(state, Places(), View(height=130, width=194), tmp_path))
        found = prepared(state, Places())
        rate, _ = approximate_rate(found.camera, scene_of(found), np.arange(130), np.arange(194), 1)
        assert not header["exact"]
        assert mean == pytest.approx(rate * state.capture.exposure_s, rel=1e-4, abs=1e-4)


def test_the_preview_shows_the_bands_of_a_flickering_lamp(tmp_path: Path) -> None:
    state = CameraState.model_validate(
        {
            "scene": {"source": "uniform", "flicker": {"frequency_hz": 100, "depth": 0.5, "phase_deg": 30}},
            "sensor": {"changes": {"rows": 600, "cols": 40, "shutter": {"line_time_us": 50}}},
            "capture": {"exposure_s": 0.002},
        }
    )
    _, _, mean, _ = decoded(view_bytes(state, Places(), View(height=150, width=20), tmp_path))
    found = prepared(state, Places())
    exact = found.mean_image(scene_of(found))
    assert mean == pytest.approx(mosaic_means(exact, (0, 0), mean.shape, (2, 2), 4), rel=1e-3)
    assert mean.max() > 1.5 * mean[:, 0].min()


def test_electrons_of_a_pixel_follow_the_response_of_the_sensor(tmp_path: Path) -> None:
    """The digital numbers of a noise-free frame give back the electrons from light that they come from."""
    captures = STATES[6]["sensor"]["changes"] | {"read_noise_e": 0, "black_level_dn": 10}
    bent = SMALL | {"response_curve": {"polynomial_percent": [0.0, -20.0]}}
    for changes in (captures, bent, SMALL | {"output": {"companding": "square_root"}}):
        state = CameraState.model_validate({"sensor": {"changes": changes}, "capture": {"noise": False}})
        header, dn, mean, _ = decoded(view_bytes(state, Places(), View(height=130, width=194), tmp_path))
        found = np.interp(dn, header["response"]["dn"], header["response"]["electrons"])
        below = mean < 0.9 * header["saturation_e"]
        # a code of the square root of 12 bits spans up to 2 sqrt(4095) / 4095 of the range
        limit = 0.02 * mean.max() if "output" in changes else 2.0
        assert np.abs(found - mean)[below].max() < limit


def test_the_noise_of_a_preview_has_the_statistics_of_the_frame(tmp_path: Path) -> None:
    state = CameraState.model_validate(
        {"scene": {"source": "uniform"}, "sensor": {"changes": {"rows": 600, "cols": 600}}}
    )
    header, dn, *_ = decoded(view_bytes(state, Places(), View(height=200, width=200), tmp_path))
    assert (header["exact"], header["step"]) == (False, 3)
    found = prepared(state, Places())
    frame = found.camera.capture(scene_of(found), state.capture.exposure_s).dn
    # 10 000 pixels of a channel: the standard deviation has a relative uncertainty of 0.7 %, so 5 % is seven of them.
    # They are means over 3 x 3 pixels, which have a third of it.
    means = mosaic_means(frame, (0, 0), dn.shape, (2, 2), 3)
    assert dn[::2, 1::2].std() == pytest.approx(means[::2, 1::2].std(), rel=0.05)
    assert means[::2, 1::2].std() == pytest.approx(frame[::2, 1::2].std() / 3, rel=0.05)
    assert dn[::2, 1::2].mean() == pytest.approx(frame[::2, 1::2].mean(), rel=1e-3)


@pytest.mark.parametrize("start", [{"row": 129}, {"col": 193}, {"row": 125, "col": 190}, {"row": 1 << 20}])
def test_views_that_start_in_the_last_rows_show_the_last_pixels(tmp_path: Path, start: dict[str, int]) -> None:
    state = CameraState.model_validate({"sensor": {"changes": SMALL}})
    small = View(height=16, width=16, **start)
    shown = view_pixels(prepared(state, Places()), small, tmp_path)
    assert shown.step > 1
    assert shown.dn.shape == (shown.rows.size, shown.cols.size)
    assert min(shown.dn.shape) >= 2
    assert shown.rows[-1] < 130
    assert shown.cols[-1] < 194
    for axis, index, size in (("row", shown.rows, 130), ("col", shown.cols, 194)):
        assert axis not in start or index[-1] >= size - 2 * shown.step
    assert view_bytes(state, Places(), small, tmp_path)


def test_a_small_view_of_the_exact_frame_has_means_of_pixels(tmp_path: Path) -> None:
    state, places = CameraState.model_validate(STATES[0]), Places()
    view = View(height=44, width=65, regions=((20, 41, 30, 60),))
    preview, before, *_ = decoded(view_bytes(state, places, view, tmp_path))
    assert preview["regions"][0]["waits"]
    exact_frame(state, places, tmp_path)
    header, dn, _, picture = decoded(view_bytes(state, places, view, tmp_path))
    found = prepared(state, places)
    frame = found.camera.capture(scene_of(found), state.capture.exposure_s).dn
    assert header["step"] == 3
    assert np.array_equal(dn, mosaic_means(frame, (0, 0), dn.shape, (2, 2), 3))
    assert picture is not None
    assert np.sqrt(((before - dn) ** 2).mean()) < 0.03 * np.sqrt((dn**2).mean())
    # the histogram is that of single pixels, one tile in three along both axes
    assert sum(map(sum, header["histogram"]["counts"].values())) == 42 * 64
    assert not header["regions"][0]["waits"]


@pytest.mark.parametrize("more", [{"black_level_dn": 1}, {"black_level_dn": 64, "row_noise_e": 12}])
def test_the_preview_of_clipped_blacks_and_of_noisy_rows_has_the_statistics_of_the_frame(
    more: dict, tmp_path: Path
) -> None:
    changes = {"rows": 600, "cols": 600, "read_noise_e": 20} | more
    state = CameraState.model_validate(
        {"scene": {"source": "uniform", "mean_luminance_cd_m2": 0.01}, "sensor": {"changes": changes}}
    )
    _, dn, *_ = decoded(view_bytes(state, Places(), View(height=200, width=200), tmp_path))
    found = prepared(state, Places())
    means = mosaic_means(found.camera.capture(scene_of(found), 1 / 3).dn, (0, 0), dn.shape, (2, 2), 3)
    # 200 rows: the standard deviation of their means has a relative uncertainty of 5 %, and so has that of the other.
    assert dn.mean(axis=1).std() == pytest.approx(means.mean(axis=1).std(), rel=0.3)
    assert dn.std() == pytest.approx(means.std(), rel=0.15)
    assert dn.mean() == pytest.approx(means.mean(), abs=0.2)


def test_statistics_of_a_region_are_those_of_the_frame(tmp_path: Path) -> None:
    state, places = CameraState.model_validate(STATES[0]), Places()
    exact_frame(state, places, tmp_path)
    view = View(height=64, width=96, regions=((20, 41, 30, 60),))
    header, *_ = decoded(view_bytes(state, places, view, tmp_path))
    found = prepared(state, places)
    dn = found.camera.capture(scene_of(found), state.capture.exposure_s).dn.astype(float)
    cfa = np.array(found.camera.sensor.array.cfa)
    rows, cols = np.mgrid[20:41, 30:60]
    for name, values in header["regions"][0]["channels"].items():
        own = dn[20:41, 30:60][cfa[rows % 2, cols % 2] == name]
        assert values["pixels"] == own.size
        assert values["mean_dn"] == pytest.approx(own.mean())
        assert values["sd_dn"] == pytest.approx(own.std(ddof=1))


@pytest.mark.parametrize("sensor", ["dual-gain-phone", "split-pixel-automotive", "raspberry-pi-hq", "vendor-1.4um"])
def test_every_kind_of_sensor_has_a_preview(sensor: str, tmp_path: Path) -> None:
    state = CameraState.model_validate({"sensor": {"source": sensor}, "scene": {"source": "hdr-patches"}})
    header, dn, mean, picture = decoded(view_bytes(state, Places(), View(height=120, width=160), tmp_path))
    assert dn.shape == mean.shape
    assert picture is not None
    assert dn.max() > header["black_level_dn"]
    assert np.diff(header["snr"]["signal_e"]).min() > 0


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("sensor", ["split-pixel-automotive", "vendor-1.4um"])
def test_full_wells_are_saturated_on_the_page(sensor: str, noise: bool, exact: bool, tmp_path: Path) -> None:
    changes = {"rows": 96, "cols": 128}
    state = CameraState.model_validate(
        {
            "sensor": {"source": sensor, "changes": changes},
            "scene": {"source": "uniform", "mean_luminance_cd_m2": 1e6},
            "capture": {"noise": noise},
        }
    )
    if exact:
        assert exact_frame(state, Places(), tmp_path)["saturated_fraction"] > 0.99
    header, dn, *_ = decoded(view_bytes(state, Places(), View(height=96, width=128), tmp_path))
    assert header["exact"] == exact
    assert header["saturated_fraction"] > 0.99
    assert (dn >= header["white_level_dn"]).mean() > 0.99  # what the page marks


def test_every_number_field_of_the_form_has_a_description_and_every_quantity_a_unit(client) -> None:
    form = client.post("/api/form", json={}).json()
    fields = [f for part in ("scene", "lens", "sensor", "capture") for group in form[part] for f in group["fields"]]
    for field in fields:  # grows: parts of parts follow
        if field["kind"] != "entries":
            fields += field["fields"]
    assert len(fields) > 150
    assert not [f["name"] for f in fields if not f["description"]]
    suffixed = [
        f for f in fields if f["name"].endswith(("_um", "_mm", "_e", "_s", "_m", "_percent", "_dn", "_c", "_v"))
    ]
    assert not [f["name"] for f in suffixed if not f["unit"] and f["kind"] != "table"]
    values = {f["name"]: f["value"] for f in reversed(fields)}  # of the whole sensor before those of its captures
    assert values["read_noise_e"] == pytest.approx(17.3333, abs=1e-3)
    assert parameters_of(ps.DiffractionLimited)["f_number"]


def test_jobs_and_views_over_the_api(client) -> None:
    state = STATES[0]
    job = client.post("/api/frames", json={"state": state, "tab": "one"}).json()
    deadline = time.monotonic() + 60
    while job["status"] in ("queued", "running") and time.monotonic() < deadline:
        time.sleep(0.05)
        job = client.get(f"/api/jobs/{job['id']}").json()
    assert job["status"] == "done", job
    answer = client.post("/api/view", json={"state": state, "tab": "one", "view": {"height": 100, "width": 150}})
    header, *_ = decoded(answer.content)
    assert header["exact"]
    assert job["result"]["rows"] == 130
    raw = client.post("/api/save", json={"state": state, "suffix": ".dng"})
    assert raw.headers["content-disposition"] == 'attachment; filename="shot.dng"'
    assert raw.content[:2] == b"II"


def test_previews_are_without_effects_of_places() -> None:
    effects = {"glow": {"places": ["top"], "peak_e_per_s": 5, "decay_pixels": 20}, "optical_black": {"top": 8}}
    sensor = ps.load_sensor("nikon-d200").with_(**effects, telegraph_noise=BLINKING)
    notes: list[str] = []
    small = of_size(sensor, 2, 2, notes)
    assert notes == ["the preview is without glow, optical black"]
    assert small.effects is not None
    assert list(small.effects.stated) == ["telegraph_noise"]
