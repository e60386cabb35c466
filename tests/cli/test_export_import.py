"""`photosite export` and `photosite import`: sensors and single measurements, and wrong calls."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from short_protocol import short_d200_protocol

import photosite as ps
from photosite.cli.main import run
from photosite.frames.frame_set import FrameSet
from photosite.frames.io.darktable import read_darktable


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shot") / "stack"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("photosite.studies.protocol.paper_d200_protocol", short_d200_protocol)
        assert run(["shoot", "--rows", "44", "--cols", "66", "--photons", "--seed", "5", "-o", str(folder)]) == 0
    return folder


def test_a_sensors_profile_in_a_dng(photosite: Any, tmp_path: Path) -> None:
    shot, output, sensor = tmp_path / "shot.dng", tmp_path / "with.dng", tmp_path / "again.sensor.yaml"
    assert photosite("simulate", "--rows", 132, "--cols", 196, "-o", shot).status == 0
    done = photosite("export", "nikon-d200", "dng", "--into", shot, "-o", output)
    assert done.status == 0
    assert "not in the tag: uncertainties" in done.err
    d200 = ps.load_sensor("nikon-d200")
    profile = ps.read_raw(output).noise_profile
    assert profile is not None
    np.testing.assert_allclose(profile[:, 0], d200.system_gain_dn_per_e / 4095, rtol=1e-12)
    assert photosite("import", output, "--sensor", "nikon-d200", "-o", sensor).status == 0
    again = ps.load_sensor(sensor)
    assert again.system_gain_dn_per_e == pytest.approx(d200.system_gain_dn_per_e, rel=1e-9)
    assert again.noise.read_noise_mv.value == pytest.approx(np.hypot(0.52, 0.55), rel=1e-9)
    assert again.noise.dsnu_mv.value == 0
    assert photosite("simulate", "--sensor", sensor, "--rows", 132, "--cols", 196, "--force", "-o", shot).status == 0


@pytest.mark.smoke("export", "import")
def test_a_mono_sensor_to_darktable_and_libcamera_and_back(photosite: Any, tmp_path: Path) -> None:
    """14 bits, 0.2 DN per electron: without --mono, the import returns what was written."""
    mono, own, tuning = tmp_path / "mono.sensor.yaml", tmp_path / "own.json", tmp_path / "tuning.json"
    channels = {"M": {"wavelength_nm": [500], "quantum_efficiency": [0.5]}}
    sensor = ps.load_sensor("nikon-d200").with_(cfa="mono", channels=channels, bits=14)
    sensor.save(mono)
    slope = sensor.system_gain_dn_per_e / (sensor.white_level_dn - sensor.readout.black_level_dn.value)
    assert photosite("export", mono, "darktable", "--gain-setting", 100, "-o", own).status == 0
    (profile,) = photosite("import", own, "--json").json["profiles"]
    assert profile["channels"].keys() == {"M"}
    assert profile["channels"]["M"]["slope"] == pytest.approx(slope, rel=1e-12)
    assert photosite("export", mono, "libcamera", "-o", tuning).status == 0
    shown = photosite("import", tuning)
    assert f"{4 * sensor.system_gain_dn_per_e:.4g}" in shown.out
    assert "0 to 65535" in shown.out
    assert "scale of 16 bits" in shown.err


def test_emva_descriptor_and_results(photosite: Any, stack: Path, tmp_path: Path) -> None:
    folder, results = tmp_path / "emva", tmp_path / "results.xml"
    done = photosite("export", stack, "emva", "-o", folder)
    assert done.status == 0
    assert "not in a descriptor: color filter array" in done.err
    wrong = photosite("export", stack, "emva", "-o", tmp_path / "no", "--sensor", "nikon-d200")
    assert (wrong.status, "--sensor does not apply to the format emva" in wrong.err) == (2, True)
    before = photosite("calibrate", stack, "--json").json["parameters"]
    after = photosite("calibrate", folder, "--cfa", "rggb", "--json").json["parameters"]
    for name in ("system_gain_dn_per_e", "read_noise_e", "quantum_efficiency_percent", "prnu1288_percent"):
        assert after[name]["value"] == before[name]["value"], name
    done = photosite("export", stack, "emva-xml", "-o", results, "--json")
    assert done.status == 0
    assert "covariance" in done.json["loss"]
    root = ElementTree.parse(results).getroot()
    block = photosite("calibrate", stack, "--json").json["emva1288"]
    for name in ("value", "standard_uncertainty"):
        assert float(root.findtext(f"sensitivity/K/{name}")) == block["K"][name]


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["nikon-d200", "darktable", "-o", "x.json"], "Pass --gain-setting 100"),
        (["nikon-d200", "dng", "-o", "x.dng"], "--into names the DNG file"),
        (["nikon-d200", "darktable", "--into", "y.dng", "-o", "x.json"], "--into names the DNG file"),
        (["nikon-d200", "emva-xml", "-o", "x.xml"], "is a sensor"),
        (["nikon-d200", "darktable", "-o", "x.yaml"], "must end in .json"),
        (["nikon-d200", "tiff", "-o", "x.tif"], "FORMAT must be one of darktable"),
        (["nowhere", "libcamera", "-o", "x.json"], "no such file or folder"),
    ],
)
def test_wrong_exports(
    photosite: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], why: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = photosite("export", *arguments)
    assert done.status == 2
    assert why in done.err
    assert len(done.err.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_gain_setting_that_the_frames_do_not_have(
    photosite: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dark = np.full((2, 3), 64, np.uint16)
    frames = FrameSet.from_arrays([("dark", 0.1, dark, None, 400.0)], bits=12)
    monkeypatch.setattr("photosite.frames.open.open_frames", lambda *_, **__: frames)
    done = photosite("export", tmp_path, "darktable", "--gain-setting", 100, "-o", tmp_path / "a.json")
    assert done.status == 2
    assert "--gain-setting must be one of the frames': 400, got 100" in done.err


def test_maps_in_and_out(photosite: Any, tmp_path: Path) -> None:
    """Maps of single files become a sensor file, whose export has them in SMAP's units."""
    from scipy.io import loadmat, savemat

    rng = np.random.default_rng(2)
    gain, variance = rng.normal(2.2, 0.1, (6, 8)), 3 + rng.exponential(9, (6, 8))
    savemat(tmp_path / "gain.mat", {"map": gain})
    savemat(tmp_path / "variance.mat", {"map": variance})
    files, sensor = (tmp_path / "variance.mat", tmp_path / "gain.mat"), tmp_path / "mine.sensor.yaml"
    shown = photosite("import", "maps", *files, "--json").json
    assert (shown["rows"], shown["cols"]) == (6, 8)
    assert shown["maps"]["gain_dn_per_e"]["median"] == pytest.approx(np.median(gain), rel=1e-12)
    assert photosite("import", "maps", *files, "--sensor", "nikon-d200", "-o", sensor).status == 0
    assert ps.load_sensor(sensor).system_gain_dn_per_e == pytest.approx(np.median(gain), rel=1e-6)
    assert photosite("export", sensor, "smap", "-o", tmp_path / "smap.mat").status == 0
    written = loadmat(tmp_path / "smap.mat")
    np.testing.assert_allclose(written["gainmap"], 1 / gain, rtol=1e-5)
    np.testing.assert_allclose(written["varmap"], variance, rtol=1e-4)
    assert "the sensor has no maps" in photosite("export", "nikon-d200", "gdsc", "-o", tmp_path / "a.tif").err
    assert (
        "--exposure does not apply to a sensor, which has no frames"
        in photosite(
            "export", "nikon-d200", "darktable", "--exposure", 1, "--gain-setting", 100, "-o", tmp_path / "a.json"
        ).err
    )
    assert "--gain applies to maps only" in photosite("import", sensor, "--gain", 2).err
    assert "several maps are read by: photosite import maps" in photosite("import", *files).err


@pytest.mark.parametrize("form", ["pyme", "decode", "ome"])
def test_an_exported_folder_or_file_is_imported_as_it_is(photosite: Any, tmp_path: Path, form: str) -> None:
    np.save(tmp_path / "variance.npy", np.full((6, 8), 4.25))
    sensor, again = tmp_path / "mine.sensor.yaml", tmp_path / "again.sensor.yaml"
    maps = ("import", "maps", tmp_path / "variance.npy", "--gain", 2.5, "--sensor", "nikon-d200", "-o", sensor)
    assert photosite(*maps).status == 0
    written = tmp_path / ("maps.ome.tif" if form == "ome" else "maps")
    assert photosite("export", sensor, form, "-o", written).status == 0
    shown = photosite("import", "maps", written, "--sensor", "nikon-d200", "-o", again, "--json").json["maps"]
    assert shown["variance_dn2"]["median"] == pytest.approx(4.25, rel=1e-6)
    assert shown["gain_dn_per_e"]["median"] == pytest.approx(2.5, rel=1e-6)
    assert shown["offset_dn"]["median"] == pytest.approx(0, abs=1e-6)
    assert ps.load_sensor(again).noise.read_noise_mv.value == pytest.approx(
        ps.load_sensor(sensor).noise.read_noise_mv.value, rel=1e-6
    )


@pytest.mark.parametrize("name", ["m.mat", "m.tif", "m.npy", "folder"])
def test_maps_without_the_word_say_what_to_type(photosite: Any, tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    np.save(tmp_path / "m.npy", np.ones((4, 6)))
    done = photosite("import", tmp_path / name)
    assert (done.status, done.err.count("\n")) == (2, 1)
    assert f"photosite import maps {tmp_path / name}" in done.err


def test_wrong_imports(photosite: Any, tmp_path: Path) -> None:
    done = photosite("import", tmp_path / "none.json")
    assert (done.status, done.out) == (2, "")
    assert "there is no such file" in done.err
    profile = tmp_path / "p.json"
    profile.write_text("{}")
    assert "neither a darktable noise profile" in photosite("import", profile).err
    assert "required together" in photosite("import", profile, "-o", tmp_path / "s.yaml").err


def test_darktable_profiles_of_a_sensor_with_gain_settings(photosite: Any, tmp_path: Path) -> None:
    output = tmp_path / "noise.json"
    sensor = ps.load_sensor("sony-a7r2")
    assert photosite("export", "sony-a7r2", "darktable", "-o", output).status == 0
    profiles = read_darktable(output)
    assert tuple(profile.gain_setting for profile in profiles) == sensor.all_gain_settings
    slopes = [profile.slope[1].value for profile in profiles]
    gains = [sensor.at_gain_setting(iso).system_gain_dn_per_e / (16383 - 512) for iso in sensor.all_gain_settings]
    assert slopes == pytest.approx(gains, rel=1e-3)
    assert photosite("export", "sony-a7r2", "darktable", "--gain-setting", 800, "-o", output, "--force").status == 0
    assert [profile.gain_setting for profile in read_darktable(output)] == [800]
