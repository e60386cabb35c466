"""`photosite sensors`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import photosite as ps
from photosite.sensor.io.sensor_file import dump_sensor, preset_names


@pytest.mark.smoke("sensors list")
def test_lists_every_preset(photosite: Any) -> None:
    assert set(photosite("sensors", "list", "--json").json["sensors"]) == set(preset_names())
    lines = photosite("sensors", "list").out.splitlines()
    assert len(lines) == 1 + len(preset_names())


@pytest.mark.smoke("sensors show")
def test_show_is_a_sensor_file(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "again.sensor.yaml"
    file.write_text(photosite("sensors", "show", "nikon-d200").out, encoding="utf-8")
    assert ps.load_sensor(file) == ps.load_sensor("nikon-d200")
    assert photosite("sensors", "show", file, "--json").json["pixel"]["width_um"]["value"] == 6.05


@pytest.mark.smoke("sensors schema")
def test_schema_names_the_fields(photosite: Any) -> None:
    schema = json.loads(photosite("sensors", "schema").out)
    assert {"array", "pixel", "channels", "noise", "readout"} <= set(schema["required"])
    assert "fill_factor" in schema["$defs"]["Pixel"]["properties"]


@pytest.mark.smoke("sensors check", "sensors export")
def test_check(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.sensor.yaml"
    assert photosite("sensors", "export", "vendor-2.2um", "-o", file, "--json").json["sensor"] == str(file)
    checked = photosite("sensors", "check", file, "--json").json
    assert "pixel.conversion_gain_uv_per_e" in checked["assumed"]
    assert "pixel.fill_factor" not in checked["assumed"]


def test_export_overwrites_nothing(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.sensor.yaml"
    file.write_text("mine", encoding="utf-8")
    refused = photosite("sensors", "export", "nikon-d200", "-o", file)
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert file.read_text(encoding="utf-8") == "mine"


SHEET = ("--pixel-um", 3.45, "--full-well-e", 10500, "--qe-peak", 0.65, "--bits", 12, "--rows", 2048, "--cols", 2448)


@pytest.mark.smoke("sensors new")
def test_new_marks_what_is_assumed(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.sensor.yaml"
    made = photosite("sensors", "new", *SHEET, "--read-noise-e", 2.4, "--cfa", "rggb", "-o", file, "--json").json
    sensor = ps.load_sensor(file)
    assert (sensor.name, sensor.array.cfa, sensor.pixel.width_um.value) == ("mine", (("R", "G"), ("G", "B")), 3.45)
    assert sensor.electrons(sensor.noise.read_noise_mv.value) == pytest.approx(2.4)
    assert sensor.saturation_capacity_e == pytest.approx(10500, rel=1e-3)
    peaks = [max(channel.quantum_efficiency) for channel in sensor.channels.values()]
    assert max(peaks) == pytest.approx(0.65)
    assert made["assumed"] == photosite("sensors", "check", file, "--json").json["assumed"]
    assert {"channels.G", "noise.dsnu_e", "readout.system_gain_dn_per_e"} <= set(made["assumed"])
    assert not {"noise.read_noise_e", "pixel.pitch_um"} & set(made["assumed"])
    assert file.read_text().count("  # ") >= 8


def test_new_needs_what_every_data_sheet_states(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.sensor.yaml"
    refused = photosite("sensors", "new", *SHEET, "-o", file)
    assert refused.status == 2
    assert "--read-noise-e" in refused.err
    assert not file.exists()
    clear = photosite("sensors", "new", *SHEET, "--read-noise-e", 2.4, "--cfa", "WG/RX", "-o", file)
    assert "--cfa must be a tile of R, G, B, M, W, C, Y, Cy, Ir, P, got 'WG/RX'" in clear.err
    assert photosite("sensors", "new", *SHEET, "--read-noise-dn", 0.9, "-o", file).status == 0
    assert photosite("sensors", "new", *SHEET, "--read-noise-dn", 0.9, "-o", file).status == 2
    assert photosite("sensors", "new", *SHEET, "--read-noise-dn", 1.8, "-o", file, "--force").status == 0
    sensor = ps.load_sensor(file)
    assert sensor.noise.read_noise_mv.value / sensor.mv_per_dn == pytest.approx(1.8)


@pytest.mark.parametrize(
    ("given", "noise_dn"),
    [
        (("--read-noise-e", 2.4, "--system-gain-dn-per-e", 4), 9.6),
        (("--read-noise-e", 2.4, "--system-gain-e-per-dn", 0.25), 9.6),
        (("--read-noise-e", 2.4, "--conversion-gain-uv-per-e", 100, "--voltage-swing-v", 0.5), 1.966),
        (("--read-noise-mv", 0.24, "--conversion-gain-uv-per-e", 100, "--voltage-swing-v", 0.5), 1.966),
        (("--read-noise-mv", 0.24, "--conversion-gain-uv-per-e", 100, "--system-gain-dn-per-e", 4), 9.6),
        (("--read-noise-mv", 0.24, "--conversion-gain-uv-per-e", 100), 0.936),
        (("--read-noise-dn", 0.9), 0.9),
    ],
)
def test_new_has_dark_frames_that_do_not_clip(
    photosite: Any, tmp_path: Path, given: tuple[Any, ...], noise_dn: float
) -> None:
    """The assumed black level is eight times the read noise in DN, whichever units and gains are given."""
    file = tmp_path / "mine.sensor.yaml"
    assert photosite("sensors", "new", *SHEET, *given, "-o", file).status == 0
    sensor = ps.load_sensor(file)
    assert sensor.noise.read_noise_mv.value / sensor.mv_per_dn == pytest.approx(noise_dn, rel=0.02)
    assert 0 <= sensor.readout.black_level_dn.value - 8 * noise_dn < 1.5
    assert "Instead of" not in file.read_text()


def test_new_needs_volts_for_noise_in_volts(photosite: Any, tmp_path: Path) -> None:
    refused = photosite("sensors", "new", *SHEET, "--read-noise-mv", 0.24, "-o", tmp_path / "mine.sensor.yaml")
    assert refused.status == 2
    assert "conversion_gain_uv_per_e" in refused.err


def test_new_asks_on_a_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from click.testing import CliRunner

    from photosite.cli import sensors

    monkeypatch.setattr(sensors, "_is_terminal", lambda: True)
    file = tmp_path / "mine.sensor.yaml"
    given = [str(part) for part in SHEET]
    done = CliRunner().invoke(sensors.command, ["new", *given, "-o", str(file)], input="none\n2.4\n")
    assert done.exit_code == 0
    sensor = ps.load_sensor(file)
    assert sensor.electrons(sensor.noise.read_noise_mv.value) == pytest.approx(2.4)


@pytest.mark.smoke("sensors compare")
def test_compare(photosite: Any, tmp_path: Path) -> None:
    page = tmp_path / "sensors.html"
    call = ("sensors", "compare", "nikon-d200", "vendor-2.2um", "--f-number", "4", "--exposure", "1/30")
    shown = photosite(*call, "--report", page)
    assert shown.out.splitlines()[0] == "Sensors at f/4, 1/30 s, illuminant 3200K"
    assert [line.split()[0] for line in shown.out.splitlines()[2:4]] == ["nikon-d200", "vendor-2.2um"]
    assert page.is_file()
    content = photosite(*call, "--json").json
    assert content["sensors"]["nikon-d200"]["snr10_lux"] < content["sensors"]["vendor-2.2um"]["snr10_lux"]
    assert len(content["snr_db"]["nikon-d200"]) == len(content["luminance_cd_m2"])
    long = tmp_path / f"{'long' * 20}.sensor.yaml"
    long.write_text(dump_sensor(ps.load_sensor("nikon-d200")), encoding="utf-8")
    heading, *rows = photosite("sensors", "compare", "nikon-d200", long).out.splitlines()[1:]
    assert heading.endswith(" snr10_lux")
    assert rows[0].split()[1:] == rows[1].split()[1:]
    assert photosite("sensors", "compare").status == 2
    assert photosite("sensors", "compare", "nikon-d2000").status == 2
