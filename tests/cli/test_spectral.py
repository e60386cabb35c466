"""`photosite spectral` from a virtual monochromator's folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from virtual_monochromator import MonochromatorRun

import photosite as ps
from photosite.studies.virtual_lab import with_pedestal


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=16, cols=16))
    folder = tmp_path_factory.mktemp("spectral") / "run"
    MonochromatorRun(sensor, (500.0, 550.0, 600.0), 8.0, frames=2, dark_frames=3).write(folder)
    return folder


def test_json_sensor_file_and_figure(photosite: Any, folder: Path, tmp_path: Path) -> None:
    outputs = ("-o", tmp_path / "mine.sensor.yaml", "--figure", tmp_path / "qe.png")
    done = photosite("spectral", folder / "spectral.yaml", "--beside", folder / "truth.sensor.yaml", *outputs, "--json")
    assert done.status == 0, done.err
    found = done.json
    assert found["channels"]["G"]["wavelength_nm"] == [500.0, 550.0, 600.0]
    assert found["channels"]["G"]["quantum_efficiency"][1] == pytest.approx(0.584, rel=0.03)
    made = ps.load_sensor(tmp_path / "mine.sensor.yaml")
    assert list(made.channels["G"].quantum_efficiency) == pytest.approx(found["channels"]["G"]["quantum_efficiency"])
    assert (tmp_path / "qe.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.smoke("spectral")
def test_table(photosite: Any, folder: Path) -> None:
    done = photosite("spectral", folder / "spectral.yaml")
    assert done.status == 0
    assert "3 bands of light" in done.out
    assert "electrons per photon" in done.out


def test_bad_input(photosite: Any, folder: Path, tmp_path: Path) -> None:
    text = (folder / "spectral.yaml").read_text().replace("sensor: nominal.sensor.yaml\n", "")
    (folder / "none.yaml").write_text(text)
    done = photosite("spectral", folder / "none.yaml")
    assert done.status == 2
    assert "sensor" in done.err
    assert photosite("spectral", tmp_path / "gone.yaml").status == 2
