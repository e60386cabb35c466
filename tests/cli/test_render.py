"""`photosite render`: the example scene to files, and calls that are refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from photosite.cli.main import run
from photosite.scene.io.formats import read_scene

pytest.importorskip("mitsuba")

SMALL = ["--spp", "2", "--rows", "8", "--cols", "12"]


@pytest.mark.parametrize("name", ["scene.h5", "scene.exr"])
def test_example_scene_to_a_file(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / name
    assert run(["render", "-o", str(file), *SMALL, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    scene = read_scene(file)
    assert (facts["rows"], facts["cols"], facts["bands"]) == (8, 12, 31)
    assert scene.shape == (8, 12)
    assert scene.mean_luminance_cd_m2() == pytest.approx(facts["mean_luminance_cd_m2"], rel=2e-3)
    assert scene.distance_m == pytest.approx(facts["distance_m"])
    assert scene.width_m == pytest.approx(facts["width_m"])


@pytest.mark.smoke("render")
def test_seed_wavelengths_and_parameters(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from photosite.scene.render import EXAMPLE

    sized = ["--set", "rows=4", "--set", "cols=6", "--wavelengths", "500:540:20", "--spp", "1"]
    for seed in ("1", "2"):
        assert run(["render", str(EXAMPLE), "-o", str(tmp_path / f"{seed}.h5"), *sized, "--seed", seed]) == 0
    assert "4 x 6 samples, 3 bands" in capsys.readouterr().out
    first, second = (read_scene(tmp_path / f"{seed}.h5") for seed in "12")
    assert first.wavelength_nm.tolist() == [500, 520, 540]
    assert first.radiance(2, 2).tolist() != second.radiance(2, 2).tolist()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.xml"], "there is no such file"),
        (["--set", "rows"], "must be NAME=VALUE"),
        (["--wavelengths", "500:400:10"], "must be 400,410,420"),
        (["--wavelengths", "400,410,430"], "in equal steps"),
        (["--variant", "scalar_rgb"], "--variant must be"),
    ],
)
def test_refused_in_one_line(
    tmp_path: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["render", *arguments, "-o", str(tmp_path / "a.h5")]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert said in last
    assert not (tmp_path / "a.h5").exists()
