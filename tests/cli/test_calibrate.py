"""`photosite calibrate`, on a stack that `photosite shoot` wrote."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

import photosite as ps
from photosite.calibration.result import Calibration
from photosite.cli.main import run
from photosite.studies.closed_loop import HEADLINE


def test_json_without_the_truth(photosite: Any, stack: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The parameters of a copy without the true sensor file, and a PDF report."""
    monkeypatch.setattr(Calibration, "report", lambda self, path: path.write_text("a report"))
    copy, report = tmp_path / "stack", tmp_path / "report.pdf"
    shutil.copytree(stack, copy)
    (copy / "truth.sensor.yaml").unlink()
    done = photosite("calibrate", copy, "--json", "--report", report)
    assert (done.status, done.err) == (0, "")
    assert done.json["report"] == str(report)
    assert report.read_text() == "a report"
    found = done.json["parameters"]
    assert set(HEADLINE) <= set(found)
    assert isinstance(done.json["warnings"], list)
    for name, entry in found.items():
        if entry["value"] is None:
            assert entry["reason"], name
        else:
            assert entry["standard_uncertainty"] >= 0, name
    assert found["quantum_efficiency_percent"]["value"] is None
    assert "photons" in found["quantum_efficiency_percent"]["reason"]
    true = ps.load_sensor(stack / "truth.sensor.yaml")
    # 4.5 standard uncertainties: a false alarm in 10^5 for each of these four, which the frames fix to a percent.
    for name, value in (
        ("read_noise_mv", true.noise.read_noise_mv.value),
        ("dsnu_mv", true.noise.dsnu_mv.value),
        ("prnu_percent", true.noise.prnu_percent.value),
        ("system_gain_dn_per_e", true.system_gain_dn_per_e),
    ):
        uncertainty = found[name]["standard_uncertainty"]
        assert 0 < uncertainty < 0.03 * value, name
        assert abs(found[name]["value"] - value) < 4.5 * uncertainty, name


@pytest.mark.usefixtures("short_protocol")
def test_pixels_beyond_a_threshold_are_listed(photosite: Any, tmp_path: Path) -> None:
    assert run(["shoot", "--rows", "72", "--cols", "80", "--seed", "6", "-o", str(tmp_path / "stack")]) == 0
    done = photosite("calibrate", tmp_path / "stack", "--json", "--outlier-dark", "0.8")
    assert done.json["model"] == "general"
    found = done.json["outlier_pixels"]["G"]
    assert (found["dark"]["threshold"], found["dark"]["rule"], found["dark"]["unit"]) == (0.8, "set by the user", "DN")
    assert len(found["dark"]["row"]) == len(found["dark"]["deviation"]) > 10
    assert all(abs(deviation) > 0.8 for deviation in found["dark"]["deviation"])
    assert all((row + col) % 2 == 1 for row, col in zip(found["dark"]["row"], found["dark"]["col"], strict=True))
    assert found["light"]["rule"].startswith("a normal distribution would have")


@pytest.mark.smoke("calibrate")
def test_table_sensor_file_and_report(photosite: Any, stack: Path, tmp_path: Path) -> None:
    sensor, report = tmp_path / "mine.sensor.yaml", tmp_path / "report.html"
    done = photosite("calibrate", stack, "-o", sensor, "--report", report)
    assert done.status == 0
    lines = done.out.splitlines()
    figures = {line.split("  ")[0]: line.split() for line in lines[3:13]}
    assert "0.12" in figures["System gain K"][3]
    assert figures["Quantum efficiency"][-1] == "unknown-photons"
    listed = [line.split()[:2] for line in lines[lines.index("") + 1 :]]
    assert listed.count(["withheld", "unknown-photons"]) == 1
    assert lines[-2:] == [f"wrote {sensor}", f"wrote {report}"]
    measured = ps.load_sensor(sensor)
    assert measured.noise.read_noise_mv.standard_uncertainty > 0
    assert not measured.noise.read_noise_mv.assumed
    assert measured.pixel.conversion_gain_uv_per_e.value == pytest.approx(30, rel=0.02)
    page = report.read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert "Read noise" in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_all_parameters_with_their_methods(photosite: Any, stack: Path) -> None:
    done = photosite("calibrate", stack, "--all")
    found = photosite("calibrate", stack, "--json").json
    printed = [name for name in found["parameters"] if any(f" {name} " in line for line in done.out.splitlines())]
    assert printed == [name for name, entry in found["parameters"].items() if entry["value"] is not None]
    for entry in found["diagnostics"]:
        assert any(line.split()[1:2] == [entry["id"]] for line in done.out.splitlines())


def test_report_of_another_ending_is_refused_before_anything_is_read(photosite: Any, tmp_path: Path) -> None:
    done = photosite("calibrate", tmp_path / "nothing", "--report", tmp_path / "report.docx")
    assert done.status == 2
    assert "its name must end in .html or .pdf" in done.err


def part_of(stack: Path, folder: Path, kind: str, groups: range, frames: int) -> Path:
    """Write a protocol of some groups of a stack, by the numbers in their file names, with the first frames of each."""
    lines = (stack / "protocol.yaml").read_text().splitlines()
    sensor = lines.index("sensor: nominal.sensor.yaml")
    listed = ["photosite_protocol: 1", f"sensor: {stack / 'nominal.sensor.yaml'}", "frames:"]
    for line in lines[sensor + 2 :]:
        for number in groups:
            if f"{kind}/{number:02}_" in line:
                files = sorted(str(file) for file in stack.glob(f"{kind}/{number:02}_*"))[:frames]
                listed.append(line.split("files:")[0] + f"files: [{', '.join(files)}]}}")
    folder.mkdir()
    (folder / "protocol.yaml").write_text("\n".join(listed) + "\n")
    return folder


@pytest.mark.parametrize(
    ("kind", "groups", "frames", "reason", "known"),
    [
        ("light", range(22, 29), 4, "there are no dark frames", "system_gain_dn_per_e"),
        ("dark", range(20, 21), 1, "each dark exposure has one frame", "black_level_dn"),
        ("light", range(25, 26), 1, "there are no dark frames", None),
    ],
)
def test_incomplete_sets(
    photosite: Any,
    stack: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    groups: range,
    frames: int,
    reason: str,
    known: str | None,
) -> None:
    """What the frames show is given, with the reasons for the rest; the sensor file keeps the other values."""
    monkeypatch.setattr(Calibration, "report", lambda self, path: path.write_text("a report"))
    folder = part_of(stack, tmp_path / "part", kind, groups, frames)
    sensor, report = tmp_path / "mine.sensor.yaml", tmp_path / "report.html"
    done = photosite("calibrate", folder, "-o", sensor, "--report", report, "--json")
    assert done.status == 0
    assert "assumed" in done.err
    assert "read_noise_mv" in done.err
    assert reason in " ".join(done.json["warnings"])
    found = done.json["parameters"]
    assert [name for name in ("system_gain_dn_per_e", "black_level_dn") if found[name]["value"] is not None] == (
        [known] if known else []
    )
    assert reason in found["read_noise_dn"]["reason"]
    assert report.exists()
    nominal, measured = ps.load_sensor(stack / "nominal.sensor.yaml"), ps.load_sensor(sensor)
    assert measured.noise.read_noise_mv == nominal.noise.read_noise_mv
    gain_known = measured.pixel.conversion_gain_uv_per_e != nominal.pixel.conversion_gain_uv_per_e
    assert gain_known == (known == "system_gain_dn_per_e")
    text = photosite("calibrate", folder)
    assert text.status == 0
    assert reason in text.out


def test_several_cameras_and_a_file_that_cannot_be_written(photosite: Any, stack: Path, tmp_path: Path) -> None:
    """It ends the command, and is no result of the camera."""
    (tmp_path / "results" / "one.sensor.yaml").mkdir(parents=True)
    (tmp_path / "one").symlink_to(stack)
    done = photosite("calibrate", tmp_path / "one", "--into", tmp_path / "results")
    assert (done.status, done.out, done.err.count("photosite: ")) == (2, "", 1)
    assert not (tmp_path / "results" / "one.json").exists()


def test_several_cameras(photosite: Any, stack: Path, tmp_path: Path) -> None:
    """Each camera has the parameters of its own calibration; one fails, and is calibrated when its frames are there."""
    for name in ("one", "two"):
        (tmp_path / name).symlink_to(stack)
    (tmp_path / "three").mkdir()
    call = ["calibrate", *(tmp_path / name for name in ("one", "two", "three")), "--into", tmp_path / "results"]
    done = photosite(*call, "--json")
    assert done.status == 2
    assert done.json["failed"] == ["three"]
    assert [line for line in done.err.splitlines() if "warning" not in line][-1].startswith("photosite: ")
    alone = photosite("calibrate", tmp_path / "one", "--json").json
    assert done.json["cameras"]["one"]["parameters"] == alone["parameters"]
    kept = (tmp_path / "results" / "one.json").stat().st_mtime_ns
    (tmp_path / "three").rmdir()
    (tmp_path / "three").symlink_to(stack)
    again = photosite(*call)
    assert again.status == 0
    assert again.out.count("calibrated") == 3
    assert (tmp_path / "results" / "one.json").stat().st_mtime_ns == kept
    names = sorted(path.name for path in (tmp_path / "results").iterdir())
    assert names == [f"{name}{suffix}" for name in ("one", "three", "two") for suffix in (".json", ".sensor.yaml")]
    assert (tmp_path / "results" / "two.json").read_bytes() == (tmp_path / "results" / "three.json").read_bytes()
    sensor = ps.load_sensor(tmp_path / "results" / "two.sensor.yaml")
    assert sensor.name == "two"
    for wrong in (call[:3], [*call, "-o", tmp_path / "a.yaml"], [*call, tmp_path / "one"]):
        assert photosite(*wrong).status == 2
