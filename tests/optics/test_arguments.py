"""Arguments of a wrong type or unit are rejected with one line that names the argument."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.field_points import FieldPoints
from photosite.optics.illumination import IlluminationTable, VeilingGlare
from photosite.optics.lens_design import LensDesign

BASE = DiffractionLimited(2.8, 50)
HEIGHTS = FieldPoints(height_mm=[0, 7, 14])  # type: ignore[arg-type]
SPOT = np.pad(np.ones((1, 1)), 1)
LENS: Any = ps.Lens
WAVEFRONT: Any = ps.optics.Wavefront
ANY: Any = DiffractionLimited


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: LENS(2.8), "base"),
        (lambda: LENS(ps.Lens(BASE)), "base"),
        (lambda: LENS(BASE, {8: 50}), "blur"),
        (lambda: LENS(BASE, ps.optics.Wavefront), "blur"),
        (lambda: LENS(BASE, focus_distance_m="2"), "focus_distance_m"),
        (lambda: LENS(BASE, illumination=[1, 0.5]), "illumination"),
        (lambda: LENS(BASE, distortion=-2.0), "distortion"),
        (lambda: LENS(BASE, lateral_color=1), "lateral_color"),
        (lambda: LENS(BASE, veiling_glare=0.02), "veiling_glare"),
        (lambda: LENS(BASE, name=50), "name"),
        (lambda: WAVEFRONT([0, 1]), "coefficients"),
        (lambda: WAVEFRONT({}, pupil=7), "pupil"),
        (lambda: WAVEFRONT({}, chromatic_focus={450: 3}), "chromatic_focus"),
        (lambda: WAVEFRONT({}, defocus_um="1"), "defocus_um"),
        (lambda: ANY("2.8", 50), "f_number"),
        (lambda: ANY(True, 50), "f_number"),
        (lambda: ANY(None, 50), "f_number"),
        (lambda: ANY(np.array(False), 50), "f_number"),
        (lambda: ps.optics.Pupil(blades=True), "blades"),
        (lambda: ANY(2.8, 50, "0.9"), "transmittance"),
        (lambda: ps.optics.Pupil(blades=6.5), "blades"),  # type: ignore[arg-type]
        (lambda: ps.optics.Pupil("0.3"), "obscuration"),  # type: ignore[arg-type]
        (lambda: VeilingGlare("2 %"), "fraction"),  # type: ignore[arg-type]
        (lambda: IlluminationTable([0, 7], [1, 1]), "field"),  # type: ignore[arg-type]
        (lambda: Distortion([0, 7], [1, 1]), "field"),  # type: ignore[arg-type]
        (lambda: LateralColor([500], [7], [[1]]), "field"),  # type: ignore[arg-type]
        (lambda: FieldPoints(height_mm="7"), "height_mm"),  # type: ignore[arg-type]
        (lambda: FieldPoints(angle_deg=[]), "angle_deg"),  # type: ignore[arg-type]
        (lambda: IlluminationTable(HEIGHTS, np.array([1, np.inf, 1])), "relative[1]"),
        (lambda: ANY(2.8, 50, np.ones(2)), "transmittance"),
        (lambda: FieldPoints(height_mm=[[0], [1, 2]]), "height_mm"),  # type: ignore[arg-type]
        (lambda: Distortion.from_percent(HEIGHTS, "2 %"), "percent"),
        (lambda: Distortion.polynomial("0.1"), "k1"),  # type: ignore[arg-type]
        (lambda: ps.optics.OtfTable([550], [0, 9], [["a", "b"]]), "values"),  # type: ignore[arg-type]
        (lambda: ps.optics.OtfTable([550], [0, 9], [[1, 0j]]), "values"),  # type: ignore[arg-type]
        (lambda: ps.optics.OtfTable([550], ["a", 9], [[1, 0]]), "frequency_per_mm"),  # type: ignore[arg-type]
        (lambda: ps.optics.PsfTable(["a"], [SPOT], 0.5), "wavelength_nm"),  # type: ignore[arg-type]
        (lambda: ps.optics.PsfTable([550], [SPOT * 1j], 0.5), "samples"),  # type: ignore[arg-type]
        (lambda: ps.optics.PsfTable([550], np.zeros((1, 0, 0)), 0.5), "samples"),  # type: ignore[arg-type]
        (lambda: ps.optics.PsfTable([550], [SPOT], "0.5"), "spacing_um"),  # type: ignore[arg-type]
        (lambda: LensDesign(np.array([550.0]), [[SPOT]], "0.5", [0], [0]), "spacing_um"),  # type: ignore[arg-type]
    ],
)
def test_wrong_types_are_rejected(make: Callable[[], object], what: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert caught.value.what.startswith(what)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_numpy_scalars_are_accepted() -> None:
    base = DiffractionLimited(np.float32(2.5), np.int64(50), np.array(0.5))  # type: ignore[arg-type]
    assert ps.Lens(base, focus_distance_m=np.float64(2)).magnification(2.0) == pytest.approx(0.05 / 1.95)
    assert ps.optics.Pupil(blades=np.int64(6)).area < 1  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: DiffractionLimited(2.8, 0.05), "focal_length_mm"),
        (lambda: DiffractionLimited(0.4, 50), "f_number"),
        (lambda: FieldPoints(height_mm=[0, 0.007, 0.014]), "height_mm"),  # type: ignore[arg-type]
        (
            lambda: LensDesign(
                np.array([550.0]), np.stack([SPOT] * 2)[:, None], 0.5, np.zeros(2), np.array([0.0, 0.011])
            ),
            "field_y, field_x",
        ),
    ],
)
def test_lengths_in_metres_are_rejected(make: Callable[[], object], what: str) -> None:
    with raises(InputError, what):
        make()


def test_the_smallest_lenses_are_accepted() -> None:
    assert DiffractionLimited(0.5, 0.2).f_number == 0.5
    assert FieldPoints(height_mm=np.array([0, 0.05])).size == 2


@pytest.mark.parametrize(
    "part",
    [
        {"distortion": Distortion.from_percent(FieldPoints(height_mm=np.array([0, 0.06])), [0, -1])},
        {"illumination": IlluminationTable(FieldPoints(height_mm=np.array([0, 0.06])), np.array([1, 0.9]))},
    ],
)
def test_frames_larger_than_a_table_give_a_warning(part: dict[str, Any]) -> None:
    camera = ps.Camera(ps.Lens(BASE, **part), ps.load_sensor("nikon-d200").with_(rows=22, cols=34))
    scene = ps.charts.slanted_edge("D65", 40, rows=40, cols=60)
    with pytest.warns(PhotositeWarning):
        camera.mean_electrons(scene, 0.01)


def test_objects_out_of_focus_are_rejected_with_the_depth_of_focus() -> None:
    x = np.arange(-12, 13) * 0.5
    psf = np.exp(-(x[:, None] ** 2 + x**2) / 2)[None, None]
    far = ps.Lens(BASE, LensDesign(np.array([550.0]), psf, 0.5, np.zeros(1), np.zeros(1)), np.inf)
    with raises(InputError, "distance_m"):
        far.point_spread(1.2)  # (50 mm / 2.8)^2 / 8 / 550 nm / 0.25 = 289.9 m
    far.point_spread(290.0)
