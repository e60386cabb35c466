"""What is handed to lenses: of the wrong kind or in another unit it is refused in one line that names the argument."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import photosite as ps
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.illumination import IlluminationTable
from photosite.optics.lens import DiffractionLimited
from photosite.optics.lens_design import LensDesign
from photosite.optics.radial_table import FieldPoints
from photosite.optics.spread import VeilingGlare

BASE = DiffractionLimited(2.8, 50)
HEIGHTS = FieldPoints(height_mm=[0, 7, 14])  # type: ignore[arg-type]
SPOT = np.pad(np.ones((1, 1)), 1)
LENS: Any = ps.Lens
WAVEFRONT: Any = ps.Wavefront
ANY: Any = DiffractionLimited


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LENS(2.8), r"Lens: base is a DiffractionLimited, as DiffractionLimited\(2\.8, 50\), not 2\.8"),
        (lambda: LENS(ps.Lens(BASE)), r"Lens: base is a DiffractionLimited, .*, not Lens\("),
        (lambda: LENS(BASE, {8: 50}), r"Lens: blur is a Wavefront, .*, not \{8: 50\}"),
        (lambda: LENS(BASE, ps.Wavefront), "Lens: blur is a Wavefront, .*, not the class Wavefront"),
        (lambda: LENS(BASE, focus_distance_m="2"), "Lens: focus_distance_m is a number, not '2'"),
        (lambda: LENS(BASE, illumination=[1, 0.5]), "Lens: illumination is an IlluminationTable, not"),
        (lambda: LENS(BASE, distortion=-2.0), r"Lens: distortion is a Distortion, .*, not -2\.0"),
        (lambda: LENS(BASE, lateral_color=1), "Lens: lateral_color is a LateralColor, not 1"),
        (lambda: LENS(BASE, veiling_glare=0.02), r"Lens: veiling_glare is a VeilingGlare, as .*, not 0\.02"),
        (lambda: LENS(BASE, name=50), "Lens: name is a text, not 50"),
        (lambda: WAVEFRONT([0, 1]), r"Wavefront: coefficients is values by term, as \{8: 50\.0\}, not \[0, 1\]"),
        (lambda: WAVEFRONT({}, pupil=7), "Wavefront: pupil is a Pupil, .*, not 7"),
        (lambda: WAVEFRONT({}, chromatic_focus={450: 3}), "Wavefront: chromatic_focus is a Spectrum of shifts in um"),
        (lambda: WAVEFRONT({}, defocus_um="1"), "Wavefront: defocus_um is a number, not '1'"),
        (lambda: ANY("2.8", 50), "DiffractionLimited: f_number is a number, not '2.8'"),
        (lambda: ANY(True, 50), "DiffractionLimited: f_number is a number, not True"),
        (lambda: ANY(None, 50), "DiffractionLimited: f_number is a number, not None"),
        (lambda: ANY(np.array(False), 50), "DiffractionLimited: f_number is a number, not False"),
        (lambda: ps.Pupil(blades=True), "Pupil: blades is a whole number, not True"),
        (lambda: ANY(2.8, 50, "0.9"), "DiffractionLimited: transmittance is a number or a Spectrum, not '0.9'"),
        (lambda: ps.Pupil(blades=6.5), r"Pupil: blades is a whole number, not 6\.5"),  # type: ignore[arg-type]
        (lambda: ps.Pupil("0.3"), "Pupil: obscuration is a number, not '0.3'"),  # type: ignore[arg-type]
        (lambda: VeilingGlare("2 %"), "VeilingGlare: fraction is a number, not '2 %'"),  # type: ignore[arg-type]
        (lambda: IlluminationTable([0, 7], [1, 1]), "IlluminationTable: field is FieldPoints"),  # type: ignore[arg-type]
        (lambda: Distortion([0, 7], [1, 1]), "Distortion: field is FieldPoints"),  # type: ignore[arg-type]
        (lambda: LateralColor([500], [7], [[1]]), "LateralColor: field is FieldPoints"),  # type: ignore[arg-type]
        (lambda: FieldPoints(height_mm="7"), "height_mm is a list of numbers, not '7'"),  # type: ignore[arg-type]
        (lambda: FieldPoints(angle_deg=[]), "angle_deg is empty"),  # type: ignore[arg-type]
        (lambda: IlluminationTable(HEIGHTS, np.array([1, np.inf, 1])), "finite numbers; number 2 is inf"),
        (lambda: ANY(2.8, 50, np.ones(2)), "DiffractionLimited: transmittance is a number or a Spectrum, not array"),
        (lambda: FieldPoints(height_mm=[[0], [1, 2]]), "height_mm is a list of numbers, not"),  # type: ignore[arg-type]
        (lambda: Distortion.from_percent(HEIGHTS, "2 %"), "percent is a list of numbers, not '2 %'"),
        (lambda: Distortion.polynomial("0.1"), "Distortion.polynomial: k1 is a number, not '0.1'"),  # type: ignore[arg-type]
        (lambda: ps.OtfTable([550], [0, 9], [["a", "b"]]), "values is a list of numbers, not"),  # type: ignore[arg-type]
        (lambda: ps.OtfTable([550], [0, 9], [[1, 0j]]), "values of a radial table are real"),  # type: ignore[arg-type]
        (lambda: ps.OtfTable([550], ["a", 9], [[1, 0]]), "frequency_per_mm is a list of numbers, not"),  # type: ignore[arg-type]
        (lambda: ps.PsfTable(["a"], [SPOT], 0.5), "wavelengths are a list of positive numbers in nm, not"),  # type: ignore[arg-type]
        (lambda: ps.PsfTable([550], [SPOT * 1j], 0.5), "samples is a list of numbers, not"),  # type: ignore[arg-type]
        (lambda: ps.PsfTable([550], np.zeros((1, 0, 0)), 0.5), "a point spread has samples; these are none"),  # type: ignore[arg-type]
        (lambda: ps.PsfTable([550], [SPOT], "0.5"), "PsfTable: spacing_um is a number, not '0.5'"),  # type: ignore[arg-type]
        (lambda: LensDesign(np.array([550.0]), [[SPOT]], "0.5", [0], [0]), "LensDesign: spacing_um is a number"),  # type: ignore[arg-type]
    ],
)
def test_other_kinds_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_numpys_numbers_are_numbers() -> None:
    base = DiffractionLimited(np.float32(2.5), np.int64(50), np.array(0.5))  # type: ignore[arg-type]
    assert ps.Lens(base, focus_distance_m=np.float64(2)).magnification(2.0) == pytest.approx(0.05 / 1.95)
    assert ps.Pupil(blades=np.int64(6)).area < 1  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DiffractionLimited(2.8, 0.05), "focal_length_mm is 0.2 or more, not 0.05: if that is in m, multiply"),
        (lambda: DiffractionLimited(0.4, 50), "f_number is 0.5 or more in air, not 0.4"),
        (lambda: FieldPoints(height_mm=[0, 0.007, 0.014]), "ends at 0.014 mm from the axis, .* in m, multiply by 1000"),  # type: ignore[arg-type]
        (
            lambda: LensDesign(
                np.array([550.0]), np.stack([SPOT] * 2)[:, None], 0.5, np.zeros(2), np.array([0.0, 0.011])
            ),
            "the field ends at 0.011 mm from the axis, .* in m",
        ),
    ],
)
def test_lengths_in_metres_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_the_smallest_lenses_are_lenses() -> None:
    assert DiffractionLimited(0.5, 0.2).f_number == 0.5
    assert FieldPoints(height_mm=np.array([0, 0.05])).size == 2


@pytest.mark.parametrize(
    "part",
    [
        {"distortion": Distortion.from_percent(FieldPoints(height_mm=np.array([0, 0.06])), [0, -1])},
        {"illumination": IlluminationTable(FieldPoints(height_mm=np.array([0, 0.06])), np.array([1, 0.9]))},
    ],
)
def test_warnings_are_of_the_line_that_asked(part: dict[str, Any]) -> None:
    camera = ps.Camera(ps.Lens(BASE, **part), ps.load_sensor("nikon-d200").with_(rows=22, cols=34))
    scene = ps.charts.slanted_edge("D65", 40, rows=40, cols=60)
    with pytest.warns(PhotositeWarning, match="known up to") as caught:
        camera.mean_electrons(scene, 0.01)
    assert {each.filename for each in caught if "known up to" in str(each.message)} == {__file__}


def test_depth_of_focus_is_said_with_the_refusal() -> None:
    x = np.arange(-12, 13) * 0.5
    psf = np.exp(-(x[:, None] ** 2 + x**2) / 2)[None, None]
    far = ps.Lens(BASE, LensDesign(np.array([550.0]), psf, 0.5, np.zeros(1), np.zeros(1)), np.inf)
    with pytest.raises(InputError, match=r"focus, here from 289\.9 m on, and this object at 1\.2 m is 60 waves out"):
        far.spread(1.2)  # (50 mm / 2.8)^2 / 8 / 550 nm / 0.25 = 289.9 m
    far.spread(290.0)


@pytest.mark.parametrize(
    "name", ["Distortion", "FieldPoints", "IlluminationTable", "LateralColor", "VeilingGlare", "read_lens_design"]
)
def test_the_parts_of_a_lens_are_on_the_public_face(name: str) -> None:
    assert getattr(ps, name).__name__ == name
    assert name in dir(ps)
