"""A camera file is validated by measurements: frames of the same camera agree, and what differs is named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.cli.main import run
from photosite.metrics.measure import measure
from photosite.scene.scene_request import SceneRequest
from photosite.sensor.model import Sensor
from photosite.studies.quality_validation import MeasuredChart, load_measured, validate_quality
from photosite.validation.quality_comparison import QualityComparison

ONLY = {"slanted-edge": ["edge-sfr"], "macbeth": ["noise", "color-accuracy"], "uniform": ["noise-spectrum", "shading"]}
SENSOR = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=100)
pytestmark = pytest.mark.filterwarnings("ignore:.*response lies outside the scene's wavelengths")


def camera(sensor: Sensor = SENSOR, f_number: float = 8.0) -> ps.Camera:
    return ps.Camera(ps.DiffractionLimited(f_number=f_number, focal_length_mm=50), sensor)


def photographs(folder: Path, taken: ps.Camera, seed: int, exposure: float = 1.0) -> dict[str, MeasuredChart]:
    """Return image quality of frames of another chip, by way of JSON; the light is not stated."""
    taken = ps.Camera(taken.optics, taken.sensor.with_(serial=str(seed)))
    charts = {}
    for place, (chart, only) in enumerate(ONLY.items()):
        edge = chart == "slanted-edge"
        samples = {"rows": 9 * 264, "cols": 9 * 392} if edge else {}
        taken = ps.Camera(taken.optics, taken.sensor, taken.integration, 9 if edge else 1)
        scene = SceneRequest(chart, {"illuminant": "D65", "mean_luminance_cd_m2": 77.0, **samples}).scene()
        time_s = taken.auto_exposure_s(taken.mean_electrons(scene, 1.0)) * exposure
        frames = [taken.capture(scene, exposure_s=time_s, seed=100 * seed + place, frame=k) for k in range(4)]
        charts[chart] = measure(frames, chart, only=only).to_dict()
    file = folder / f"measured-{seed}.json"
    file.write_text(json.dumps({"charts": charts}), encoding="utf-8")
    return load_measured(file)


def differing(found: QualityComparison) -> set[str]:
    return {each.name.rsplit(".", 1)[0] for each in found.values if each.verdict == "differs"}


def test_frames_of_the_same_camera_agree(tmp_path: Path) -> None:
    """The table's false-alarm rate is 0.05; the exposure is found from the signal, also of dark photographs."""
    for seed, exposure in ((1, 1.0), (2, 0.4)):
        found = validate_quality(photographs(tmp_path, camera(), seed, exposure), camera(), seed=seed)
        assert found.agrees, (seed, differing(found))
        assert found.count["agrees"] > 120


def test_another_lens_blur_is_named(tmp_path: Path) -> None:
    names = differing(validate_quality(photographs(tmp_path, camera(f_number=16.0), 4), camera()))
    assert {"edge-sfr.mtf50", "edge-sfr.edge_rise"} <= names
    assert not {name for name in names if not name.startswith("edge-sfr")}


def test_another_noise_is_named(tmp_path: Path) -> None:
    noisy = SENSOR.with_(read_noise_mv=5.0 * SENSOR.noise.read_noise_mv.value)
    names = differing(validate_quality(photographs(tmp_path, camera(noisy), 5), camera()))
    assert {"noise.dynamic_range_db", "noise-spectrum.density"} <= names
    assert "edge-sfr.mtf50" not in names


def test_a_stated_luminance_is_compared(tmp_path: Path) -> None:
    scene = ps.charts.macbeth("D65", 50.0)
    frames = [camera().capture(scene, exposure_s=0.3, seed=7, frame=k) for k in range(2)]
    for luminance, agrees in ((50.0, True), (55.0, False)):
        quality = measure(frames, "macbeth", only=["oecf"], luminance_cd_m2=luminance)
        file = tmp_path / f"{luminance}.json"
        file.write_text(json.dumps(quality.to_dict()), encoding="utf-8")
        found = validate_quality(load_measured(file), camera(), seed=9)
        assert ("oecf.signal_per_luminance" not in differing(found)) == agrees


def test_pose_and_pictures_are_left_out(tmp_path: Path) -> None:
    scene = ps.charts.point_grid("D65", 50.0)
    raw = camera().capture(scene, exposure_s=camera().auto_exposure_s(camera().mean_electrons(scene, 1.0)), seed=7)
    picture = tmp_path / "p.png"
    Image.fromarray((np.random.default_rng(1).uniform(0, 255, (200, 300, 3))).astype(np.uint8)).save(picture)
    charts = {
        "dots": measure([raw], "point-grid", only=["distortion"]).to_dict(),
        "picture": measure([picture], "uniform", only=["shading"]).to_dict(),
    }
    file = tmp_path / "measured.json"
    file.write_text(json.dumps({"charts": charts}), encoding="utf-8")
    found = validate_quality(load_measured(file), camera())
    assert {each.name for each in found.values} >= {"distortion.distortion_percent"}
    assert not {each.name for each in found.values} & {"distortion.rotation_deg", "distortion.dots"}
    (note,) = found.notes
    assert note.startswith("picture")


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A camera file, a photograph that it takes, and a list of this."""
    SENSOR.save(tmp_path / "mine.sensor.yaml")
    text = "photosite_camera: 1\nsensor: mine.sensor.yaml\ncells_per_pixel: 3\n"
    (tmp_path / "mine.camera.yaml").write_text(text, encoding="utf-8")
    shot = ("--scene", "macbeth", "--exposure", "auto", "-o", str(tmp_path / "shot.dng"))
    assert run(["simulate", "--camera", str(tmp_path / "mine.camera.yaml"), *shot]) == 0
    text = (
        "photosite_photographs: 1\nphotographs:\n  - {chart: macbeth, illuminant: A, frames: shot.dng, only: [noise]}\n"
    )
    (tmp_path / "lab.photographs.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def test_command_takes_a_list_or_its_json(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert run(["measure", "--photographs", str(lab / "lab.photographs.yaml"), "--json"]) == 0
    (lab / "lab.json").write_text(capsys.readouterr().out, encoding="utf-8")
    found = []
    for measured in ("lab.photographs.yaml", "lab.json"):
        call = [
            "validate",
            "--image-quality",
            "--measured",
            str(lab / measured),
            "--camera",
            str(lab / "mine.camera.yaml"),
        ]
        assert run([*call, "--json", "--report", str(lab / "page.html"), "--force"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0] == found[1]
    assert found[0]["agrees"]
    assert "noise.snr_18_db.G" in (lab / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "arguments",
    [
        ("--measured", "lab.photographs.yaml"),
        ("--measured", "lab.photographs.yaml", "--camera", "mine.camera.yaml", "--f-number", "8"),
        ("--measured", "shot.dng", "shot.dng", "--camera", "mine.camera.yaml"),
        ("--measured", "mine.json", "--camera", "mine.camera.yaml"),
    ],
)
def test_wrong_calls_end_with_one_line(
    lab: Path, arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(lab)
    (lab / "mine.json").write_text('{"charts": {"macbeth": 1}}', encoding="utf-8")
    capsys.readouterr()
    assert run(["validate", "--image-quality", *arguments]) == 2
    assert len([line for line in capsys.readouterr().err.splitlines() if line.startswith("photosite")]) == 1
