"""Saved lenses are read back unchanged, and a failure leaves no files."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from raising import raises

from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError
from photosite.files.yaml import read_yaml
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.field_points import FieldPoints
from photosite.optics.illumination import IlluminationTable, VeilingGlare
from photosite.optics.io.formats import load_optics
from photosite.optics.io.optics_file import write_optics
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import RadialPsf
from photosite.optics.pupil import Pupil
from photosite.optics.tables import OtfTable, PsfTable
from photosite.optics.wavefront import Wavefront

BASE = DiffractionLimited(2.8, 1 / 3 * 100)
HEIGHTS, ANGLES = FieldPoints(height_mm=np.array([0, 7.1, 14.3])), FieldPoints(angle_deg=np.array([0, 10 / 3, 22]))
RNG = np.random.default_rng(3)
AXIS = np.arange(-10, 11) * 0.5
R2 = AXIS[:, None] ** 2 + AXIS**2


def plane_table(half: bool = False) -> OtfTable:
    """A shifted blur: complex values."""
    fy, fx = np.linspace(-200, 200, 9), np.linspace(0 if half else -200, 200, 5 if half else 9)
    f2 = fy[:, None] ** 2 + fx**2
    one = np.exp(-f2 / 5000) * np.exp(-2j * math.pi * (fy[:, None] * 1e-3 + fx * 7e-4))
    return OtfTable(np.array([450.0, 1900 / 3]), fy, np.stack([one, one * one.conj() * one]), fx)


def amplitude() -> np.ndarray:
    middle = (np.arange(24) + 0.5) / 12 - 1
    cells = np.cos(np.hypot(middle[:, None], middle)) * RNG.uniform(0.9, 1, (24, 24))
    cells[np.hypot(middle[:, None], middle) > 0.9] = 0
    return cells


def spots(count: int) -> np.ndarray:
    """(count, 2, n, n) PSFs of growing width."""
    psf = np.stack([[np.exp(-R2 / (1 + 0.4 * k + w)) for w in (0.5, 1.0)] for k in range(count)])
    return psf / psf.sum(axis=(2, 3), keepdims=True)


BLURS: dict[str, Any] = {
    "none": None,
    "noll": Wavefront({4: 50.1, 8: -1 / 3}),
    "no aberration": Wavefront(),
    "fringe in waves": Wavefront({9: 0.1}, index="fringe", unit="waves", reference_nm=632.8, norm="rms"),
    "pairs": Wavefront({(3, -1): 40.0, (2, 2): -7.25}, index="nm", norm="peak"),
    "NumPy's numbers": Wavefront({np.int64(5): np.float64(12.5)}, defocus_um=np.float64(-3.5)),
    "focus": Wavefront(
        {11: 20.0}, defocus_um=12.5, chromatic_focus=Spectrum(np.array([450.0, 1900 / 3]), np.array([-10.0, 1 / 7]))
    ),
    "blades": Wavefront(pupil=Pupil(blades=7, rotation_deg=12.5, roundness=0.3)),
    "spider": Wavefront(pupil=Pupil(0.35, vanes=3, vane_width=0.02, vane_rotation_deg=-30.0)),
    "array": Wavefront({8: 20.0}, pupil=Pupil(amplitude=amplitude())),
    "radial": OtfTable(
        np.array([450.0, 1900 / 3]), np.array([0, 100 / 3, 90]), np.array([[1, 1 / 3, -0.01], [1, 0.2, 0]])
    ),
    "radial, on": OtfTable(np.array([550.0]), np.array([0, 30.0]), np.array([[1, 0.7]]), beyond="diffraction"),
    "plane": plane_table(),
    "half plane": plane_table(half=True),
    "psf": PsfTable(np.array([450.0, 650.0]), spots(1)[0], 0.5),
    "psf to be normalized": PsfTable(np.array([450.0, 650.0]), 3 * spots(1)[0], 0.5, normalize=True),
    "design": LensDesign(
        np.array([450.0, 650.0]), spots(3), 0.5, np.zeros(3), np.array([0, 4.0, 9.0]), detail_um=2.2, nodes=9
    ),
    "design on a grid": LensDesign(
        np.array([450.0, 650.0]), spots(4), 0.5, np.array([-5.0, -5, 5, 5]), np.array([-7.0, 7, -7, 7]), "deg", False,
        rank=3,
    ),
}  # fmt: skip

LENSES: dict[str, DiffractionLimited | Lens] = {
    "diffraction alone": DiffractionLimited(np.float64(8), 50),
    "cos4": DiffractionLimited(4, 50.5, 0.92, "cos4"),
    "glass": DiffractionLimited(4, 50.5, Spectrum(np.array([400.0, 700]), np.array([1 / 3, 0.8]))),
    "name": Lens(BASE, name="50 mm: 'a' #1, \"é\""),
    "a name like a number": Lens(BASE, name="50"),
    "focus": Lens(BASE, focus_distance_m=10 / 3),
    "focus at infinity": Lens(BASE, focus_distance_m=math.inf),
    "illumination": Lens(BASE, illumination=IlluminationTable(HEIGHTS, np.array([1, 0.9, 1 / 3]))),
    "illumination by angle": Lens(BASE, illumination=IlluminationTable(ANGLES, np.array([1, 0.9, 1 / 3]))),
    "distortion": Lens(BASE, distortion=Distortion.from_percent(HEIGHTS, [0, -1 / 3, -4.7])),
    "distortion by angle": Lens(BASE, distortion=Distortion.from_percent(ANGLES, [0, 1 / 3, 24.7])),
    "polynomial": Lens(BASE, distortion=Distortion.polynomial(-0.08, 0.01, max_field_deg=30)),
    "real heights": Lens(BASE, distortion=Distortion.from_real_heights(ANGLES, [0, 1.94, 13.1], BASE.focal_length_mm)),
    "magnification": Lens(BASE, lateral_color=LateralColor.from_magnification([450, 550, 650], [1.0004, 1, 0.9997])),
    "shifts": Lens(BASE, lateral_color=LateralColor(np.array([450.0, 650]), ANGLES, RNG.normal(0, 1, (2, 3)))),
    "even glare": Lens(BASE, veiling_glare=VeilingGlare(1 / 30)),
    "glare": Lens(BASE, veiling_glare=VeilingGlare(0.02, 3.7e-3)),
} | {f"blur: {name}": Lens(BASE, blur, focus_distance_m=2.0, name=name) for name, blur in BLURS.items()}


def assert_same(one: object, other: object, place: str = "lens") -> None:
    """Compare field by field; numbers within two roundings."""
    if isinstance(one, int | float | np.ndarray) and not isinstance(one, bool):
        np.testing.assert_allclose(np.asarray(other), np.asarray(one), rtol=4e-16, atol=1e-18, err_msg=place)
        return
    assert type(one) is type(other), place
    if is_dataclass(one):
        for entry in fields(one):
            assert_same(getattr(one, entry.name), getattr(other, entry.name), f"{place}.{entry.name}")
    elif hasattr(one, "keys"):
        assert dict(one) == dict(other), place  # type: ignore[call-overload]
    else:
        assert one == other, place


@pytest.mark.parametrize("name", LENSES)
def test_round_trip(tmp_path: Path, name: str) -> None:
    lens = LENSES[name]
    lens.save(tmp_path / "mine.optics.yaml")
    whole = lens if isinstance(lens, Lens) else Lens(lens)
    assert_same(whole, load_optics(tmp_path / "mine.optics.yaml"))
    again = tmp_path / "again"
    again.mkdir()
    load_optics(tmp_path / "mine.optics.yaml").save(again / "mine.optics.yaml")
    # The last digit of a number in a table may differ, and then its digest does.
    texts = ((folder / "mine.optics.yaml").read_text().splitlines() for folder in (again, tmp_path))
    first, second = ([line for line in text if "sha256" not in line] for text in texts)
    assert first == second


def test_all_parts_at_once(tmp_path: Path) -> None:
    lens = Lens(
        DiffractionLimited(2.8, 50, 0.9),
        BLURS["psf"],
        2.0,
        IlluminationTable(HEIGHTS, np.array([1, 0.9, 0.7])),
        Distortion.from_percent(HEIGHTS, [0, -0.5, -2]),
        LateralColor.from_magnification([450, 550, 650], [1.0004, 1, 0.9997]),
        VeilingGlare(0.02, 3e-3),
        "all",
    )
    provenance = {"source": "nowhere", "license": "CC0", "created": "2026-11-21", "notes": "two\nlines"}
    lens.save(tmp_path / "all.optics.yaml", provenance)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["all.optics.psf.npz", "all.optics.yaml"]
    assert dict(read_yaml(tmp_path / "all.optics.yaml", "a lens")["provenance"]) == provenance
    found = load_optics(tmp_path / "all.optics.yaml")
    assert_same(lens, found)


@pytest.mark.parametrize("lens", [BASE, Lens(BASE)])
def test_round_trip_of_a_bare_lens(lens: Lens | DiffractionLimited, tmp_path: Path) -> None:
    lens.save(tmp_path / "a.yaml")
    found = load_optics(tmp_path / "a.yaml")
    assert_same(Lens(BASE), found)
    assert (found.name, found.blur, found.focus_distance_m) == (None, None, None)


def remove_digest(file: Path) -> None:
    lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join(line for line in lines if "sha256" not in line) + "\n", encoding="utf-8")


@pytest.mark.parametrize("kind", ["psf", "array"])
def test_a_table_of_another_lens_is_an_error(tmp_path: Path, kind: str) -> None:
    """As when a program ends after the table was replaced, and before the optics file."""
    table = {"psf": "a.psf.npz", "array": "a.pupil.npz"}[kind]
    Lens(BASE, BLURS[kind]).save(tmp_path / "a.yaml")
    with np.load(tmp_path / table) as archive:
        arrays = {name: archive[name] for name in archive.files}
    last = {"psf": "psf", "array": "amplitude"}[kind]
    np.savez(tmp_path / table, **arrays | {last: 0.9999 * arrays[last]})
    with pytest.raises(FileError) as caught:
        load_optics(tmp_path / "a.yaml")
    assert caught.value.path == str(tmp_path / table)
    remove_digest(tmp_path / "a.yaml")
    load_optics(tmp_path / "a.yaml")


def test_saving_again_removes_the_former_tables(tmp_path: Path) -> None:
    """Only tables that the former file named are removed."""
    Lens(BASE, BLURS["radial"]).save(tmp_path / "a.yaml")
    (tmp_path / "a.psf.npz").write_bytes(b"other data")
    Lens(BASE, BLURS["array"]).save(tmp_path / "a.yaml")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.psf.npz", "a.pupil.npz", "a.yaml"]
    BASE.save(tmp_path / "a.yaml")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.psf.npz", "a.yaml"]
    (tmp_path / "b.yaml").write_text("no: [lens")
    BASE.save(tmp_path / "b.yaml")


def test_magnification_stated_at_another_height(tmp_path: Path) -> None:
    """At 20 mm, 4e-4 is 8 um."""
    grid, shift = np.array([450.0, 650.0]), np.array([[8.0], [-6.0]])
    lens = Lens(BASE, lateral_color=LateralColor(grid, FieldPoints(height_mm=np.array([20.0])), shift, True))
    lens.save(tmp_path / "a.yaml")
    found = load_optics(tmp_path / "a.yaml").mapping(math.inf)
    wanted = lens.mapping(math.inf)
    assert found is not None
    assert wanted is not None
    np.testing.assert_allclose(found.real_m, wanted.real_m, rtol=1e-12)


@dataclass(frozen=True)
class OwnBlur:
    def point_spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> RadialPsf:
        return base.point_spread(distance_m)


class OwnWavefront(Wavefront):
    pass


class OwnLens(Lens):
    pass


EVERYWHERE = LateralColor(np.array([450.0, 650.0]), HEIGHTS, np.array([[0, 1, 2.0], [0, -1, -2]]), everywhere=True)


@pytest.mark.parametrize(
    ("lens", "what"),
    [
        (Lens(BASE, OwnBlur()), "blur"),
        (Lens(BASE, OwnWavefront()), "blur"),
        (OwnLens(BASE), "lens"),
        (Lens(BASE, BLURS["psf"], lateral_color=EVERYWHERE), "lateral_color"),
    ],
)
def test_lenses_that_a_file_cannot_represent(tmp_path: Path, lens: Lens, what: str) -> None:
    with raises(InputError, what):
        write_optics(lens, tmp_path / "a.yaml")
    assert not list(tmp_path.iterdir())


def test_files_above_the_size_limit_are_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photosite.optics.io.optics_file.LARGEST_BYTES", 1 << 16)
    many = FieldPoints(np.linspace(0, 9, 2_000))
    with raises(InputError, "the optics file would exceed"):
        Lens(BASE, illumination=IlluminationTable(many, np.linspace(1, 0.5, 2_000))).save(tmp_path / "a.yaml")
    assert not list(tmp_path.iterdir())


def test_a_failure_leaves_the_former_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lens = Lens(BASE, BLURS["psf"])
    lens.save(tmp_path / "a.yaml")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with raises(FileError, "cannot be written"):
        replace(lens, name="another").save(tmp_path / "a.yaml")
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("x" * 300 + ".yaml", "cannot be written"),
        ("a.txt", "the name of an optics file"),
        ("gone/a.yaml", "cannot be written"),
        ("taken.yaml", "cannot be written"),
        ("beside.yaml", "cannot be written"),
    ],
)
def test_paths_that_cannot_be_written(tmp_path: Path, name: str, what: str) -> None:
    (tmp_path / "taken.yaml").mkdir()
    (tmp_path / "beside.psf.npz").mkdir()
    with raises(FileError, what):
        Lens(BASE, BLURS["psf"]).save(tmp_path / name)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["beside.psf.npz", "taken.yaml"]


@pytest.mark.parametrize("provenance", [{"sorce": "x"}, {"source": 3}, "nowhere"])
def test_invalid_provenance(tmp_path: Path, provenance: Any) -> None:
    with raises(InputError, "provenance"):
        BASE.save(tmp_path / "a.yaml", provenance)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["array", "design"])
@pytest.mark.parametrize(
    ("damage", "what"),
    [
        (lambda file: file.unlink(), "there is no such file"),
        (
            lambda file: (text := file.parent / "a.yaml").write_text(text.read_text().replace(file.name, "x" * 300)),
            ("there is no such file", "cannot be read"),
        ),
        (lambda file: file.write_bytes(file.read_bytes()[:200]), "cannot be read"),
        (lambda file: file.write_bytes(b""), "cannot be read"),
        (lambda file: np.savez(file, other=1), "holds no array"),
    ],
)
def test_damaged_arrays(tmp_path: Path, name: str, damage: Any, what: Any) -> None:
    Lens(BASE, BLURS[name]).save(tmp_path / "a.yaml")
    (file,) = tmp_path.glob("*.npz")
    damage(file)
    with raises(FileError, what):
        load_optics(tmp_path / "a.yaml")


def test_invalid_arrays(tmp_path: Path) -> None:
    Lens(BASE, BLURS["array"]).save(tmp_path / "a.yaml")
    remove_digest(tmp_path / "a.yaml")
    np.savez(tmp_path / "a.pupil.npz", amplitude=np.full((9, 9), "x"))
    with raises(FileError, "amplitude"):
        load_optics(tmp_path / "a.yaml")
    np.savez(tmp_path / "a.pupil.npz", amplitude=np.full((9, 9), 2.0))
    with raises(FileError, "amplitude", line=10):
        load_optics(tmp_path / "a.yaml")
    Lens(BASE, BLURS["design"]).save(tmp_path / "b.yaml")
    arrays = dict(np.load(tmp_path / "b.design.npz"))
    np.savez(tmp_path / "b.design.npz", **arrays | {"unit": "inch" * 9999})
    with raises(FileError, "unit"):
        load_optics(tmp_path / "b.yaml")
    text = (tmp_path / "b.yaml").read_text()
    (tmp_path / "b.yaml").write_text(text + "  first_row: top\n")
    with raises(FileError, "first_row"):
        load_optics(tmp_path / "b.yaml")
