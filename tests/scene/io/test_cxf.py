"""CxF3: forms of other programs, kinds of measurements, places of patches, and invalid files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from raising import raises

import photosite as ps
from photosite.errors import FileError
from photosite.scene.io.cxf import read_patches

LIGHT = {"illuminant": "D65", "mean_luminance_cd_m2": 100.0}
VALUES = np.round(np.random.default_rng(7).uniform(0.05, 0.9, (6, 4)), 4)


def sample(name: str, values: np.ndarray, kind: str = "Target", start: str = ' StartWL="400"', place: str = "") -> str:
    numbers = "\n    ".join(f"{value:g}" for value in values)
    return (
        f'<cc:Object ObjectType="{kind}" Name="{name}" Id="c{name}"><cc:ColorValues>\n'
        f'<cc:ReflectanceSpectrum ColorSpecification="CS1"{start}>{numbers}</cc:ReflectanceSpectrum>'
        f"</cc:ColorValues>{place}</cc:Object>"
    )


def written(tmp_path: Path, *samples: str, grid: str = '<cc:WavelengthRange StartWL="400" Increment="100"/>') -> Path:
    path = tmp_path / "chart.cxf"
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<cc:CxF xmlns:cc="http://colorexchangeformat.com/CxF3-core">\n'
        f"<cc:Resources><cc:ObjectCollection>{''.join(samples)}</cc:ObjectCollection>"
        '<cc:ColorSpecificationCollection><cc:ColorSpecification Id="CS1"><cc:MeasurementSpec>'
        f"<cc:MeasurementType>Spectrum_Reflectance</cc:MeasurementType>{grid}</cc:MeasurementSpec>"
        "</cc:ColorSpecification></cc:ColorSpecificationCollection></cc:Resources></cc:CxF>",
        encoding="utf-8",
    )
    return path


def test_a_chart_of_named_reflectances(tmp_path: Path) -> None:
    path = written(tmp_path, *(sample(f"P{k}", row) for k, row in enumerate(VALUES)))
    table = read_patches(path)
    assert table.names == tuple(f"P{k}" for k in range(6))
    assert table.wavelength_nm.tolist() == [400, 500, 600, 700]
    assert_allclose(table.values, VALUES)
    scene = ps.read_scene(path, **LIGHT)
    found = [scene.weights[:, part.r0, part.c0].astype(float) @ scene.reflectance for part in scene.regions]
    assert_allclose(found, VALUES, atol=1e-6)


def test_wavelengths_of_the_spectrum_and_of_its_specification(tmp_path: Path) -> None:
    """StartWL of the spectrum counts first; without an increment, the standard's steps of 10 nm."""
    path = written(tmp_path, sample("a", VALUES[0], start=' StartWL="380"'), grid="")
    assert read_patches(path).wavelength_nm.tolist() == [380, 390, 400, 410]
    path = written(tmp_path, sample("a", VALUES[0], start=""))
    assert read_patches(path).wavelength_nm.tolist() == [400, 500, 600, 700]


def test_percent(tmp_path: Path) -> None:
    path = written(tmp_path, *(sample(f"P{k}", 100 * row) for k, row in enumerate(VALUES)))
    scene = ps.read_scene(path, **LIGHT)
    part = scene.regions[0]
    assert_allclose(scene.weights[:, part.r0, part.c0].astype(float) @ scene.reflectance, VALUES[0], atol=1e-6)


def test_kinds_of_measurements_are_chosen(tmp_path: Path) -> None:
    both = [sample(f"{kind}{k}", (1 + m) / 4 * VALUES[k], kind) for m, kind in enumerate(("M0", "M1")) for k in (0, 1)]
    path = written(tmp_path, *both)
    with raises(FileError, "has spectra of 2 kinds of objects: M0, M1", hint="Pass {variable}"):
        read_patches(path)
    assert_allclose(ps.read_scene(path, **LIGHT, variable="M1").reflectance.shape[1], 4)
    assert read_patches(path, "M1").names == ("M10", "M11")
    assert_allclose(read_patches(path, "M1").values, VALUES[:2] / 2)
    with raises(FileError, "variable", value="M2"):
        read_patches(path, "M2")


def test_stated_locations_are_the_layout(tmp_path: Path) -> None:
    def place(row: int, col: int) -> str:
        tags = f'<cc:Tag Name="Row" Value="{row}"/><cc:Tag Name="Column" Value="{col}"/>'
        return f'<cc:TagCollection Name="Location">{tags}</cc:TagCollection>'

    where = [(1, 0), (0, 1), (0, 0), (1, 1)]
    path = written(tmp_path, *(sample(f"s{k}", VALUES[k], place=place(*where[k])) for k in range(4)))
    table = read_patches(path)
    assert table.names == ("s2", "s1", "s0", "s3")
    assert table.cols == 2
    assert_allclose(table.values[0], VALUES[2])


ENTITIES = '<?xml version="1.0"?><!DOCTYPE CxF [<!ENTITY a "1"><!ENTITY b "&a;&a;">]><CxF>&b;</CxF>'


@pytest.mark.parametrize(
    ("content", "what", "line"),
    [
        ("<CxF>\n<Resources>", "is no valid XML: no element found", 2),
        ("", "is no valid XML: no element found", 1),
        ("reflectance 1 2 3", "is no valid XML: syntax error", 1),
        (ENTITIES, "has a document type declaration, which CxF3 has not", 1),
        ('<!DOCTYPE CxF SYSTEM "file:///etc/passwd"><CxF/>', "has a document type declaration", 1),
        ("<svg/>", "is not CxF3: its first element is <svg>", 1),
        ("<CxF/>", "has no object with a reflectance spectrum", None),
        ("<CxF>" + "<a>" * 100 + "</a>" * 100 + "</CxF>", "has elements in more than 64 others", 1),
        ('<?xml version="1.0" encoding="klingon"?><CxF/>', "is no valid XML: unknown encoding", 1),
    ],
)
def test_files_that_are_not_cxf(tmp_path: Path, content: str, what: str, line: int | None) -> None:
    path = tmp_path / "chart.cxf"
    path.write_text(content)
    with pytest.raises(FileError) as error:
        ps.read_scene(path, **LIGHT)
    assert error.value.what.startswith(what)
    assert error.value.line == line


@pytest.mark.parametrize(
    ("samples", "what"),
    [
        ([sample("a", VALUES[0]), sample("a", VALUES[1])], "patch 'a' is in line 3 too"),
        ([sample("a", VALUES[0]), sample("b", VALUES[1][:3])], "wavelengths"),
        ([sample("a", VALUES[0], start=' StartWL="x"')], "StartWL"),
        ([sample("a", VALUES[0], start=' StartWL="-400"')], "spectrum"),
        ([sample("a", VALUES[0][:0])], "spectrum"),
        ([sample("a", VALUES[0]).replace("</cc:Refl", "1,,2</cc:Refl")], "a value of a spectrum"),
    ],
)
def test_invalid_spectra(tmp_path: Path, samples: list[str], what: str) -> None:
    path = written(tmp_path, *samples)
    with pytest.raises(FileError) as error:
        read_patches(path)
    assert error.value.what == what
    assert error.value.line is not None


def test_a_spectrum_without_a_first_wavelength(tmp_path: Path) -> None:
    with raises(FileError, "a spectrum states no first wavelength (StartWL)"):
        read_patches(written(tmp_path, sample("a", VALUES[0], start=""), grid=""))
