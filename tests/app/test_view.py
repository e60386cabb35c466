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
from photosite.app.form import parameters_of
from photosite.app.state import CameraState, Places, bench
from photosite.app.view import View, approximate_rate, exact_frame, scene_of, view_bytes
from photosite.cli.main import run

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
]  # fmt: skip


def decoded(content: bytes) -> tuple[dict, np.ndarray, np.ndarray, np.ndarray | None]:
    length = int.from_bytes(content[:4], "little")
    header = json.loads(content[4 : 4 + length])
    rows, cols = header["rows"], header["cols"]
    count, start = rows * cols, 4 + length
    mean = np.frombuffer(content, np.float32, count, start)
    dn = np.frombuffer(content, header["dn_type"], count, start + mean.nbytes)
    rest = np.frombuffer(content, np.uint8, -1, start + mean.nbytes + dn.nbytes)
    picture = rest.reshape(rows, cols, 3) if rest.size else None
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
    exec(python_text(state, places), names)
    assert np.array_equal(on_page, names["dn"].astype(np.float32))
    if state.capture.noise:
        assert np.array_equal(picture, (names["picture"] * np.float32(255) + np.float32(0.5)).astype(np.uint8))

    monkeypatch.chdir(tmp_path)
    words = shlex.split(command_text(state, places))
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
        *(("macbeth", 8.0, 1, 0.01), ("macbeth", 8.0, 3, 0.08), ("uniform", 4.0, 1, 1e-5), ("uniform", 4.0, 3, 1e-5)),
        *(("sinusoid", 22.0, 1, 0.004), ("sinusoid", 22.0, 3, 0.04)),
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
    found = bench(state, Places())
    exact = found.camera.mean_electrons(scene_of(found), 1.0)
    rows, cols = (np.arange(size).reshape(-1, 2)[::step].ravel() for size in exact.shape)
    preview, notes = approximate_rate(found.camera, scene_of(found), rows, cols, step)
    exact = exact[np.ix_(rows, cols)]

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
    found = bench(other, places)
    whole = found.camera.capture(scene_of(found), 0.01, seed=9).dn
    assert np.array_equal(dn, whole[header["row"] : header["row"] + 40, header["col"] : header["col"] + 60])


def test_the_noise_of_a_preview_has_the_statistics_of_the_frame(tmp_path: Path) -> None:
    state = CameraState.model_validate(
        {"scene": {"source": "uniform"}, "sensor": {"changes": {"rows": 600, "cols": 600}}}
    )
    header, dn, *_ = decoded(view_bytes(state, Places(), View(height=200, width=200), tmp_path))
    assert (header["exact"], header["step"]) == (False, 3)
    found = bench(state, Places())
    frame = found.camera.capture(scene_of(found), state.capture.exposure_s).dn
    # 10 000 pixels of a channel: the standard deviation has a relative uncertainty of 0.7 %, so 5 % is seven of them.
    assert dn[::2, 1::2].std() == pytest.approx(frame[::2, 1::2].std(), rel=0.05)
    assert dn[::2, 1::2].mean() == pytest.approx(frame[::2, 1::2].mean(), rel=1e-3)


def test_statistics_of_a_region_are_those_of_the_frame(tmp_path: Path) -> None:
    state, places = CameraState.model_validate(STATES[0]), Places()
    exact_frame(state, places, tmp_path)
    view = View(height=64, width=96, regions=((20, 41, 30, 60),))
    header, *_ = decoded(view_bytes(state, places, view, tmp_path))
    found = bench(state, places)
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
    header, dn, mean, picture = decoded(view_bytes(state, Places(), View(height=40, width=60), tmp_path))
    assert dn.shape == mean.shape
    assert picture is not None
    assert dn.max() > header["black_level_dn"]
    assert np.diff(header["snr"]["signal_e"]).min() > 0


def test_every_number_field_of_the_form_has_a_description_and_every_quantity_a_unit(client) -> None:
    form = client.post("/api/form", json={}).json()
    fields = [f for part in ("scene", "lens", "sensor", "capture") for group in form[part] for f in group["fields"]]
    assert len(fields) > 70
    assert not [f["name"] for f in fields if not f["description"]]
    suffixed = [
        f for f in fields if f["name"].endswith(("_um", "_mm", "_e", "_s", "_m", "_percent", "_dn", "_c", "_v"))
    ]
    assert not [f["name"] for f in suffixed if not f["unit"]]
    values = {f["name"]: f["value"] for f in fields}
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
