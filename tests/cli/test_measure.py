"""`photosite measure` on frames, pictures and wrong calls."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.cli.main import COMMANDS, run
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.photographs import measure_photographs
from photosite.metrics.registry import measurements
from photosite.studies.virtual_charts import virtual_edge


@pytest.fixture(scope="module")
def edge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("edge") / "edge.png"
    values = virtual_edge(np.random.default_rng(1)).electrons
    RawFrame(np.rint(values / values.max() * 3500).astype(np.uint16), bits=12).save(path)
    return path


def found(capsys: pytest.CaptureFixture[str], *arguments: Any) -> dict[str, Any]:
    assert run(["measure", *map(str, arguments), "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


@pytest.mark.smoke("measure")
def test_json_has_values_with_intervals(edge: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "measure" in COMMANDS
    content = found(capsys, edge, "--chart", "slanted-edge")["results"]["edge-sfr"]
    value = next(each for each in content["values"] if each["quantity"] == "mtf50")
    low, high = value["interval_95"]
    assert low < value["value"] < high
    assert value["unit"] == "cycles/pixel"
    assert {curve["y_label"] for curve in content["curves"]} >= {"SFR"}


def test_options_of_a_measurement(edge: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wide, narrow = (
        found(capsys, edge, "--chart", "slanted-edge", "--set", f"edge-sfr.reach_px={reach}") for reach in (32, 12)
    )
    assert wide["results"]["edge-sfr"]["values"] != narrow["results"]["edge-sfr"]["values"]


def test_report_and_picture(edge: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Image.open(edge) as raw:
        codes = np.asarray(raw).astype(float) / 16
    picture = tmp_path / "picture.png"
    Image.fromarray(np.repeat(codes.astype(np.uint8)[..., None], 3, axis=2)).save(picture)
    content = found(
        capsys, picture, "--chart", "slanted-edge", "--tone-curve", "linear", "--report", tmp_path / "page.html"
    )
    assert content["origin"] == "picture"
    assert "MTF50" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_list_names_all(capsys: pytest.CaptureFixture[str]) -> None:
    listed = found(capsys, "--list")["measurements"]
    assert {entry["id"] for entry in listed} == set(measurements())


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("--chart", "slanted-edge"),
        ("{edge}", "--chart", "slantededge"),
        ("{edge}", "--chart", "zone-plate"),
        ("{edge}", "--chart", "slanted-edge", "--only", "edgesfr"),
        ("{edge}", "--chart", "slanted-edge", "--set", "edge-sfr.order=9"),
        ("{edge}", "--chart", "slanted-edge", "--set", "order=1"),
        ("{edge}", "--chart", "slanted-edge", "--corners", "0,0", "0,50", "900,50", "900,0"),
    ],
)
def test_wrong_calls_end_with_one_line(
    arguments: tuple[str, ...], edge: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["measure", *(each.format(edge=edge) for each in arguments)]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("photosite")]
    assert len(lines) == 1


def test_a_camera_file_and_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    camera, limits = tmp_path / "phone.camera.yaml", tmp_path / "phone.limits.yaml"
    camera.write_text(
        "photosite_camera: 1\nsensor: google-pixel-4a\noptics: {f_number: 1.8, focal_length_mm: 4.4}\n", "utf-8"
    )
    limits.write_text(
        "photosite_limits: 1\nlimits:\n  - noise.snr_18_db >= 20\n  - noise.snr_18_db <= 21\n", encoding="utf-8"
    )
    call = ("--camera", camera, "--chart", "macbeth", "--only", "noise", "--frames", 2, "--limits", limits)
    content = found(capsys, *call)
    verdicts = [entry["verdict"] for entry in content["verdicts"]["limits"]]
    assert verdicts == ["pass"] * 3 + ["fail"] * 3
    assert run(["measure", *map(str, call), "--exit-status"]) == 1


def listed(folder: Path, text: str) -> Path:
    path = folder / "lab.photographs.yaml"
    path.write_text("photosite_photographs: 1\nname: Lab\nphotographs:\n" + text, encoding="utf-8")
    return path


def test_photographs_of_several_charts_have_the_values_of_each(
    edge: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "one.png").write_bytes(edge.read_bytes())
    path = listed(
        tmp_path,
        "  - {chart: slanted-edge, frames: o*.png, only: [edge-sfr]}\n"
        "  - {chart: slanted-edge, name: line, frames: [one.png], only: [edge-sfr], options: {edge-sfr: {order: 1}}}\n",
    )
    limits = tmp_path / "limits.yaml"
    limits.write_text("photosite_limits: 1\nlimits:\n  - edge-sfr.mtf50 >= 0.01\n", encoding="utf-8")
    content = found(capsys, "--photographs", path, "--report", tmp_path / "lab.html", "--limits", limits)
    assert content["name"] == "Lab"
    for name, order in (("slanted-edge", 5), ("line", 1)):
        alone = found(capsys, edge, "--chart", "slanted-edge", "--only", "edge-sfr", "--set", f"edge-sfr.order={order}")
        assert content["charts"][name]["results"] == alone["results"]
    assert len(content["verdicts"]["limits"]) == 2
    assert "MTF50" in (tmp_path / "lab.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("  - {chart: slanted-edge, frames: none-*.png}\n", 4, "none-"),
        ("  - {chart: slanted-egde, frames: one.png}\n", 4, "slanted-edge"),
        ("  - {chart: slanted-edge, frames: one.png}\n  - {chart: slanted-edge, frames: one.png}\n", 5, "slanted-edge"),
        ("  - {chart: slanted-edge, frames: one.png, exposure: 1}\n", 4, "exposure"),
        (
            "  - chart: slanted-edge\n    frames: one.png\n    corners: [[0, 0], [0, 9], [9, 9], [9, 9000]]\n",
            4,
            "corners",
        ),
        ("  - {chart: slanted-edge, frames: one.png, options: {edge-sfr: {oder: 1}}}\n", 4, "oder"),
    ],
)
def test_a_mistake_in_a_list_of_photographs_is_named_with_its_line(
    edge: Path, tmp_path: Path, text: str, line: int, what: str
) -> None:
    (tmp_path / "one.png").write_bytes(edge.read_bytes())
    with pytest.raises(ps.FileError) as error:
        measure_photographs(listed(tmp_path, text))
    assert error.value.line == line
    assert what in str(error.value)


def test_photographs_and_frames_are_not_given_together(edge: Path, tmp_path: Path) -> None:
    path = listed(tmp_path, f"  - {{chart: slanted-edge, frames: {edge}}}\n")
    assert run(["measure", str(edge), "--photographs", str(path)]) == 2
    assert run(["measure", "--photographs", str(path), "--chart", "slanted-edge"]) == 2
