"""TIFF stacks: pages, samples, compression, byte orders, and invalid files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.testing import assert_allclose
from scene_files import error_of, whole

from photosite.scene.io import tiff
from photosite.scene.io.formats import open_cube
from photosite.scene.scene import Scene

GRID = np.arange(400.0, 701, 50)
RNG = np.random.default_rng(6)
CUBE = RNG.integers(1, 1000, (33, 20, GRID.size)).astype(np.uint16)
DESCRIBED = {"wavelength_nm": GRID.tolist(), "units": "W/sr/m2/nm"}


def stack(path: Path, array: np.ndarray = CUBE, description: dict[str, Any] | str | None = None, **how: Any) -> Path:
    """A page a band; `how` may hold the file's byteorder."""
    text = (
        description if isinstance(description, str) else json.dumps(DESCRIBED if description is None else description)
    )
    byteorder = how.pop("byteorder", "<")
    with tifffile.TiffWriter(path, byteorder=byteorder) as file:
        for band in range(array.shape[2]):
            first = text if band == 0 else None
            file.write(array[:, :, band], photometric="minisblack", description=first, metadata=None, **how)
    return path


@pytest.mark.parametrize(
    ("dtype", "how"),
    [
        (np.uint8, {}),
        (np.float64, {}),
        (np.uint16, {"byteorder": ">"}),
        (np.float32, {"rowsperstrip": 4}),
        (np.uint16, {"compression": "zlib"}),
        (np.uint8, {"compression": "lzw"}),
        (np.uint8, {"compression": "packbits"}),
        (np.uint16, {"compression": "zlib", "predictor": True}),
        (np.float32, {"compression": "zlib", "predictor": True}),
        (np.float64, {"compression": "zstd"}),
        (np.float32, {"tile": (16, 16)}),
    ],
)
def test_a_page_a_band(tmp_path: Path, dtype: type, how: dict[str, Any]) -> None:
    path = stack(tmp_path / "a.tif", CUBE.astype(dtype), **how)
    assert_allclose(whole(path), CUBE.astype(dtype))
    in_place = open_cube(path).path == path
    assert in_place == ("compression" not in how and "tile" not in how)


@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize("compression", [None, "zlib", "lzw"])
def test_one_page_of_many_samples(tmp_path: Path, planar: str, compression: str | None) -> None:
    array = CUBE if planar == "contig" else CUBE.transpose(2, 0, 1)
    tifffile.imwrite(
        tmp_path / "a.tif",
        array,
        photometric="minisblack",
        planarconfig=planar,
        compression=compression,
        description=json.dumps(DESCRIBED),
        metadata=None,
    )
    assert_allclose(whole(tmp_path / "a.tif"), CUBE)


def test_descriptions_beside_the_file_or_by_page(tmp_path: Path) -> None:
    path = stack(tmp_path / "a.tif", description="a stack from a filter wheel")
    assert "wavelength" in error_of(path, units="photons").what
    (tmp_path / "a.json").write_text(json.dumps(DESCRIBED | {"distance_m": 2, "no_data": 5}), encoding="utf-8")
    assert open_cube(path).distance_m == 2.0
    assert np.isnan(whole(path)).sum() == (CUBE == 5).sum()
    with tifffile.TiffWriter(tmp_path / "b.tif") as file:
        for band, wavelength in enumerate(GRID):
            file.write(CUBE[:, :, band], description=f"filter at {wavelength:g} nm", metadata=None)
    assert open_cube(tmp_path / "b.tif", units="photons").wavelength_nm.tolist() == GRID.tolist()


def test_what_is_written_is_what_another_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiff, "_STRIP_BYTES", 4 * 20 * 5)
    scene = Scene.from_radiance(CUBE * 1e12, GRID, tolerance=1e-6)
    scene.save(tmp_path / "a.tif")
    found = tifffile.imread(tmp_path / "a.tif")
    assert found.dtype == np.float32
    assert_allclose(np.moveaxis(found, 0, 2), CUBE * 1e12, rtol=1e-4)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.pages[0].rowsperstrip == 5
        assert json.loads(file.pages[0].description)["units"] == "photons/s/sr/m2/nm"


@pytest.mark.parametrize(
    ("description", "about"),
    [
        ({"wavelength_nm": GRID.tolist()}, "units"),
        ({"units": "photons"}, "wavelength"),
        (DESCRIBED | {"wavelength_nm": (GRID / 1000).tolist()}, "wavelength"),
        (DESCRIBED | {"wavelength_nm": GRID[::-1].tolist()}, "wavelength"),
        (DESCRIBED | {"wavelength_nm": GRID[1:].tolist()}, "wavelength_nm"),
        (DESCRIBED | {"wavelength_nm": "visible"}, "wavelength_nm"),
        (DESCRIBED | {"units": "DN"}, "units"),
        (DESCRIBED | {"distance_m": "far"}, "distance_m"),
        (DESCRIBED | {"distance_m": -2}, "distance_m"),
        ('{"wavelength_nm": [400,', "not valid JSON"),
    ],
)
def test_invalid_descriptions(tmp_path: Path, description: dict[str, Any] | str, about: str) -> None:
    assert about in error_of(stack(tmp_path / "a.tif", description=description)).what


def test_invalid_pages(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "b.tif") as file:
        file.write(CUBE[:, :, 0])
        file.write(CUBE[:9, :, 1])
    assert (error_of(tmp_path / "b.tif").what, error_of(tmp_path / "b.tif").value) == ("page 2", "(9, 20) of uint16")
    tifffile.imwrite(tmp_path / "c.tif", CUBE.astype(np.complex64), photometric="minisblack", planarconfig="contig")
    assert error_of(tmp_path / "c.tif").value == "complex64"


@pytest.mark.parametrize("how", [{}, {"compression": "zlib"}, {"compression": "lzw"}])
@pytest.mark.parametrize("fraction", [0.001, 0.6, 0.98])
def test_truncated_files(tmp_path: Path, how: dict[str, Any], fraction: float) -> None:
    path = stack(tmp_path / "a.tif", **how)
    content = path.read_bytes()
    path.write_bytes(content[: int(fraction * len(content))])
    error_of(path)


def test_an_unrelated_file_beside_does_not_hide_the_description(tmp_path: Path) -> None:
    path = stack(tmp_path / "x.tif")
    (tmp_path / "x.json").write_text('{"camera": "somebody\'s"}', encoding="utf-8")
    assert_allclose(whole(path), CUBE)
    (tmp_path / "x.json").write_text('{"units": "mW/sr/m2/nm"}', encoding="utf-8")
    assert_allclose(whole(path), CUBE * 1e-3)
    bare = stack(tmp_path / "y.tif", description=json.dumps({"wavelength_nm": GRID.tolist()}))
    (tmp_path / "y.json").write_text("{}", encoding="utf-8")
    assert "y.json" in error_of(bare).what
