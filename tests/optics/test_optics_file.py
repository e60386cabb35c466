"""Optics files: every field arrives in the lens, and errors name the line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from raising import raises

from photosite.camera.file import load_camera
from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.io.formats import load_optics
from photosite.optics.lens import Lens
from photosite.optics.wavefront import Wavefront

WHOLE = """photosite_optics: 1
name: made up 50 mm
f_number: 2.8
focal_length_mm: 50
transmittance: {wavelength_nm: [400, 700], transmittance: [0.9, 0.8]}
falloff: none
focus_distance_m: 2
blur:
  kind: wavefront
  zernike: {8: 50, 11: -20.5}
  unit: nm
  pupil: {blades: 6, rotation_deg: 15}
  chromatic_focus: {wavelength_nm: [450, 650], shift_um: [-10, 12]}
relative_illumination: {field_deg: [0, 10, 20], relative: [1, 0.9, 0.7]}
distortion: {height_mm: [0, 7, 14], percent: [0, -0.5, -2]}
lateral_color:
  wavelength_nm: [450, 550, 650]
  height_mm: [0, 14]
  shift_um: [[0, 3], [0, 0], [0, -2]]
veiling_glare: {fraction: 0.02, spread_mm: 3}
provenance: {source: nowhere, license: CC0}
"""


def load(folder: Path, text: str) -> Lens:
    file = folder / "mine.optics.yaml"
    file.write_text(text, encoding="utf-8")
    return load_optics(file)


def test_all_fields_arrive_in_the_lens(tmp_path: Path) -> None:
    lens = load(tmp_path, WHOLE)
    assert isinstance(lens, Lens)
    assert (lens.name, lens.base.f_number, lens.base.focal_length_mm) == ("made up 50 mm", 2.8, 50)
    assert isinstance(lens.base.transmittance, Spectrum)
    assert lens.base.transmittance.at(550.0) == pytest.approx(0.85)
    assert lens.focus_distance_m == 2
    assert isinstance(lens.blur, Wavefront)
    assert dict(lens.blur.coefficients) == {8: 50, 11: -20.5}
    assert lens.blur.pupil.blades == 6
    assert lens.blur.chromatic_focus is not None
    assert lens.illumination is not None
    np.testing.assert_array_equal(lens.illumination.relative, [1, 0.9, 0.7])
    assert lens.distortion is not None
    np.testing.assert_allclose(lens.distortion.ratio, [1, 0.995, 0.98])
    assert lens.lateral_color is not None
    np.testing.assert_array_equal(lens.lateral_color.shift_um[:, 1], [3, 0, -2])
    assert lens.veiling_glare is not None
    assert (lens.veiling_glare.fraction, lens.veiling_glare.spread_m) == (0.02, 3e-3)
    mapping = lens.mapping(2.0)
    assert mapping is not None
    assert mapping.real_m.shape[0] == 3


BARE = "photosite_optics: 1\nf_number: 2.8\nfocal_length_mm: 50\n"


def test_a_diffraction_limited_lens(tmp_path: Path) -> None:
    lens = load(
        tmp_path, BARE + "transmittance: 0.9\nfalloff: cos4\nblur: {kind: diffraction}\nprovenance: {source: me}\n"
    )
    assert lens.base == DiffractionLimited(2.8, 50, 0.9, "cos4")
    assert (lens.blur, lens.focus_distance_m, lens.name) == (None, None, None)


@pytest.mark.parametrize(
    ("more", "check"),
    [
        ("focus_distance_m: .inf", lambda lens: lens.focus_distance_m == math.inf),
        ("blur: {kind: wavefront, index: nm, zernike: {'3,-1': 40}}", lambda lens: (3, -1) in lens.blur.coefficients),
        (
            "blur: {kind: wavefront, unit: waves, reference_nm: 633, zernike: {4: 0.1}}",
            lambda lens: lens.blur.unit == "waves",
        ),
        (
            "distortion: {k1: -0.1, max_field_deg: 30}",
            lambda lens: lens.distortion.ratio[-1] == pytest.approx(0.966667),
        ),
        ("distortion: {field_deg: [0, 20], real_height_mm: [0, 18]}", lambda lens: lens.distortion.ratio[1] < 0.99),
        (
            "lateral_color: {wavelength_nm: [450, 650], magnification: [1.0002, 1]}",
            lambda lens: lens.lateral_color.shift_um[0, 0] == pytest.approx(0.2),
        ),
        ("veiling_glare: {fraction: 0.01}", lambda lens: lens.veiling_glare.spread_m is None),
    ],
)
def test_alternative_forms(more: str, check: object, tmp_path: Path) -> None:
    lens = load(tmp_path, BARE + more + "\n")
    assert isinstance(lens, Lens)
    assert check(lens)  # type: ignore[operator]


def test_tables_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "mtf.csv").write_text(
        "frequency_per_mm, 450, 650\n0, 1, 1\n40, 0.7, 0.6\n200, 0, 0\n", encoding="utf-8"
    )
    lens = load(tmp_path, BARE + "blur: {kind: otf, file: mtf.csv}\n")
    assert isinstance(lens, Lens)
    assert lens.point_spread(2.0).otf(np.array([4e4]), 450.0)[0] == pytest.approx(0.7, abs=1e-6)  # type: ignore[union-attr,call-arg]


@pytest.mark.parametrize(
    ("text", "what", "line", "where"),
    [
        ("f_number: 2\n", "is not an optics file", None, None),
        ("photosite_optics: 2\nf_number: 2\n", "photosite_optics", 1, None),
        ("- 1\n", "is not an optics file", None, None),
        ("photosite_optics: 1\nf_number: 2\n", "field 'focal_length_mm' is mis", None, None),
        (BARE.replace("2.8", "fast"), "f_number", 2, None),
        (BARE.replace("2.8", "-2"), "f_number", 2, None),
    ],
)
def test_errors_in_the_first_fields(text: str, what: str, line: int | None, where: str | None, tmp_path: Path) -> None:
    with raises(FileError, what, line=line, where=where):
        load(tmp_path, text)


def test_the_same_fields_in_a_camera_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.camera.yaml"
    file.write_text(
        "photosite_camera: 1\noptics:\n  f_number: 2.8\n  focal_length_mm: 50\n  veiling_glare: {fraction: 0.02}\n"
    )
    optics = load_camera(file).optics
    assert isinstance(optics, Lens)
    file.write_text(
        "photosite_camera: 1\noptics:\n  f_number: 2.8\n  focal_length_mm: 50\n  veiling_glare: {fracton: 0.02}\n"
    )
    with raises(FileError, "unknown field"):
        load_camera(file)


def test_the_example_in_the_module_docstring(tmp_path: Path) -> None:
    import photosite.optics.io.optics_file as module

    assert module.__doc__ is not None
    text = module.__doc__.split("\n\n")[1].replace("falloff: cos4 ", "falloff: none ")
    lens = load(tmp_path, text.replace("source: ..., license: ...", "source: me"))
    assert isinstance(lens, Lens)
    assert lens.distortion is not None


@pytest.mark.parametrize(
    ("more", "what", "line", "where"),
    [
        ("fallof: cos4", "unknown field", 4, None),
        ("falloff: cos", "falloff", 4, None),
        ("transmittance: 92", "transmittance", 4, None),
        ("transmittance: {wavelength_nm: [400, 500], transmittance: [1]}", "values", 4, "transmittance"),
        ("focus_distance_m: 0.01", "focus_distance_m", 4, None),
        ("blur: sharp", "blur", 4, None),
        ("veiling_glare: 0.02", "veiling_glare", 4, None),
        ("transmittance: high", "transmittance", 4, None),
        ("transmittance: {wavelength_nm: [700, 400], transmittance: [1, 1]}", "wavelength_nm", 4, "transmittance"),
        ("transmittance: {wavelength_nm: [0.4, 0.7], transmittance: [1, 1]}", "wavelength_nm", 4, "transmittance"),
        ("distortion: {height_mm: [0, 7, 14], real_height_mm: [0, 0.0069, 0.0137]}", "ratio", 4, "distortion"),
        (
            "blur:\n  kind: wavefront\n  zernike: {8: 1}\n"
            "  chromatic_focus: {wavelength_nm: [0.4, 0.7], shift_um: [0, 1]}",
            "wavelength_nm",
            7,
            "blur.chromatic_focus",
        ),
        ("blur:\n  kind: wavefront\n  zernike:\n    8: 1\n    0: 1", "Zernike term", 8, "blur.zernike[0]"),
        ("blur:\n  kind: wavefront\n  pupil:\n    blades: 2", "blades", 7, "blur.pupil"),
        ("blur: {zernike: {4: 1}}", "kind", 4, "blur"),
        ("blur:\n  kind: wavefornt", "kind", 5, "blur"),
        ("blur:\n  kind: wavefront\n  zernikes: {4: 1}", "unknown field", 6, "blur"),
        ("blur: {kind: wavefront, zernike: {defocus: 1}}", "Zernike term", 4, "blur.zernike.defocus"),
        ("blur: {kind: wavefront, index: nm, zernike: {4: 1}}", "Zernike term", 4, "blur.zernike[4]"),
        ("blur:\n  kind: wavefront\n  pupil: {blade: 6}", "unknown field", 6, "blur.pupil"),
        ("blur:\n  kind: otf\n  file: none.csv", "there is no such file,", 6, "blur.file"),
        ("blur:\n  kind: psf\n  file: none.npz", "there is no such file,", 6, "blur.file"),
        ("blur: {kind: lens_design, source: none}", "there is no such file,", 4, "blur.source"),
        ("distortion: {file: none.txt}", "there is no such file,", 4, "distortion.file"),
        ("relative_illumination: {relative: [1, 0.5]}", "relative_illumination", 4, None),
        ("relative_illumination: {field_deg: [0, 1], relative: [100, 50]}", "relative", 4, "relative_illumination"),
        ("falloff: cos4\nrelative_illumination: {field_deg: [0, 9], relative: [1, 0.9]}", "falloff", 4, None),
        ("distortion: {field_deg: [0, 1], percent: [0, a]}", "percent[1]", 4, "distortion"),
        ("distortion: {field_deg: [0, 1]}", "a table of distortion", 4, "distortion"),
        ("distortion: {k1: -2}", "the distorted image folds back at", 4, "distortion"),
        ("distortion: {k2: 1, file: a.txt}", "k1", 4, "distortion"),
        ("lateral_color: {wavelength_nm: [450], shift_um: [[1]]}", "lateral_color", 4, None),
        (
            "lateral_color: {wavelength_nm: [450, 550], height_mm: [0, 5], shift_um: [[0, 1], [0]]}",
            "shift_um",
            4,
            "lateral_color",
        ),
        ("veiling_glare: {fraction: 1}", "fraction", 4, "veiling_glare"),
        ("provenance: {author: me}", "unknown field", 4, "provenance"),
        ("f_number: [", "is not YAML: expected the node", 5, None),
        ("relative_illumination: {field_deg: [], relative: []}", "field_deg", 4, "relative_illumination"),
        ("relative_illumination: {height_mm: [0, 5], relative: [1, .inf]}", "relative[1]", 4, "relative_illumination"),
        ("distortion: {height_mm: [], percent: []}", "height_mm", 4, "distortion"),
        (
            "lateral_color: {wavelength_nm: [450, 650], height_mm: [], shift_um: [[], []]}",
            "height_mm",
            4,
            "lateral_color",
        ),
        ("relative_illumination: {field_deg: [0, 9, 8], relative: [1, 1, 1]}", "field_deg", 4, "relative_illumination"),
        ("relative_illumination: {field_deg: 5, relative: [1]}", "field_deg", 4, "relative_illumination"),
        ("transmittance: {wavelength_nm: [400, 700], transmittance: [90, 92]}", "transmittance", 4, None),
        ("blur: {kind: wavefront, zernike: [0, 1, 50]}", "zernike", 4, "blur"),
        ("blur: {kind: wavefront, index: nm, zernike: {[3, 1]: 50}}", "zernike", 4, "blur"),
        ("blur: {kind: wavefront, index: nm, zernike: {3,1: 50}}", "zernike", 4, "blur"),
    ],
)
def test_errors_name_line_and_section_as_in_the_file(
    more: str, what: str, line: int | None, where: str | None, tmp_path: Path
) -> None:
    with raises(FileError, what, line=line, where=where) as caught:
        load(tmp_path, BARE + more + "\n")
    assert "angle_deg" not in str(caught.value)


def test_fields_of_a_lens_without_a_file() -> None:
    fields = {"f_number": 2.8, "focal_length_mm": 50, "distortion": {"k1": -0.1}}
    lens = load_optics(fields)
    assert (lens.base.f_number, lens.base.focal_length_mm) == (2.8, 50)
    assert lens.distortion is not None
    with raises(InputError, "focal_length_mm", value=-1):
        load_optics(fields | {"focal_length_mm": -1})
    with raises(InputError, "there is no such", where="blur.file"):
        load_optics(fields | {"blur": {"kind": "psf", "file": "missing.npz"}})
