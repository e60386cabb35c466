"""photosite's own scene file: mapped weights, atomic writing, and damaged files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import photosite as ps
from photosite.errors import FileError
from photosite.scene.io import hdf5
from photosite.scene.io.formats import read_scene
from photosite.scene.scene import Scene
from photosite.scene.weights import MappedWeights


@pytest.fixture
def chart(tmp_path: Path) -> Path:
    ps.charts.macbeth("A", 40).save(tmp_path / "chart.h5")
    return tmp_path / "chart.h5"


def test_weights_are_contiguous_and_mapped(chart: Path) -> None:
    scene = read_scene(chart)
    assert isinstance(scene.weights.base, MappedWeights)
    with h5py.File(chart) as file:
        offset = file["weights"].id.get_offset()
        assert file["weights"].dtype == np.dtype("<f4")
        assert file.attrs["units"] == b"photons/s/sr/m2/nm"
    raw = np.fromfile(chart, "<f4", scene.weights.size, offset=offset)
    assert np.array_equal(raw, scene.weights.ravel())


def test_a_mapped_scene_can_replace_its_own_file(chart: Path) -> None:
    scene = read_scene(chart)
    scene.scaled(2.0).save(chart)
    assert np.array_equal(read_scene(chart).weights, scene.weights)
    assert read_scene(chart).basis == pytest.approx(2 * scene.basis)


def test_weights_are_written_by_rows(chart: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = read_scene(chart)
    monkeypatch.setattr(hdf5, "_BLOCK_BYTES", 1)
    scene.save(chart.with_name("other.h5"))
    assert np.array_equal(read_scene(chart.with_name("other.h5")).weights, scene.weights)


def test_names_can_be_empty_or_of_any_letters(tmp_path: Path) -> None:
    for name in ("", "Ångström 測定"):
        scene = Scene.uniform([1e14, 1e14], [500, 600], name=name)
        scene.save(tmp_path / "a.h5")
        assert read_scene(tmp_path / "a.h5").name == name


def _attribute(name: str, value: Any) -> Callable[[Any], None]:
    return lambda file: file.attrs.__setitem__(name, value)


def _replaced(name: str, values: Any, **how: Any) -> Callable[[Any], None]:
    def change(file: Any) -> None:
        del file[name]
        file.create_dataset(name, data=values, **how)

    return change


WEIGHTS = np.ones((24, 4, 5), np.float32)


@pytest.mark.parametrize(
    ("change", "about"),
    [
        (_attribute("photosite_scene", 2), "version"),
        (_attribute("units", np.bytes_(b"W/sr/m2/nm")), "units"),
        (_attribute("distance_m", -1.0), "distance_m"),
        (_attribute("relative_error", np.nan), "relative_error"),
        (lambda file: file.__delitem__("basis"), "basis"),
        (_replaced("weights", WEIGHTS, chunks=(1, 4, 5)), "not contiguous"),
        (_replaced("weights", WEIGHTS.astype(np.float64)), "weights"),
        (_replaced("weights", WEIGHTS[:3]), "weights"),
        (_replaced("weights", WEIGHTS * np.nan), "weights are not finite"),
        (_replaced("wavelength_nm", np.arange(41.0)[::-1] + 400), "wavelength"),
        (_replaced("regions", np.array([[1, 2, 3]])), "regions"),
    ],
)
def test_invalid_files(chart: Path, change: Callable[[Any], None], about: str) -> None:
    with h5py.File(chart, "r+") as file:
        change(file)
    with pytest.raises(FileError) as caught:
        read_scene(chart)
    assert caught.value.path == str(chart)
    assert about in caught.value.what
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fraction", [0.2, 0.9, 0.999])
def test_a_truncated_file(chart: Path, fraction: float) -> None:
    content = chart.read_bytes()
    chart.write_bytes(content[: int(fraction * len(content))])
    with pytest.raises(FileError) as caught:
        read_scene(chart)
    assert caught.value.path == str(chart)
