"""Spectral sensitivities of rawtoaces' JSON and of CSV: values, origin, quantum efficiency, invalid files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_files import WAVELENGTHS, rawtoaces_content, write_json
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.library.spectra import csv_camera, rawtoaces_camera


def test_json_of_rawtoaces() -> None:
    camera = rawtoaces_camera(rawtoaces_content(), Path("x.json"))
    assert (camera.maker, camera.model, camera.license) == ("Nikon", "D850", "Apache-2.0")
    assert "a lab" in camera.provenance
    assert "2017-04-11" in camera.provenance
    assert camera.sensitivity.wavelength_nm.tolist() == list(WAVELENGTHS)
    assert camera.sensitivity.channels["G"][WAVELENGTHS.index(540)] == 1.0


def test_older_json_of_rawtoaces_has_a_quantity_and_no_license() -> None:
    content = rawtoaces_content()
    content["spectral_data"]["quantity"] = content["spectral_data"].pop("units")
    content["header"]["license"] = None
    assert rawtoaces_camera(content, Path("x.json")).license == ""


@pytest.mark.parametrize("name", ["Nikon_D200_380_780_5", "Nikon_D200_380_780_5.csv"])
def test_table_without_heading_has_the_wavelengths_in_its_name(tmp_path: Path, name: str) -> None:
    rows = rawtoaces_content()["spectral_data"]["data"]["main"]
    (tmp_path / name).write_text("".join(f"{r}, {g}, {b}\n" for r, g, b in rows.values()))
    camera = csv_camera(tmp_path / name)
    assert (camera.maker, camera.model) == ("Nikon", "D200")
    assert camera.sensitivity.wavelength_nm.tolist() == list(WAVELENGTHS)
    np.testing.assert_array_equal(camera.sensitivity.channels["B"], [row[2] for row in rows.values()])


def test_table_with_heading(tmp_path: Path) -> None:
    (tmp_path / "Acme_X-1.csv").write_text("wavelength_nm,red,green,blue\n400,0,0.1,0.9\n\n500,0.1,1,0.2\n")
    camera = csv_camera(tmp_path / "Acme_X-1.csv")
    assert (camera.maker, camera.model) == ("Acme", "X-1")
    assert {name: values.tolist() for name, values in camera.sensitivity.channels.items()} == {
        "R": [0, 0.1],
        "G": [0.1, 1],
        "B": [0.9, 0.2],
    }


def test_quantum_efficiency_is_the_response_per_photon() -> None:
    """A response per energy that grows with the wavelength is a constant quantum efficiency."""
    content = rawtoaces_content()
    content["spectral_data"]["data"]["main"] = {str(nm): [nm / 780] * 3 for nm in WAVELENGTHS}
    base = ps.load_sensor("nikon-d200")
    made = rawtoaces_camera(content, Path("x.json")).sensitivity.sensor(base)
    peak = max(max(channel.quantum_efficiency) for channel in base.channels.values())
    for channel in made.channels.values():
        np.testing.assert_allclose(channel.quantum_efficiency, peak, rtol=1e-12)
        assert channel.assumed


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"units": "radiance"}, "not 'relative'"),
        ({"data": {"main": {"380": [1, 1, 1]}}}, "2 or more wavelengths"),
        ({"data": {"main": {"380": [1, 1, 1], "390": [1, 1]}}}, "390 has 2 values"),
        ({"data": {"main": {"380": [1, 1, 1], "390": [1, 1, None]}}}, "must be a"),
        ({"data": {"main": {"380": [1, 1, 0], "390": [1, 1, 0]}}}, "every channel needs one above 0"),
        ({"data": {"main": {"0.38": [1, 1, 1], "0.39": [1, 1, 1]}}}, "in nm"),
        ({"index": {}}, "'main' is missing"),
    ],
)
def test_invalid_json(change: dict[str, Any], why: str) -> None:
    content = rawtoaces_content()
    content["spectral_data"] |= change
    with raises(FileError, "the file is not a table of spectral sensitivities") as caught:
        rawtoaces_camera(content, Path("x.json"))
    assert why in caught.value.what


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", ""),
        ("a.csv", "1,2,3\n4,5,6\n"),
        ("a_380_390_5.csv", "1,2,3\n4,5,6\n"),
        ("a.csv", "nm,R,G,B\n400,1,1\n"),
        ("a.csv", "nm,R,G,B\n400,1,1,x\n410,1,1,1\n"),
        ("a.csv", "nm,R,R,B\n400,1,1,1\n410,1,1,1\n"),
        ("a.csv", "nm,R,G,B\n410,1,1,1\n400,1,1,1\n"),
    ],
)
def test_invalid_tables(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with raises(FileError, "the file is not a table", path=str(tmp_path / name)):
        csv_camera(tmp_path / name)


@pytest.mark.parametrize(
    "heading", ["wavelength", "Wavelength_nm", "WAVELENGTH (nm)", "wavelength [nm]", "nm", "Lambda/nm", '"wavelength"']
)
def test_headings_of_the_wavelength(tmp_path: Path, heading: str) -> None:
    (tmp_path / "a.csv").write_text(f'{heading},"R",G,B\n400,1,2,3\n410,1,2,3\n')
    assert set(csv_camera(tmp_path / "a.csv").sensitivity.channels) == {"R", "G", "B"}


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("#Camera:Acme X-1\n#License: CC0-1.0\n400,0.25,0.5,1\n410,1,0.5,0.25\n", "RGB"),
        ("# camera = Acme X-1\n# license: CC0-1.0\nWellenlaenge\n".replace("Wellenlaenge\n", "")
         + "lambda [um];rot;gruen;blau\n0,4;0,25;0,5;1\n0,41;1;0,5;0,25\n", ("rot", "gruen", "blau")),
        ("# camera: Acme X-1\n# license: CC0-1.0\n0.4 0.25\n0.41 1\n", "M"),
    ],
)  # fmt: skip
def test_tables_as_people_write_them(tmp_path: Path, text: str, names: Any) -> None:
    (tmp_path / "ssf.csv").write_text(text)
    camera = csv_camera(tmp_path / "ssf.csv")
    assert (camera.model, camera.license) == ("Acme X-1", "CC0-1.0")
    np.testing.assert_allclose(camera.sensitivity.wavelength_nm, [400, 410], rtol=1e-14)
    assert tuple(camera.sensitivity.channels) == tuple(names)
    assert camera.sensitivity.channels[names[0]].tolist() == [0.25, 1.0]


@pytest.mark.parametrize(
    ("text", "why", "line"),
    [
        ("# a\n1,2,3,4\n4,5,6,7\n", "the first column is no wavelength in nm or um, 1", 2),
        ("400,1,2,3\n420,1,2,3\n410,1,2,3\n", "the wavelengths must increase, 410 does not", 3),
        ("400,1,2\n410,1,2\n", "the row has 3 cells, not 2 or 4", 1),
        ("400;1,5,2\n410;1;2\n", "a cell is not a finite number: '1,5,2'", 1),
    ],
)
def test_the_line_of_what_is_wrong(tmp_path: Path, text: str, why: str, line: int) -> None:
    (tmp_path / "a.csv").write_text(text)
    with raises(FileError, f"the file is not a table of spectral sensitivities: {why}", line=line):
        csv_camera(tmp_path / "a.csv")


@pytest.mark.parametrize("heading", ["foo", "", "R", "nm2"])
def test_a_heading_that_is_no_wavelength(tmp_path: Path, heading: str) -> None:
    (tmp_path / "a.csv").write_text(f"\n{heading},R,G,B\n400,1,2,3\n410,1,2,3\n")
    with raises(FileError, "the heading of the first column", value=heading, line=2):
        csv_camera(tmp_path / "a.csv")


@pytest.mark.parametrize("row", ["410,1,1", "410,1,1,x", "410,1,1,nan", "410,1,1,1,1"])
def test_an_invalid_row_is_named_by_its_line(tmp_path: Path, row: str) -> None:
    (tmp_path / "a.csv").write_text(f"nm,R,G,B\n400,1,1,1\n\n{row}\n")
    with raises(FileError, "the file is not a table", line=4):
        csv_camera(tmp_path / "a.csv")


def test_large_and_binary_tables(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    with raises(FileError, "is not a table"):
        csv_camera(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_bytes(b"1,2,3\n" * 200_000)
    with raises(FileError, "is not a table"):
        csv_camera(tmp_path / "b.csv")


def test_json_file_of_another_kind(tmp_path: Path) -> None:
    from photosite.library.sources import find_cameras

    with raises(FileError, "the file is neither"):
        find_cameras(write_json(tmp_path / "a.json", {"a": 1}))


@pytest.mark.parametrize("unit", [" (%)", " [%]", " %", "_percent", "(percent)", "/%", ", percent"])
def test_percent_in_a_heading_is_percent(tmp_path: Path, unit: str) -> None:
    """Columns in percent and as fractions are of one scale, and channels have their names."""
    lines = [f'nm;R{unit};G;"B{unit}"', "400;2;0.05;40", "500;3;0.5;30", "600;55;0.2;3"]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    found = csv_camera(tmp_path / "a.csv").sensitivity
    assert found.channels.keys() == {"R", "G", "B"}
    for name, values in {"R": [0.02, 0.03, 0.55], "G": [0.05, 0.5, 0.2], "B": [0.4, 0.3, 0.03]}.items():
        np.testing.assert_allclose(found.channels[name], values, rtol=1e-14)
    made = found.sensor(ps.load_sensor("nikon-d200"))
    assert made.channels.keys() == {"R", "G", "B"}


def test_headings_that_are_no_channels_of_the_sensor(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("nm,R,Gr,B\n400,1,2,3\n410,1,2,3\n")
    with raises(InputError, "the headings of the spectral sensitivity", value=["R", "Gr", "B"]):
        csv_camera(tmp_path / "a.csv").sensitivity.sensor(ps.load_sensor("nikon-d200"))


def test_the_only_column_is_the_only_channel(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("nm,QE (%)\n400,10\n410,50\n")
    mono = ps.load_sensor("sony-imx174")
    made = csv_camera(tmp_path / "a.csv").sensitivity.sensor(mono)
    peak = max(mono.channels["M"].quantum_efficiency)
    np.testing.assert_allclose(made.channels["M"].quantum_efficiency, [0.2 * 410 / 400 * peak, peak], rtol=1e-12)
