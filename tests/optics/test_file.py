"""Optics files: what they say becomes the lens, and what they cannot say is refused with its line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from photosite.camera.file import load_camera
from photosite.color.spectrum import Spectrum
from photosite.errors import FileError
from photosite.optics.compound import Lens
from photosite.optics.io.optics_file import load_optics
from photosite.optics.lens import DiffractionLimited
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


def test_everything_that_is_said_is_in_the_lens(tmp_path: Path) -> None:
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


def test_a_perfect_lens_is_a_perfect_lens(tmp_path: Path) -> None:
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
def test_other_ways_to_say_it(more: str, check: object, tmp_path: Path) -> None:
    lens = load(tmp_path, BARE + more + "\n")
    assert isinstance(lens, Lens)
    assert check(lens)  # type: ignore[operator]


def test_tables_lie_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "mtf.csv").write_text(
        "frequency_per_mm, 450, 650\n0, 1, 1\n40, 0.7, 0.6\n200, 0, 0\n", encoding="utf-8"
    )
    lens = load(tmp_path, BARE + "blur: {kind: otf, file: mtf.csv}\n")
    assert isinstance(lens, Lens)
    assert lens.spread(2.0).otf(np.array([4e4]), 450.0)[0] == pytest.approx(0.7, abs=1e-6)  # type: ignore[union-attr,call-arg]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("f_number: 2\n", r"does not describe a lens: expected 'photosite_optics: 1'"),
        ("photosite_optics: 2\nf_number: 2\n", r":1: does not describe a lens"),
        ("- 1\n", "does not describe a lens"),
        ("photosite_optics: 1\nf_number: 2\n", r"yaml: field 'focal_length_mm' is missing"),
        (BARE.replace("2.8", "fast"), r":2: f_number: expected a valid number, not 'fast'"),
        (BARE.replace("2.8", "-2"), r":2: f_number: expected greater than 0, not -2"),
        (BARE + "fallof: cos4\n", r":4: unknown field 'fallof'; did you mean 'falloff'\?"),
        (BARE + "falloff: cos\n", r":4: falloff: expected 'none' or 'cos4', not 'cos'"),
        (
            BARE + "transmittance: 92\n",
            r":4: transmittance: .* not 92; percent are divided by 100",
        ),
        (
            BARE + "transmittance: {wavelength_nm: [400, 500], transmittance: [1]}\n",
            r":4: .*one transmittance per wave",
        ),
        (BARE + "focus_distance_m: 0.01\n", r":4: focus_distance_m: an object at 0\.01 m has no image"),
        (
            BARE + "blur: sharp\n",
            r":4: blur: expected \{kind: diffraction \| wavefront \| otf \| psf \| lens_design, \.\.\.\}, not 'sharp'",
        ),
        (BARE + "veiling_glare: 0.02\n", r":4: veiling_glare: expected \{fraction, spread_mm\}, not 0\.02"),
        (
            BARE + "transmittance: high\n",
            r":4: transmittance: expected a number or \{wavelength_nm, tran.*, not 'high'",
        ),
        (
            BARE + "transmittance: {wavelength_nm: [700, 400], transmittance: [1, 1]}\n",
            r":4: transmittance: wavelengths must increase",
        ),
        (
            BARE + "transmittance: {wavelength_nm: [0.4, 0.7], transmittance: [1, 1]}\n",
            r":4: transmittance: a wavelength of 0\.4 nm .*in um, multiply by 1000",
        ),
        (
            BARE + "distortion: {height_mm: [0, 7, 14], real_height_mm: [0, 0.0069, 0.0137]}\n",
            r":4: distortion: .* 0\.000986 times its ideal height: real heights are in mm",
        ),
        (
            BARE + "blur:\n  kind: wavefront\n  zernike: {8: 1}\n  chromatic_focus: {wavelength_nm: [0.4, 0.7], "
            "shift_um: [0, 1]}\n",
            r":7: blur\.chromatic_focus: a wavelength of 0\.4 nm",
        ),
        (
            BARE + "blur:\n  kind: wavefront\n  zernike:\n    8: 1\n    0: 1\n",
            r":8: blur\.zernike\.0: a Zernike term of index 'noll' is a whole number from 1",
        ),
        (
            BARE + "blur:\n  kind: wavefront\n  pupil:\n    blades: 2\n",
            r":6: blur\.pupil: a diaphragm has 3 to 360 blades",
        ),
        (BARE + "blur: {zernike: {4: 1}}\n", r":4: blur: field 'kind' is missing; known are: diffraction, wavefront"),
        (
            BARE + "blur:\n  kind: wavefornt\n",
            r":5: blur\.kind: there is no kind 'wavefornt'; did you mean 'wavefront'",
        ),
        (
            BARE + "blur:\n  kind: wavefront\n  zernikes: {4: 1}\n",
            r":6: blur: unknown field 'zernikes'; did you mean 'zern",
        ),
        (
            BARE + "blur: {kind: wavefront, zernike: {defocus: 1}}\n",
            r":4: blur\.zernike\.defocus: a Zernike term of index noll is a number",
        ),
        (BARE + "blur: {kind: wavefront, index: nm, zernike: {4: 1}}\n", r":4: blur\.zernike\.4: .*written in quotes"),
        (
            BARE + "blur:\n  kind: wavefront\n  pupil: {blade: 6}\n",
            r":6: blur\.pupil: unknown field 'blade'; did you mean",
        ),
        (
            BARE + "blur:\n  kind: otf\n  file: none.csv\n",
            r"mine\.optics\.yaml:6: blur\.file: there is no such file, .*none\.csv",
        ),
        (
            BARE + "blur:\n  kind: psf\n  file: none.npz\n",
            r"mine\.optics\.yaml:6: blur\.file: there is no such file, .*none\.npz",
        ),
        (
            BARE + "blur: {kind: lens_design, source: none}\n",
            r"mine\.optics\.yaml:4: blur\.source: there is no such file, .*none",
        ),
        (
            BARE + "distortion: {file: none.txt}\n",
            r"mine\.optics\.yaml:4: distortion\.file: there is no such file, .*none\.txt",
        ),
        (BARE + "relative_illumination: {relative: [1, 0.5]}\n", r":4: .*given by one of height_mm, field_deg, file"),
        (BARE + "relative_illumination: {field_deg: [0, 1], relative: [100, 50]}\n", r":4: .*divide all by its value"),
        (
            BARE + "falloff: cos4\nrelative_illumination: {field_deg: [0, 9], relative: [1, 0.9]}\n",
            r":4: falloff: .*all of the fall-off",
        ),
        (
            BARE + "distortion: {field_deg: [0, 1], percent: [0, a]}\n",
            r":4: distortion\.percent\.1: expected a valid num",
        ),
        (
            BARE + "distortion: {field_deg: [0, 1]}\n",
            r"a table of distortion is given by one of percent, real_height_mm",
        ),
        (BARE + "distortion: {k1: -2}\n", r":4: distortion: the distorted image folds back"),
        (BARE + "distortion: {k2: 1, file: a.txt}\n", r":4: distortion: k2 and k3 go with k1"),
        (BARE + "lateral_color: {wavelength_nm: [450], shift_um: [[1]]}\n", r":4: lateral_color: .*given by one of"),
        (
            BARE + "lateral_color: {wavelength_nm: [450, 550], height_mm: [0, 5], shift_um: [[0, 1], [0]]}\n",
            r":4: lateral_color: rows of shift_um differ",
        ),
        (BARE + "veiling_glare: {fraction: 1}\n", r":4: veiling_glare\.fraction: expected less than 1, not 1"),
        (BARE + "provenance: {author: me}\n", r":4: provenance: unknown field 'author'; known are: source, license"),
        (BARE + "f_number: [\n", "is not YAML"),
    ],
)
def test_wrong_files_give_one_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=message) as caught:
        load(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_a_camera_file_holds_the_same_fields(tmp_path: Path) -> None:
    file = tmp_path / "mine.camera.yaml"
    file.write_text(
        "photosite_camera: 1\noptics:\n  f_number: 2.8\n  focal_length_mm: 50\n  veiling_glare: {fraction: 0.02}\n"
    )
    optics = load_camera(file).optics
    assert isinstance(optics, Lens)
    file.write_text(
        "photosite_camera: 1\noptics:\n  f_number: 2.8\n  focal_length_mm: 50\n  veiling_glare: {fracton: 0.02}\n"
    )
    with pytest.raises(FileError, match=r":5: optics\.veiling_glare: unknown field 'fracton'; did you mean 'fraction'"):
        load_camera(file)


def test_the_way_of_the_module_text_is_a_lens(tmp_path: Path) -> None:
    import photosite.optics.io.optics_file as module

    assert module.__doc__ is not None
    text = module.__doc__.split("\n\n")[1].replace("falloff: cos4 ", "falloff: none ")
    lens = load(tmp_path, text.replace("source: ..., license: ...", "source: me"))
    assert isinstance(lens, Lens)
    assert lens.distortion is not None


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("relative_illumination: {field_deg: [], relative: []}", r":4: .*field_deg is empty"),
        ("relative_illumination: {height_mm: [0, 5], relative: [1, .inf]}", ":4: .*"),
        ("distortion: {height_mm: [], percent: []}", r":4: .*height_mm is empty"),
        (
            "lateral_color: {wavelength_nm: [450, 650], height_mm: [], shift_um: [[], []]}",
            r":4: .*height_mm is empty",
        ),
        ("relative_illumination: {field_deg: [0, 9, 8], relative: [1, 1, 1]}", r":4: .*: field_deg must increase"),
        (
            "relative_illumination: {field_deg: 5, relative: [1]}",
            r":4: .*field_deg: expected a list, \[\.\.\.\], not 5",
        ),
        ("transmittance: 92", r":4: transmittance: .*fraction, 0 to 1, not 92; percent are divided by 100"),
        (
            "transmittance: {wavelength_nm: [400, 700], transmittance: [90, 92]}",
            r":4: transmittance: .*0 to 1, not 90; percent are divided by 100",
        ),
        ("blur: {kind: wavefront, zernike: [0, 1, 50]}", r":4: blur.zernike: expected \{8: 50, 11: -20\}, .* not \[0"),
        (
            "blur: {kind: wavefront, index: nm, zernike: {[3, 1]: 50}}",
            r""":4: blur.zernike: .*written in quotes, "3,-1": 40""",
        ),
        (
            "blur: {kind: wavefront, index: nm, zernike: {3,1: 50}}",
            r""":4: blur.zernike: .*written in quotes, "3,-1": """,
        ),
    ],
)
def test_what_cannot_be_is_said_in_the_files_own_words(more: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=message) as caught:
        load(tmp_path, BARE + more + "\n")
    assert "\n" not in str(caught.value)
    assert "angle_deg" not in str(caught.value)
