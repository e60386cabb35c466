"""Measured charts, CGATS and CSV: dialects, layout, round trips, and invalid files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from raising import warns
from scene_files import error_of

import photosite as ps
from photosite.color.spectrum import photons_from_energy
from photosite.errors import FileError, PhotositeWarning
from photosite.scene.io import cgats, chart_csv
from photosite.scene.io.formats import read_scene, write_scene
from photosite.scene.scene import Scene

LIGHT = {"illuminant": "D65", "mean_luminance_cd_m2": 100.0}
GRID = [400, 500, 600, 700]
NAMES = ["white", "light gray", "gray", "red", "green", "blue"]
VALUES = np.round(np.random.default_rng(7).uniform(0.05, 0.9, (6, 4)), 4)


def reflectances(scene: Scene) -> np.ndarray:
    """(patches, wavelengths) in the order of the regions."""
    assert scene.reflectance is not None
    return np.array([scene.weights[:, part.r0, part.c0].astype(float) @ scene.reflectance for part in scene.regions])


def cgats_text(
    values: np.ndarray = VALUES,
    names: list[str] = NAMES,
    field: str = "SPECTRAL_NM_{}",
    keywords: str = "",
    grid: list[int] = GRID,
    between: str = " ",
) -> str:
    """Return a file as other programs export it."""
    fields = ["SAMPLE_ID", "SAMPLE_NAME", *(field.format(wavelength) for wavelength in grid)]
    quote = '"' if between == " " else ""
    rows = [
        between.join([str(k + 1), f"{quote}{name}{quote}", *(f"{value:.6g}" for value in row)])
        for k, (name, row) in enumerate(zip(names, values, strict=True))
    ]
    return (
        f'CGATS.17\nORIGINATOR "somebody"\n{keywords}NUMBER_OF_FIELDS {len(fields)}\nBEGIN_DATA_FORMAT\n'
        f"{between.join(fields)}\nEND_DATA_FORMAT\nNUMBER_OF_SETS {len(rows)}\nBEGIN_DATA\n"
        + "\n".join(rows)
        + "\nEND_DATA\n"
    )


def csv_text(values: np.ndarray = VALUES, names: list[str] = NAMES, heading: str = "patch,400,500,600,700") -> str:
    rows = [",".join([name, *(f"{value:.6g}" for value in row)]) for name, row in zip(names, values, strict=True)]
    return "\n".join([heading, *rows, ""])


def written(tmp_path: Path, text: str, name: str = "chart.txt") -> Path:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    "field",
    ["SPECTRAL_NM_{}", "SPECTRAL_NM{}", "SPECTRAL_{}", "SPEC_{}", "nm{}", "NM_{}", "R_{}nm", "R_{}", "S_{}", "{}"],
)
@pytest.mark.parametrize("between", [" ", "\t"])
def test_fields_of_spectra(tmp_path: Path, field: str, between: str) -> None:
    scene = read_scene(written(tmp_path, cgats_text(field=field, between=between)), **LIGHT)
    assert scene.wavelength_nm.tolist() == GRID
    assert [part.name for part in scene.regions] == NAMES
    assert_allclose(reflectances(scene), VALUES, atol=2e-5)
    assert scene.name.startswith("chart")


def test_the_measurements_of_an_icc_profile(tmp_path: Path) -> None:
    text = b"text\0\0\0\0" + cgats_text().encode() + b"\0"
    head = bytes(36) + b"acsp" + bytes(88) + (2).to_bytes(4, "big")
    tags = [(b"cprt", 156, 12), (b"targ", 168, len(text))]
    table = b"".join(name + offset.to_bytes(4, "big") + size.to_bytes(4, "big") for name, offset, size in tags)
    file = tmp_path / "printer.icc"
    file.write_bytes(head + table + b"text\0\0\0\0abc\0" + text)
    assert_allclose(reflectances(read_scene(file, **LIGHT)), VALUES, atol=2e-5)
    file.write_bytes((head + table).replace(b"targ", b"xxxx"))
    assert "tag targ" in error_of(file, **LIGHT).what


def test_wavelength_and_value_in_turn(tmp_path: Path) -> None:
    fields = "SAMPLE_ID " + "SPECTRAL_NM SPECTRAL_PCT " * 2
    rows = "A1 400 50.0 500 1.0\nA2 400 2.0 500 3.0\n"
    text = f"IT8.7/1\nBEGIN_DATA_FORMAT\n{fields}\nEND_DATA_FORMAT\nBEGIN_DATA\n{rows}END_DATA\n"
    file = written(tmp_path, text)
    assert_allclose(cgats.read_patches(file).values, [[50, 1], [2, 3]])
    scene = read_scene(file, **LIGHT)
    assert_allclose(reflectances(scene), [[0.5, 0.01], [0.02, 0.03]], atol=2e-6)
    decimal = (
        text.replace("SPECTRAL_PCT", "SPECTRAL_DEC").replace("50.0", "0.5").replace("2.0", ".02").replace("3.0", ".03")
    )
    assert read_scene(written(tmp_path, decimal), **LIGHT, negative="zero").shape == scene.shape
    other = text.replace("A2 400", "A2 410")
    error = error_of(written(tmp_path, other), **LIGHT)
    assert (error.line, "other wavelengths" in error.what) == (7, True)


def test_the_first_table_with_spectra_is_read(tmp_path: Path) -> None:
    colors = (
        "CGATS.17\nBEGIN_DATA_FORMAT\nSAMPLE_ID LAB_L LAB_A LAB_B\nEND_DATA_FORMAT\nBEGIN_DATA\n1 2 3 4\nEND_DATA\n"
    )
    scene = read_scene(written(tmp_path, f"{colors}\n# a note\n{cgats_text()}"), **LIGHT)
    assert_allclose(reflectances(scene), VALUES, atol=2e-5)


def test_sets_over_several_lines(tmp_path: Path) -> None:
    text = cgats_text()
    head, body = text.split("BEGIN_DATA\n")
    body = body.replace('" 0', '"\n   0')
    scene = read_scene(written(tmp_path, f"{head}BEGIN_DATA\n{body}"), **LIGHT)
    assert_allclose(reflectances(scene), VALUES, atol=2e-5)


def test_percent_fraction_and_argylls_norm(tmp_path: Path) -> None:
    assert_allclose(reflectances(read_scene(written(tmp_path, cgats_text(VALUES * 100)), **LIGHT)), VALUES, atol=2e-5)
    stated = read_scene(written(tmp_path, cgats_text(VALUES * 100)), units="percent", **LIGHT)
    assert_allclose(reflectances(stated), VALUES, atol=2e-5)
    argyll = 'DEVICE_CLASS "OUTPUT"\nSPECTRAL_NORM "50.0"\n'
    normed = read_scene(written(tmp_path, cgats_text(VALUES * 50, keywords=argyll)), **LIGHT)
    assert_allclose(reflectances(normed), VALUES, atol=2e-5)
    # The norm of a display's measurement is not one of reflectance.
    display = argyll.replace("OUTPUT", "DISPLAY")
    assert "percent or fractions" in error_of(written(tmp_path, cgats_text(VALUES * 3, keywords=display)), **LIGHT).what


@pytest.mark.parametrize(
    ("values", "names"),
    [(VALUES * 2, NAMES), (VALUES[:1], NAMES[:1]), (VALUES[:5], NAMES[:5])],
    ids=["up to 1.8", "one", "five"],
)
def test_ambiguous_scale_needs_units(tmp_path: Path, values: np.ndarray, names: list[str]) -> None:
    file = written(tmp_path, cgats_text(values, names))
    assert error_of(file, **LIGHT).arguments == {"units": "percent"}
    assert_allclose(reflectances(read_scene(file, units="reflectance", **LIGHT)), values, atol=1e-4)


def test_decimal_comma_and_latin_1(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_bytes(cgats_text(names=["weiß", *NAMES[1:]]).replace("0.", "0,").encode("latin-1"))
    scene = read_scene(file, **LIGHT)
    assert scene.regions[0].name == "weiß"
    assert_allclose(reflectances(scene), VALUES, atol=2e-5)
    file.write_bytes(cgats_text(names=["weiß", *NAMES[1:]]).encode("utf-16"))
    assert cgats.read_patches(file).names[0] == "weiß"


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_csv_both_ways(tmp_path: Path, mark: str) -> None:
    down = written(tmp_path, csv_text().replace(",", mark), "down.csv")
    heading = ["wavelength_nm", *NAMES]
    rows = [[str(wavelength), *map(str, column)] for wavelength, column in zip(GRID, VALUES.T, strict=True)]
    across = written(tmp_path, "\n".join(mark.join(row) for row in [heading, *rows]), "across.csv")
    first, second = chart_csv.read_patches(down), chart_csv.read_patches(across)
    assert first.names == second.names == tuple(NAMES)
    assert_allclose(first.values, VALUES)
    assert_allclose(second.values, VALUES)
    assert first.wavelength_nm.tolist() == second.wavelength_nm.tolist() == GRID


def test_csv_with_decimal_commas_and_other_columns(tmp_path: Path) -> None:
    text = "name;L*;400 nm;500 nm\n" + "".join(f"p{k};50,1;0,{k}5;0,2\n" for k in range(6))
    table = chart_csv.read_patches(written(tmp_path, text, "a.csv"))
    assert table.wavelength_nm.tolist() == [400, 500]
    assert_allclose(table.values[:, 0], [0.05, 0.15, 0.25, 0.35, 0.45, 0.55])


def test_wavelengths_in_micrometers(tmp_path: Path) -> None:
    file = written(tmp_path, csv_text(heading="patch,0.4um,0.5um,0.6um,0.7um"), "a.csv")
    assert_allclose(chart_csv.read_patches(file).wavelength_nm, GRID)
    file = written(tmp_path, csv_text(heading="patch,0.4,0.5,0.6,0.7"), "b.csv")
    assert_allclose(read_scene(file, **LIGHT).wavelength_nm, GRID)
    file = written(tmp_path, csv_text(heading="patch,0.04,0.5,0.6,0.7"), "c.csv")
    assert "has no unit of its wavelengths" in error_of(file, **LIGHT).what


@pytest.mark.parametrize(
    "heading",
    [
        "patch;R_400nm;R_500nm;R_600nm;R_700nm",
        "patch;Band 400 nm;Band 500 nm;Band 600 nm;Band 700 nm",
        "patch;0,4;0,5;0,6;0,7",
    ],
)
def test_headings_of_wavelengths(tmp_path: Path, heading: str) -> None:
    text = csv_text(heading=heading).replace(",", ";").replace("0.", "0,")
    text = text.replace(text.splitlines()[0], heading)
    scene = read_scene(written(tmp_path, text, "a.csv"), **LIGHT)
    assert_allclose(scene.wavelength_nm, GRID, rtol=1e-14)
    assert_allclose(reflectances(scene), VALUES, atol=2e-5)


def test_measured_radiances_are_kept(tmp_path: Path) -> None:
    file = written(tmp_path, "# units: W/m2/sr/nm\n" + csv_text(VALUES / 1000), "a.csv")
    scene = read_scene(file, distance_m=2, width_m=0.5)
    expected = photons_from_energy(VALUES / 1000, GRID)
    found = [scene.radiance(part.r0, part.c0) for part in scene.regions]
    assert_allclose(found, expected, rtol=1e-3)
    assert scene.reflectance is None
    assert (scene.distance_m, scene.width_m) == (2, 0.5)
    photons = read_scene(written(tmp_path, csv_text(VALUES * 1e15), "b.csv"), units="photons/s/sr/m2/nm")
    assert_allclose([photons.radiance(p.r0, p.c0) for p in photons.regions], VALUES * 1e15, rtol=1e-3)
    assert "has radiances" in error_of(file, illuminant="A").what


def region_places(scene: Scene) -> dict[str, tuple[int, int]]:
    return {part.name: (part.r0 // 32, part.c0 // 32) for part in scene.regions}


def test_letters_are_rows_and_numbers_columns(tmp_path: Path) -> None:
    names = ["B2", "A1", "A3", "B1", "A2", "B3"]
    places = region_places(read_scene(written(tmp_path, csv_text(names=names), "a.csv"), **LIGHT))
    assert places == {"A1": (0, 0), "A2": (0, 1), "A3": (0, 2), "B1": (1, 0), "B2": (1, 1), "B3": (1, 2)}
    scene = read_scene(tmp_path / "a.csv", **LIGHT)
    assert_allclose(reflectances(scene), VALUES[[names.index(part.name) for part in scene.regions]], atol=2e-5)


def test_order_of_the_file_and_patches_across(tmp_path: Path) -> None:
    file = written(tmp_path, csv_text(), "a.csv")
    assert region_places(read_scene(file, **LIGHT))["blue"] == (1, 2)
    assert region_places(read_scene(file, patch_cols=2, **LIGHT))["blue"] == (2, 1)
    stated = written(tmp_path, cgats_text(keywords='LGOROWLENGTH "2"\n'))
    assert region_places(read_scene(stated, **LIGHT))["blue"] == (2, 1)
    gaps = written(tmp_path, csv_text(names=["A1", "A2", "A4", "B1", "B2", "B3"]), "b.csv")
    assert region_places(read_scene(gaps, **LIGHT))["B3"] == (1, 2)


@pytest.mark.parametrize("name", ["chart.csv", "chart.cgats", "chart.tsv"])
def test_round_trip(tmp_path: Path, name: str) -> None:
    chart = ps.charts.macbeth("D65", 100)
    write_scene(chart, tmp_path / name)
    back = read_scene(tmp_path / name, **LIGHT)
    assert [part.name for part in back.regions] == [part.name for part in chart.regions]
    assert region_places(back) == region_places(chart)
    assert back.name == chart.name == "ColorChecker, illuminant D65"
    assert_allclose(reflectances(back), reflectances(chart), atol=5e-5)
    for part in chart.regions:
        there, here = back.radiance(part.r0, part.c0), chart.radiance(part.r0, part.c0)
        assert np.linalg.norm(there - here) < 1e-3 * np.linalg.norm(here), part.name


def test_round_trip_of_radiance(tmp_path: Path) -> None:
    from dataclasses import replace

    chart = replace(ps.charts.macbeth("A", 40), reflectance=None)
    write_scene(chart, tmp_path / "a.csv")
    back = read_scene(tmp_path / "a.csv")
    for part in chart.regions:
        there, here = back.radiance(part.r0, part.c0), chart.radiance(part.r0, part.c0)
        assert np.linalg.norm(there - here) < 1e-3 * np.linalg.norm(here), part.name
    with pytest.raises(FileError) as caught:
        write_scene(chart, tmp_path / "a.cgats")
    assert "CGATS needs reflectances" in caught.value.what


def test_a_scene_without_patches_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(FileError) as caught:
        write_scene(ps.charts.uniform(), tmp_path / "a.csv")
    assert "has no patches" in caught.value.what
    assert list(tmp_path.iterdir()) == []


INVALID_CGATS = [
    ("hello", None, "BEGIN_DATA_FORMAT"),
    (cgats_text().replace("END_DATA\n", ""), 8, "is truncated"),
    (cgats_text().replace("NUMBER_OF_SETS 6", "NUMBER_OF_SETS 7"), 8, "NUMBER_OF_SETS"),
    (cgats_text().replace("NUMBER_OF_FIELDS 6", "NUMBER_OF_FIELDS 5"), 8, "NUMBER_OF_FIELDS"),
    (cgats_text().replace(f"{VALUES[2, 1]:.6g}", "n/a", 1), 11, "SPECTRAL_NM_500"),
    (cgats_text().replace(f" {VALUES[2, 1]:.6g}", "", 1), 11, "number of values"),
    (cgats_text().replace(f"{VALUES[2, 1]:.6g}", "nan", 1), None, "missing value"),
    (cgats_text().replace(f"{VALUES[2, 1]:.6g}", "-0.01", 1), None, "negative value"),
    (cgats_text(field="LAB_{}"), None, "has no spectra"),
    (cgats_text(grid=[400, 600, 500, 700]), None, ""),
    (cgats_text(grid=[400, 500, 500, 700]), None, ""),
    (cgats_text(VALUES * 0), None, "all values are 0"),
    (cgats_text(keywords='DEVICE_CLASS "OUTPUT"\nSPECTRAL_NORM "0"\n'), None, "SPECTRAL_NORM"),
]
INVALID_CSV = [
    ("", None, "has no chart"),
    ("1,2,3\n4,5,6\n", None, ""),
    (csv_text(heading="patch,R,G,B,IR"), 1, "the heading has no wavelengths"),
    (csv_text(heading="patch,400,500,600"), 2, "number of cells"),
    (csv_text().replace(f"{VALUES[1, 2]:.6g}", "x"), 3, "'600'"),
    (csv_text(names=["white", "gray", "gray", *NAMES[3:]]), 4, "patch 'gray' is in line 3 too"),
    (csv_text(heading="patch,700,600,500,400"), None, ""),
    (csv_text(heading="patch,400nm,500nm,600,700"), 1, "mixed units"),
    ("# units: lx\n" + csv_text(), None, "units"),
    ("wavelength_nm,a\n400,1\n500,x\n", 3, "'a'"),
    ("wavelength_nm\n400\n500\n", 1, "the heading has no patches"),
]


@pytest.mark.parametrize(
    ("name", "text", "line", "about"),
    [("a.txt", *case) for case in INVALID_CGATS] + [("a.csv", *case) for case in INVALID_CSV],
)
def test_invalid_files(tmp_path: Path, name: str, text: str, line: int | None, about: str) -> None:
    error = error_of(written(tmp_path, text, name), **LIGHT)
    assert about in error.what
    assert line is None or error.line == line


@pytest.mark.parametrize(
    ("options", "needed"),
    [
        ({}, "illuminant"),
        ({"illuminant": "A"}, "mean_luminance_cd_m2"),
        ({"units": "relative"}, "mean_luminance_cd_m2"),
    ],
)
def test_required_options(tmp_path: Path, options: dict[str, object], needed: str) -> None:
    assert needed in error_of(written(tmp_path, csv_text(), "a.csv"), **options).arguments


def test_wavelengths_of_the_file_cannot_be_overridden(tmp_path: Path) -> None:
    error = error_of(written(tmp_path, csv_text(), "a.csv"), **LIGHT, wavelength_nm=GRID)
    assert error.what == "states its wavelengths"


def test_negative_values_and_unsorted_bands_on_request(tmp_path: Path) -> None:
    below = written(tmp_path, csv_text(np.where(np.equal(VALUES, VALUES[2, 1]), -0.001, VALUES)), "a.csv")
    with warns("1 negative values"):
        assert reflectances(read_scene(below, negative="zero", **LIGHT)).min() == pytest.approx(0, abs=1e-5)
    back = written(tmp_path, csv_text(VALUES[:, ::-1], heading="patch,700,600,500,400"), "b.csv")
    assert_allclose(reflectances(read_scene(back, sort_bands=True, **LIGHT)), VALUES, atol=2e-5)


def test_one_outlier_is_an_error_not_percent(tmp_path: Path) -> None:
    """Thirty fractions, one with a misplaced decimal point or worse."""
    values = np.tile(VALUES, (5, 1))
    names = [f"{name} {k}" for k in range(5) for name in NAMES]
    for slip in (7.5, 1e30):
        values[3, 2] = slip
        error = error_of(written(tmp_path, csv_text(values, names), "a.csv"), **LIGHT)
        assert (error.where, "outlier" in error.what) == ("patch 'red 0' at 600 nm", True)
    few = np.array(VALUES)
    few[3, 2] = 1e30
    error_of(written(tmp_path, csv_text(few), "a.csv"), **LIGHT)
    error_of(written(tmp_path, csv_text(VALUES * 0 + 12), "a.csv"), units="reflectance", **LIGHT)


def test_units_that_contradict_the_file_override_it_with_a_warning(tmp_path: Path) -> None:
    file = written(tmp_path, "# units: percent\n" + csv_text(VALUES), "a.csv")
    with warns("the file states the"):
        scene = read_scene(file, units="reflectance", **LIGHT)
    assert_allclose(reflectances(scene), VALUES, atol=2e-5)


def test_consecutively_numbered_patches_do_not_form_a_long_row(tmp_path: Path) -> None:
    values, names = np.tile(VALUES, (4, 1)), [f"P{k}" for k in range(24)]
    file = written(tmp_path, csv_text(values, names), "a.csv")
    with warns("the names of the", arguments={"patch_cols": 6}):
        scene = read_scene(file, **LIGHT)
    assert len({part.c0 for part in scene.regions}) == 6
    assert_allclose(reflectances(scene), values, atol=2e-5)
    row = read_scene(file, patch_cols=24, **LIGHT)
    assert len({part.c0 for part in row.regions}) == 24
    strip = written(tmp_path, csv_text(VALUES, [f"A{k}" for k in range(6)]), "b.csv")
    assert len({part.c0 for part in read_scene(strip, **LIGHT).regions}) == 6


@pytest.mark.parametrize("missing", ["nan", ""])
def test_missing_values_of_a_chart(tmp_path: Path, missing: str) -> None:
    text = csv_text(VALUES).replace(f"{VALUES[2, 1]:.6g}", missing, 1)
    file = written(tmp_path, text, "a.csv")
    error = error_of(file, **LIGHT)
    assert (error.where, error.arguments) == ("patch 'gray' at 500 nm", {"no_data": "zero"})
    with warns("1 missing values"):
        found = reflectances(read_scene(file, no_data="zero", **LIGHT))
    assert_allclose(found, np.where(np.equal(VALUES, VALUES[2, 1]), 0, VALUES), atol=2e-5)
    assert len(read_scene(file, band_range_nm=(550, 1000), **LIGHT).wavelength_nm) == 2  # without the gap


def test_bands_of_a_charts_range(tmp_path: Path) -> None:
    file = written(tmp_path, csv_text(VALUES, heading="patch,400,500,600,1000"), "a.csv")
    assert "band_range_nm" in str(error_of(file, **LIGHT))
    scene = read_scene(file, band_range_nm=(400, 700), **LIGHT)
    assert scene.wavelength_nm.tolist() == [400, 500, 600]
    assert_allclose(reflectances(scene), VALUES[:, :3], atol=2e-5)


def test_means_of_uneven_patches_are_written_with_a_warning(tmp_path: Path) -> None:
    chart = ps.charts.macbeth("A", 40, wavelength_nm=GRID)
    lit = ps.lights.mixed(chart, [("A", 100.0, ps.lights.gradient(1, 0))])
    with pytest.warns(PhotositeWarning) as caught:
        write_scene(lit, tmp_path / "a.csv")
    part = max(lit.regions, key=lambda part: part.c0 == 0 or -part.c0)
    spread = []
    for part in lit.regions:
        light = np.tensordot(lit.weights[:, part.r0 : part.r1, part.c0 : part.c1].astype(float), lit.basis, axes=(0, 0))
        mean = light.mean(axis=(0, 1))
        spread.append(np.sqrt(((light - mean) ** 2).sum(axis=-1).mean() / (mean**2).sum()))
    assert f"{max(spread):.1%}" in str(caught[0].message)
    write_scene(chart, tmp_path / "b.csv")
