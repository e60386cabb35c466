"""`photosite validate --measured`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photosite as ps
from photosite.cli.main import run
from photosite.color.illuminants import illuminant
from photosite.errors import InputError

CORNERS = ("8,8", "8,384", "256,384", "256,8")


@pytest.fixture(scope="module")
def camera(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of a chart by one chip, the sensor file, and the lamp's spectrum with its level."""
    folder = tmp_path_factory.mktemp("camera")
    sensor = ps.load_sensor("nikon-d200").with_(black_level_dn=64, rows=264, cols=392)
    sensor.save(folder / "assumed.sensor.yaml")
    sensor.with_(serial="measured").save(folder / "measured.sensor.yaml")
    for seed in (1, 2):
        shot = ["--sensor", str(folder / "measured.sensor.yaml"), "--seed", str(seed)]
        assert run(["simulate", *shot, "-o", str(folder / f"shot{seed}.dng")]) == 0
    grid = np.arange(380.0, 781.0, 10.0)
    energy = illuminant("A", grid)
    from photosite.validation.lamp import read_lamp

    scale = 1.0
    for _ in range(2):  # a lamp of 40 cd/m2 on the chart, as photosite simulate has by default
        lines = [f"{a:g},{scale * b:.12g}" for a, b in zip(grid, energy, strict=True)]
        (folder / "lamp.csv").write_text("wavelength_nm,spectral_irradiance_w_per_m2_nm\n" + "\n".join(lines))
        level = read_lamp(folder / "lamp.csv").chart_luminance_cd_m2
        assert level is not None
        scale *= 40.0 / level
    return folder


def camera_options(camera: Path, *more: str) -> list[str]:
    return ["--sensor", str(camera / "assumed.sensor.yaml"), *more]


def test_the_right_camera_agrees_and_the_report_is_written(photosite: Any, camera: Path, tmp_path: Path) -> None:
    frames = ("--measured", camera / "shot1.dng", camera / "shot2.dng")
    options = camera_options(camera, "--illuminant", str(camera / "lamp.csv"), "--corners", *CORNERS, "--f-number", "8")
    done = photosite("validate", *frames, *options, "--report", tmp_path / "report.html", "--json")
    assert (done.status, done.err) == (0, f"wrote {tmp_path / 'report.html'}\n")
    assert done.json["agrees"] is True
    assert done.json["frames"] == [2, 2]
    assert done.json["luminance_cd_m2"] == pytest.approx(40, rel=1e-6)
    assert done.json["notes"] == ["defaults used: 50 mm focal length, 1.2 m to the chart"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count("data:image/") == 5
    text = photosite("validate", *frames, *options).out
    assert text.startswith("measured and simulated agree\n  patch means agree: chi-square ")


def test_a_folder_and_a_detected_chart(photosite: Any, camera: Path, tmp_path: Path) -> None:
    (tmp_path / "shot.dng").write_bytes((camera / "shot1.dng").read_bytes())
    options = camera_options(camera, "--illuminant", "A", "--luminance", "40", "--detect")
    done = photosite("validate", "--measured", tmp_path, *options, "--fit", "fill_factor", "--json")
    assert done.json["agrees"] is True
    assert done.json["fit"]["value"] == pytest.approx(0.9, rel=2e-3)
    wanted = [[float(part) for part in corner.split(",")] for corner in CORNERS]
    np.testing.assert_allclose(done.json["corners"], wanted, atol=2)


def test_wrong_conditions_are_reported(photosite: Any, camera: Path) -> None:
    options = camera_options(camera, "--illuminant", "D65", "--luminance", "40", "--corners", *CORNERS)
    done = photosite("validate", "--measured", camera / "shot1.dng", *options)
    assert done.status == 0
    assert done.out.startswith("measured and simulated differ\n")
    assert "the channels have different ratios" in done.out


def test_options_reach_the_simulation(photosite: Any, camera: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def caught(frames: Any, conditions: Any, corners: Any, **options: Any) -> None:
        optics = conditions.optics
        assert (optics.f_number, optics.focal_length_mm, conditions.distance_m) == (5.6, 35, 2)
        assert (conditions.exposure_s, conditions.luminance_cd_m2) == (0.25, 44)
        assert [frame.black_level_dn for frame in frames] == [60]
        assert corners == tuple(tuple(map(float, corner.split(","))) for corner in turned)
        assert options == {"fit": "light", "seed": 3, "level": 0.01, "tolerance_percent": 2}
        raise InputError("the comparison was called")

    monkeypatch.setattr("photosite.validation.frame_validation.validate_frames", caught)
    turned = (*CORNERS[2:], *CORNERS[:2])
    lens = ("--f-number", "5.6", "--focal-length", "35", "--distance", "2")
    light = ("--illuminant", "A", "--luminance", "44", "--exposure", "1/4", "--black-level", "60")
    test = ("--fit", "light", "--seed", "3", "--level", "0.01", "--tolerance", "2")
    options = camera_options(camera, *lens, *light, *test, "--corners", *turned)
    done = photosite("validate", "--measured", camera / "shot1.dng", *options)
    assert done.err == "photosite: the comparison was called\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("a.dng", "b.dng", "--f-number", "8"), "--f-number applies to --measured"),
        (("a.dng", "b.dng", "--sensor", "nikon-d200"), "--sensor applies to --measured"),
        (("a.dng",), "paths given: 1"),
        (("--measured", "SHOT", "--chart", "macbeth", "--sensor", "nikon-d200"), "--chart applies to two paths"),
        (("--measured", "SHOT", "--illuminant", "A"), "--measured requires --sensor"),
        (("--measured", "SHOT", "--sensor", "nikon-d200"), "--measured requires --illuminant"),
        (("--measured", "SHOT", "--sensor", "nikon-d200", "--illuminant", "A"), "--corners (four times row,col)"),
        (("--measured", "SHOT", "--corners", *CORNERS[:3], "--json"), "got fewer before --json"),
        (
            ("--measured", "SHOT", "--sensor", "nikon-d200", "--illuminant", "A", "--detect", "--corners", *CORNERS),
            "either --corners (four times row,col) or --detect",
        ),
        (
            ("--measured", "SHOT", "--sensor", "nikon-d200", "--illuminant", "A", "--corners", *CORNERS),
            "--luminance 40",
        ),
        (
            ("--measured", "SHOT", "--sensor", "nikon-d200", "--illuminant", "A", "--corners", "8;8", *CORNERS[1:]),
            "must be row,col in pixels",
        ),
        (("--measured", "none.dng", "--sensor", "nikon-d200", "--illuminant", "A", "--detect"), "no such file"),
    ],
)
def test_wrong_calls_are_one_line(photosite: Any, camera: Path, options: tuple[str, ...], message: str) -> None:
    done = photosite("validate", *(str(camera / "shot1.dng") if part == "SHOT" else part for part in options))
    assert (done.status, done.out) == (2, "")
    assert message in done.err
    assert done.err.count("\n") == 1


def test_image_quality_of_two_frames(photosite: Any, tmp_path: Path) -> None:
    simulate = ("simulate", "--scene", "slanted-edge", "--exposure", "auto")
    for seed in (1, 2):
        photosite(*simulate, "--seed", str(seed), "-o", tmp_path / f"{seed}.dng")
    files = tmp_path / "1.dng", tmp_path / "2.dng"
    found = photosite("validate", *files, "--chart", "slanted-edge", "--image-quality", "--json").json
    assert found["agrees"]
    assert {"edge-sfr.mtf50.G", "acutance.acutance.G"} <= {each["name"] for each in found["values"]}
    assert photosite("validate", "--measured", *files, "--image-quality").status == 2
