"""The option that chooses how the colors of a picture become spectra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image
from raising import raises

from photosite.errors import FileError, InputError
from photosite.scene.charts import macbeth, ramp
from photosite.scene.io.formats import convert_scene, read_scene, write_scene
from photosite.scene.pictures import from_rgb
from photosite.scene.scene import Scene
from photosite.scene.scene_request import SceneRequest

CODES = np.random.default_rng(6).integers(30, 220, (5, 7, 3)).astype(np.uint8)
SMOOTH: dict[str, Any] = {"method": "jakob-hanika", "mean_luminance_cd_m2": 40.0}


def picture(folder: Path, name: str = "a.png") -> Path:
    if name.endswith("tif"):
        tifffile.imwrite(folder / name, CODES, photometric="rgb")
    else:
        Image.fromarray(CODES).save(folder / name)
    return folder / name


def assert_same(one: Scene, other: Scene) -> None:
    np.testing.assert_array_equal(one.weights, other.weights)
    np.testing.assert_allclose(one.basis, other.basis, rtol=1e-12)
    assert one.relative_error == other.relative_error


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_a_picture_uses_the_method(tmp_path: Path, name: str) -> None:
    file = picture(tmp_path, name)
    assert_same(read_scene(file, **SMOOTH), from_rgb(CODES, method="jakob-hanika"))
    plain = read_scene(file, method="mallett-yuksel", mean_luminance_cd_m2=40.0)
    assert_same(plain, from_rgb(CODES))
    assert len(plain.basis) == 3


def test_the_tolerance_applies_to_smooth_spectra(tmp_path: Path) -> None:
    fine, coarse = (read_scene(picture(tmp_path), tolerance=fraction, **SMOOTH) for fraction in (1e-4, 1e-2))
    assert len(fine.basis) > len(coarse.basis)
    assert fine.relative_error < 1e-4 < coarse.relative_error < 1e-2


def test_requests_and_conversions_pass_the_method_on(tmp_path: Path) -> None:
    file = picture(tmp_path)
    wanted = read_scene(file, **SMOOTH)
    asked = SceneRequest(str(file), {"method": "jakob-hanika", "mean_luminance_cd_m2": 40.0})
    assert_same(asked.scene(), wanted)
    coarse = convert_scene(file, tmp_path / "a.h5", tolerance=0.01, **SMOOTH)
    assert coarse.components < len(wanted.basis)
    assert len(read_scene(tmp_path / "a.h5").basis) == coarse.components
    with pytest.raises(FileError):
        convert_scene(file, tmp_path / "a.h5", tolerance=0.01, mean_luminance_cd_m2=40.0)


@pytest.mark.parametrize("name", ["a.h5", "a.hdr", "a.csv", "a.exr"])
def test_other_files_have_no_method(tmp_path: Path, name: str) -> None:
    write_scene(ramp() if name != "a.csv" else macbeth(), tmp_path / name)
    with pytest.raises(FileError) as caught:
        read_scene(tmp_path / name, **SMOOTH)
    assert caught.value.arguments == {"method": "jakob-hanika"}


def test_unknown_methods_and_built_in_scenes(tmp_path: Path) -> None:
    with raises(InputError, "method", value="jakob"):
        read_scene(picture(tmp_path), method="jakob")
    with raises(InputError, "the chart"):
        SceneRequest("ramp", {"method": "jakob-hanika"}).scene()
