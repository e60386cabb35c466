"""ENVI files: compared with the `spectral` library's own reading, and invalid files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from raising import raises, warns
from scene_files import whole

from photosite.color.spectrum import photons_from_energy
from photosite.errors import FileError, InputError
from photosite.scene.io.formats import convert_scene, open_cube, read_scene

envi = pytest.importorskip("spectral.io.envi")

GRID = np.array([450.0, 500, 550, 600, 650])
RNG = np.random.default_rng(4)
PLAIN = {"wavelength": GRID.tolist(), "wavelength units": "Nanometers", "data units": "W/sr/m2/nm"}


def saved(folder: Path, array: np.ndarray, metadata: dict[str, object] | None = None, **how: object) -> Path:
    """Return a file written by the library."""
    path = folder / "cube.hdr"
    given = {"interleave": "bsq", "ext": "img", "force": True} | how
    envi.save_image(str(path), array, metadata=PLAIN if metadata is None else metadata, **given)
    return path


def error_of(path: Path, **options: object) -> FileError:
    with pytest.raises(FileError) as caught:
        read_scene(path, **options)
    assert "\n" not in str(caught.value)
    return caught.value


@pytest.mark.parametrize(
    ("interleave", "dtype", "byteorder"),
    [
        *[("bsq", np.uint8, 0), ("bsq", np.uint16, 1), ("bsq", np.float32, 0)],
        *[("bil", np.int16, 0), ("bil", np.float64, 1), ("bip", np.uint16, 0), ("bip", np.int32, 1)],
    ],
)
def test_as_the_library_reads_it(tmp_path: Path, interleave: str, dtype: type, byteorder: int) -> None:
    array = RNG.integers(0, 200, (8, 6, 5)).astype(dtype)
    path = saved(tmp_path, array, interleave=interleave, byteorder=byteorder)
    theirs = np.asarray(envi.open(str(path)).load())
    assert_allclose(whole(path), theirs)
    assert_allclose(whole(path), array)
    assert_allclose(whole(path.with_suffix(".img")), array)  # by the name of the data


def test_reflectance_scale_factor_and_missing_values(tmp_path: Path) -> None:
    array = RNG.integers(1, 10_000, (4, 6, 5)).astype(np.int16)
    array[1, 2, 3] = -9999
    head = {"wavelength": (GRID / 1000).tolist(), "wavelength units": "Micrometers"}
    path = saved(tmp_path, array, head | {"reflectance scale factor": 10_000, "data ignore value": -9999})
    cube = open_cube(path)
    assert cube.quantity == "reflectance"
    assert_allclose(cube.wavelength_nm, GRID)
    found = whole(path)
    assert np.isnan(found[1, 2, 3])
    assert np.isnan(found).sum() == 1
    assert_allclose(found[0], array[0] / 10_000)
    options = {"illuminant": "D65", "mean_luminance_cd_m2": 100}
    error_of(path, **options)
    with warns("1 missing"):
        assert read_scene(path, no_data="zero", **options).mean_luminance_cd_m2() == pytest.approx(100)


def test_gains_by_band_and_an_offset(tmp_path: Path) -> None:
    array = RNG.integers(1, 100, (4, 6, 5)).astype(np.uint16)
    path = saved(tmp_path, array, PLAIN | {"data gain values": [1, 2, 3, 4, 5]})
    assert_allclose(whole(path), array * np.arange(1.0, 6))
    text = path.read_text(encoding="ascii")
    path.write_text(re.sub(r"header offset *= *0", "header offset = 10", text), encoding="ascii")
    path.with_suffix(".img").write_bytes(b"0123456789" + array.transpose(2, 0, 1).tobytes())
    assert_allclose(whole(path), array * np.arange(1.0, 6))


def test_bad_bands_are_skipped_with_a_warning(tmp_path: Path) -> None:
    path = saved(tmp_path, np.ones((2, 2, 5), np.float32), PLAIN | {"bbl": [1, 1, 0, 1, 1]})
    with warns("1 of 5 bands"):
        read_scene(path)


def test_photons_are_made_of_watts(tmp_path: Path) -> None:
    path = saved(tmp_path, np.full((2, 2, 5), 1e-2, np.float32), PLAIN | {"data units": "uW/cm2/nm/sr"})
    scene = read_scene(path)
    photons = 1e-4 * GRID * 1e-9 / (6.62607015e-34 * 299_792_458.0)
    assert_allclose(scene.radiance(1, 1), photons, rtol=1e-6)


@pytest.mark.parametrize(
    ("pattern", "replacement", "about"),
    [
        (r"wavelength units *=.*\n", "", None),
        (r"wavelength units *=.*", "wavelength units = Micrometers", "wavelength"),
        (r"wavelength units *=.*", "wavelength units = cubits", "wavelength"),
        (r"data units *=.*\n", "", "units"),
        (r"data units *=.*", "data units = DN", "units"),
        (r"lines *=.*", "lines = 5", "size"),
        (r"samples *=.*", "samples = 2", "size"),
        (r"samples *=.*", "samples = -2", "samples"),
        (r"bands *=.*\n", "", "bands"),
        (r"bands *=.*", "bands = many", "cannot be read"),
        (r"data type *=.*", "data type = 6", "data type"),
        (r"data type *=.*", "data type = 77", "'77' is missing or unknown"),
        (r"interleave *=.*", "interleave = bob", "interleave"),
        (r"450.0 ,", "505.0 ,", "wavelength"),
        (r"450.0 ,", "", "wavelength"),
        (r"450.0 ,", "red ,", "wavelength"),
        (r"ENVI\n", "ENVY\n", "ENVI header"),
        (r"wavelength units *=", "file compression = 1\nwavelength units =", "compressed"),
        (r"wavelength units *=", "data ignore value = x\nwavelength units =", "data ignore value"),
        (r"wavelength units *=", "reflectance scale factor = 0\nwavelength units =", "reflectance scale factor"),
    ],
)
def test_invalid_headers(tmp_path: Path, pattern: str, replacement: str, about: str | None) -> None:
    head = PLAIN | {"wavelength": GRID[:4].tolist()}
    path = saved(tmp_path, RNG.integers(1, 9, (4, 3, 4)).astype(np.int16), head)
    text, changed = re.subn(pattern, replacement, path.read_text(encoding="ascii"), count=1)
    assert changed, text
    path.write_text(text, encoding="ascii")
    if about is None:
        assert read_scene(path).wavelength_nm.tolist() == GRID[:4].tolist()
        return
    assert about in error_of(path).what


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.float32, np.float64])
@pytest.mark.parametrize("order", [0, 1])
def test_a_missing_byte_order_is_seen_in_the_data(tmp_path: Path, dtype: type, order: int) -> None:
    """A smooth picture with shot noise is read in the order in which neighbors are alike, with a warning."""
    smooth = 900 + 600 * np.sin(np.arange(40) / 9)[:, None, None] * np.cos(np.arange(30) / 7)[:, None]
    array = RNG.poisson(np.broadcast_to(smooth, (40, 30, 5))).astype(dtype)
    path = saved(tmp_path, array, byteorder=order)
    path.write_text(re.sub(r"byte order.*\n", "", path.read_text()))
    with warns("the header states no byte order", hint=f"Add the line 'byte order = {order}' to state it"):
        found = whole(path)
    assert_allclose(found, array)


def test_a_missing_byte_order_that_the_data_do_not_show(tmp_path: Path) -> None:
    path = saved(tmp_path, RNG.integers(0, 65536, (8, 6, 5)).astype(np.uint16))
    path.write_text(re.sub(r"byte order.*\n", "", path.read_text()))
    assert error_of(path).what == "states no byte order, and the data do not show it"
    path = saved(tmp_path, RNG.integers(0, 256, (8, 6, 5)).astype(np.uint8))
    path.write_text(re.sub(r"byte order.*\n", "", path.read_text()))
    assert whole(path).shape == (8, 6, 5)


@pytest.mark.parametrize(
    ("names", "wanted"),
    [
        (["450 nm", "500 nm", "550 nm", "600 nm", "650 nm"], True),
        ([f"Band {k} ({nm / 1000} um)" for k, nm in enumerate(GRID)], True),
        (["450", "500", "550", "600", "650"], False),
        (["450 nm", "500 nm", "550 nm", "600 nm", "far red"], False),
    ],
)
def test_wavelengths_in_the_names_of_bands(tmp_path: Path, names: list[str], wanted: bool) -> None:
    path = saved(tmp_path, np.ones((4, 3, 5), np.float32), {"band names": names, "data units": "W/sr/m2/nm"})
    if not wanted:
        assert "has no wavelengths" in error_of(path).what
        return
    assert_allclose(read_scene(path).wavelength_nm, GRID, rtol=1e-14)


def test_a_missing_header_or_data_file(tmp_path: Path) -> None:
    path = saved(tmp_path, np.ones((4, 3, 5), np.float32))
    path.rename(tmp_path / "other.hdr")
    assert error_of(tmp_path / "cube.img").what == "has no header cube.hdr beside it"
    assert "has no data beside it" in error_of(tmp_path / "other.hdr").what


def test_data_of_an_interrupted_overwrite_are_an_error(tmp_path: Path) -> None:
    """New data of the same size with the old header, as when a program ends between the two renames."""
    path = saved(tmp_path, RNG.random((8, 6, 5)).astype(np.float32))
    for factor in (1, 2):
        (tmp_path / str(factor)).mkdir()
        convert_scene(path, tmp_path / str(factor) / "made.hdr", distance_m=factor, mean_luminance_cd_m2=40 * factor)
    first, second = (tmp_path / str(factor) / "made.hdr" for factor in (1, 2))
    assert read_scene(first).distance_m == 1
    first.with_suffix(".img").write_bytes(second.with_suffix(".img").read_bytes())
    assert error_of(first).path == str(first.with_suffix(".img"))


def test_data_that_shrink_while_they_are_read(tmp_path: Path) -> None:
    path = saved(tmp_path, np.ones((40, 30, 5), np.float32))
    cube = open_cube(path)
    with path.with_suffix(".img").open("r+b") as file:
        file.truncate(1000)
    with pytest.raises(FileError):
        list(cube.blocks(10))


def test_bands_of_a_range(tmp_path: Path) -> None:
    array = RNG.uniform(0.1, 0.9, (4, 6, 5)).astype(np.float32)
    head = {"wavelength": [400, 600, 780, 900, 1000], "wavelength units": "nm", "data units": "reflectance"}
    path = saved(tmp_path, array, head)
    with raises(
        FileError,
        "wavelength_nm",
        value=(400.0, 1000.0),
        arguments={"band_range_nm": (300, 830)},
        where="illuminant D65",
    ) as caught:
        read_scene(path, illuminant="D65", mean_luminance_cd_m2=100)
    assert "band_range_nm=(300, 830)" in str(caught.value)
    options = {"illuminant": "D65", "mean_luminance_cd_m2": 100, "band_range_nm": (400, 780), "tolerance": 1e-6}
    scene = read_scene(path, **options)
    assert scene.wavelength_nm.tolist() == [400, 600, 780]
    assert scene.reflectance is not None
    found = np.tensordot(scene.weights, scene.reflectance, axes=(0, 0))
    assert_allclose(found, array[:, :, :3], rtol=1e-5)
    assert read_scene(path, illuminant="A", mean_luminance_cd_m2=100).wavelength_nm[-1] == 1000
    done = convert_scene(path, tmp_path / "out.h5", **options)
    assert (done.bands, done.scene.wavelength_nm.size) == (3, 3)
    error_of(path, **options | {"band_range_nm": (410, 420)})
    for bad in ([400], (780, 400), "400:780", (0, 780)):
        with raises(InputError, "band_range_nm"):
            read_scene(path, band_range_nm=bad)


@pytest.mark.parametrize("name", ["cube.hdr", "cube.img"])
def test_the_input_is_not_overwritten_when_bands_are_selected(tmp_path: Path, name: str) -> None:
    path = saved(tmp_path, np.ones((2, 2, 5), np.float32))
    with pytest.raises(FileError):
        convert_scene(tmp_path / name, path, band_range_nm=(450, 500))


def test_bad_bands_hold_no_values(tmp_path: Path) -> None:
    """Values and wavelengths of bad bands are ignored: missing values, a second 500 nm."""
    array = np.ones((2, 2, 5), np.float32) * np.arange(1, 6, dtype=np.float32)
    array[..., 2] = np.nan
    path = saved(tmp_path, array, PLAIN | {"bbl": [1, 1, 0, 1, 1], "wavelength": [450, 500, 500, 600, 650]})
    with warns("1 of 5 bands"):
        scene = read_scene(path)
    assert scene.wavelength_nm.tolist() == [450, 500, 600, 650]
    energy = scene.radiance(0, 0) / photons_from_energy(1.0, scene.wavelength_nm)
    assert_allclose(energy, [1, 2, 4, 5], rtol=1e-4)
    none = saved(tmp_path, array, PLAIN | {"bbl": [0] * 5})
    assert "marks all its bands as bad" in error_of(none).what


@pytest.mark.parametrize(
    ("units", "scale"), [("percent", 0.01), ("reflectance", 1.0), ("reflectance/20000", 1 / 20_000)]
)
def test_a_scale_factor_overridden_by_units(tmp_path: Path, units: str, scale: float) -> None:
    array = RNG.integers(1, 2, (4, 6, 5)).astype(np.int16)
    path = saved(tmp_path, array, {"wavelength": GRID.tolist(), "reflectance scale factor": 10_000})
    with warns("the file states the units 'reflectance scale factor = 10000'"):
        assert_allclose(whole(path, units=units), array * scale)
    assert_allclose(whole(path), array / 10_000)
    assert_allclose(whole(path, units="reflectance/10000"), array / 10_000)  # no contradiction, no warning


def test_reflectances_on_another_scale_are_an_error(tmp_path: Path) -> None:
    array = RNG.integers(0, 10_000, (8, 8, 5)).astype(np.uint16)
    array[0, 0] = 9999
    path = saved(tmp_path, array, {"wavelength": GRID.tolist()})
    options = {"illuminant": "D65", "mean_luminance_cd_m2": 100}
    assert "9999" in str(error_of(path, units="reflectance", **options))
    scene = read_scene(path, units="reflectance/10000", **options)
    assert scene.reflectance is not None
    assert_allclose(scene.weights[:, 0, 0] @ scene.reflectance, 0.9999, atol=2e-3)
    sparks = np.full((20, 20, 5), 0.5, np.float32)
    sparks[0, 0] = 3.0  # one sample of 400: a spark
    path = saved(tmp_path, sparks, {"wavelength": GRID.tolist(), "data units": "reflectance"})
    assert read_scene(path, **options).shape == (20, 20)
    sparks[:2] = 12.0
    path = saved(tmp_path, sparks, {"wavelength": GRID.tolist(), "data units": "reflectance"})
    with warns("holds reflectances up to"):
        read_scene(path, **options)
    sparks[0, 0] = 2e3
    path = saved(tmp_path, sparks, {"wavelength": GRID.tolist(), "data units": "reflectance"})
    assert "2000" in str(error_of(path, **options))
    sparks[:6] = 3.0
    path = saved(tmp_path, sparks, {"wavelength": GRID.tolist(), "data units": "reflectance"})
    assert "reflectances up to 3" in str(error_of(path, **options))


def test_data_without_a_suffix(tmp_path: Path) -> None:
    path = saved(tmp_path, np.ones((2, 3, 5), np.float32))
    (tmp_path / "cube.img").rename(tmp_path / "cube")
    assert read_scene(tmp_path / "cube").shape == read_scene(path).shape == (2, 3)
