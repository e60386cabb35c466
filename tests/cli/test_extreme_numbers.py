"""Numbers that no device has, in options and files: one line that names the field, in short time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from photosite.errors import InputError
from photosite.values.exposure import LONGEST_S, SHORTEST_S, check_exposure
from photosite.values.limits import LIMITS_OF_OTHERS, check_magnitude

EXTREME = ["1e300", "5e-324", "1e40", "-1e300", "nan", "inf", "-inf"]
SMALL = ("--rows", 12, "--cols", 16)


@pytest.fixture
def ends_well(photosite: Any) -> Any:
    """Runs a command that may succeed or fail with one line."""

    def call(*arguments: object) -> str:
        done = photosite(*arguments)
        lines = [line for line in done.err.splitlines() if line.startswith("photosite: ") and "warning" not in line]
        assert (done.status, len(lines)) in ((0, 0), (2, 1)), done
        return lines[0] if lines else ""

    return call


@pytest.mark.parametrize("number", EXTREME)
@pytest.mark.parametrize(
    "option", ["--width", "--distance", "--f-number", "--focal-length", "--exposure", "--luminance", "--fps"]
)
def test_options_of_simulate(ends_well: Any, tmp_path: Path, option: str, number: str) -> None:
    assert option in ends_well("simulate", *SMALL, f"{option}={number}", "-o", tmp_path / "a.tif")


@pytest.mark.parametrize("number", EXTREME)
@pytest.mark.parametrize("option", ["--longest-flat", "--longest-dark", "--level"])
def test_options_of_plan(ends_well: Any, option: str, number: str) -> None:
    assert option in ends_well("plan", "--rows", 99, "--cols", 99, "--want", "prnu_percent=2%", f"{option}={number}")


@pytest.mark.parametrize("number", EXTREME)
@pytest.mark.parametrize("step", ["dark:{}:50", "light:1/50:{}"])
def test_steps_of_a_plan(ends_well: Any, step: str, number: str) -> None:
    assert ends_well("plan", "--rows", 99, "--cols", 99, "--step", step.format(number))


CAMERA = """photosite_camera: 1
sensor: nikon-d200
optics: {f_number: 8, focal_length_mm: 50, blur: {kind: wavefront, zernike: {8: 30}, unit: nm, defocus_um: 1.5}}
scene: {source: macbeth, illuminant: A, luminance_cd_m2: 40, distance_m: 1.2, width_m: 0.5}
exposure: 0.3
"""


SHEET = {"pixel-um": 3.45, "full-well-e": 10500, "qe-peak": 0.65, "read-noise-e": 2, "bits": 12, "rows": 24, "cols": 32}
GAINS = ["system-gain-dn-per-e", "system-gain-e-per-dn", "conversion-gain-uv-per-e", "voltage-swing-v"]


@pytest.mark.parametrize("number", [*EXTREME, "0", "1e-320"])
@pytest.mark.parametrize("option", ["full-well-e", "read-noise-e", "qe-peak", "pixel-um", *GAINS])
def test_options_of_a_new_sensor(ends_well: Any, tmp_path: Path, option: str, number: str) -> None:
    given = [f"--{name}={value}" for name, value in (SHEET | {option: number}).items()]
    line = ends_well("sensors", "new", *given, "-o", tmp_path / "a.sensor.yaml")
    assert option in line.replace("_", "-") or (option, number) == ("read-noise-e", "0")


@pytest.mark.parametrize("value", ["1e300", "1e-320", "{value: 1, standard_uncertainty: 1e300}"])
@pytest.mark.parametrize("field", ["system_gain_dn_per_e", "system_gain_e_per_dn"])
def test_gains_of_a_sensor_file(ends_well: Any, tmp_path: Path, field: str, value: str) -> None:
    file = tmp_path / "a.sensor.yaml"
    assert not ends_well("sensors", "new", *[f"--{name}={given}" for name, given in SHEET.items()], "-o", file)
    lines = [line for line in file.read_text().splitlines() if "system_gain" not in line]
    file.write_text("\n".join(lines).replace("readout:", f"readout:\n  {field}: {value}") + "\n")
    line = ends_well("sensors", "check", file)
    assert field in line
    assert "a.sensor.yaml:" in line


@pytest.mark.parametrize("number", EXTREME)
def test_the_gain_setting_of_an_export(ends_well: Any, tmp_path: Path, number: str) -> None:
    line = ends_well(
        "export", "vendor-2.2um", "darktable", f"--gain-setting={number}", "--model", "B", "-o", tmp_path / "a.json"
    )
    assert "--gain-setting" in line


@pytest.mark.parametrize("number", [".inf", "1e300", "5e-324", "1e-40"])
@pytest.mark.parametrize(
    ("field", "old"),
    [
        ("f_number", "f_number: 8"),
        ("focal_length_mm", "focal_length_mm: 50"),
        ("defocus_um", "defocus_um: 1.5"),
        ("distance", "distance_m: 1.2"),
        ("width", "width_m: 0.5"),
        ("exposure", "exposure: 0.3"),
    ],
)
def test_numbers_of_a_camera_file(ends_well: Any, tmp_path: Path, field: str, old: str, number: str) -> None:
    if field == "defocus_um" and number == "1e-40":
        return  # no defocus
    file = tmp_path / "a.camera.yaml"
    file.write_text(CAMERA.replace(old, f"{old.split(':')[0]}: {number}"))
    assert field in ends_well("simulate", "--camera", file, *SMALL, "-o", tmp_path / "a.tif")


@pytest.mark.parametrize("wavelengths", ["400,1e300", "1e-300,500", "1:1e6:1", "-500,400"])
def test_wavelengths(ends_well: Any, tmp_path: Path, wavelengths: str) -> None:
    assert "wavelength" in ends_well("simulate", *SMALL, f"--wavelengths={wavelengths}", "-o", tmp_path / "a.tif")


def test_large_pixels_behind_a_fast_lens(ends_well: Any, tmp_path: Path) -> None:
    """100 um at f/1 need 200 000 folded terms, minutes; with more cells per pixel, few."""
    large = ("simulate", *SMALL, "--sensor-option", "width_um=100", "--sensor-option", "height_um=100")
    large += ("--f-number", 1, "--exposure", "1e-6", "--wavelengths", "500,600", "-o", tmp_path / "a.tif", "--force")
    line = ends_well(*large)
    assert "--cells" in line
    assert not ends_well(*large, "--cells", 27)


@pytest.mark.parametrize("factor", [13, 10**9])
def test_blocks_larger_than_the_chip(ends_well: Any, tmp_path: Path, factor: int) -> None:
    assert "--bin" in ends_well(
        "simulate", *SMALL, "--sensor", "sony-imx174", "--bin", factor, "-o", tmp_path / "a.tif"
    )


def test_a_chip_of_one_pixel(ends_well: Any, tmp_path: Path) -> None:
    assert "1 x 1" in ends_well("plan", "--want", "prnu_percent=2%", "--rows", 1, "--cols", 1)
    assert not ends_well("shoot", "--rows", 1, "--cols", 1, "-o", tmp_path / "stack")


@pytest.mark.parametrize("number", [10**10, 2**63, 10**30, -(10**30)])
@pytest.mark.parametrize("option", ["--crops", "--draws", "--chips", "--averaged", "--pairs-per-shard", "--processes"])
def test_counts_of_a_dataset(ends_well: Any, tmp_path: Path, option: str, number: int) -> None:
    line = ends_well("dataset", "macbeth", f"{option}={number}", "-o", tmp_path / "pairs")
    assert option in line
    assert "1 or more" in line if number < 0 and "chips" not in option and "proc" not in option else "1 to" in line


def test_combinations_of_a_sweep(ends_well: Any, tmp_path: Path) -> None:
    """A thousand values of five fields are 10^15 combinations."""
    values = [1 + k / 1000 for k in range(1000)]
    fields = ("pixel_width_um", "f_number", "focal_length_mm", "read_noise_e", "distance_m")
    file = tmp_path / "a.sweep.yaml"
    file.write_text(
        "photosite_sweep: 1\ncamera: {sensor: google-pixel-4a, optics: {f_number: 2.8, focal_length_mm: 4}}\n"
        f"values: {dict.fromkeys(fields, values)}\n"
    )
    assert "combinations" in ends_well("sweep", file, "-o", tmp_path / "a.csv")


def test_limits_follow_from_the_name() -> None:
    check_magnitude("distance_m", 1e20)
    check_magnitude("seed", 2**64)  # whole numbers have limits of their own
    check_magnitude("focus_distance_m", float("inf"))
    for name, value in (("distance_m", 1e21), ("wavelength_nm", [500.0, 1e7]), ("k1", 1e16), ("k1", 1e-101)):
        with pytest.raises(InputError) as caught:
            check_magnitude(name, value)
        assert caught.value.what == name
    for value in (0.0, -LIMITS_OF_OTHERS[1], LIMITS_OF_OTHERS[0]):
        check_magnitude("k1", value)


@pytest.mark.parametrize("exposure_s", [SHORTEST_S / 2, LONGEST_S * 2, 5e-324, 1e300])
def test_exposure_times(exposure_s: float) -> None:
    with pytest.raises(InputError) as caught:
        check_exposure(exposure_s)
    assert caught.value.what == "exposure_s"
    assert check_exposure(SHORTEST_S) == SHORTEST_S
