"""Tables of OTFs and PSFs against closed forms, and invalid files."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from raising import raises

from photosite.errors import FileError, InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.io.formats import load_psf_table
from photosite.optics.io.tables import load_otf_table
from photosite.optics.point_spread import PlanePsf, RadialPsf
from photosite.optics.tables import OtfTable, PsfTable
from photosite.optics.wavefront import Wavefront

Array = NDArray[np.float64]
LENS = DiffractionLimited(f_number=8, focal_length_mm=50)
PER_MM = np.arange(0.0, 301.0, 5.0)


def gaussian_mtf(sigma_um: float, frequency_per_mm: Array = PER_MM) -> Array:
    return np.exp(-2 * (math.pi * sigma_um * 1e-3 * frequency_per_mm) ** 2)


def gaussian(
    sigma_um: float, spacing_um: float = 1.0, count: int = 61, shift_um: tuple[float, float] = (0, 0)
) -> Array:
    at = (np.arange(count) - count // 2) * spacing_um
    y, x = (at - shift_um[0])[:, None], at - shift_um[1]
    return np.exp(-(x**2 + y**2) / (2 * sigma_um**2)) * spacing_um**2 / (2 * math.pi * sigma_um**2)


def test_radial_table_between_frequencies_and_wavelengths() -> None:
    table = OtfTable([450.0, 650.0], PER_MM, [gaussian_mtf(3.0), gaussian_mtf(5.0)])
    spread = table.point_spread(LENS, 1.2)
    assert isinstance(spread, RadialPsf)
    f = np.linspace(0, 300, 777)
    blue, red = gaussian_mtf(3.0, f), gaussian_mtf(5.0, f)
    assert spread.otf(f * 1e3, 450.0) == pytest.approx(blue, abs=1e-3)
    assert spread.otf(f * 1e3, 500.0) == pytest.approx(0.75 * blue + 0.25 * red, abs=1e-3)
    assert spread.otf(f * 1e3, 900.0) == pytest.approx(red, abs=2e-3)
    assert spread.otf(np.array([3.1e5]), 500.0) == 0
    # 99.5 % of the energy of a Gaussian is within sigma sqrt(2 ln 200).
    assert spread.reach_m(450.0) == pytest.approx(3e-6 * math.sqrt(2 * math.log(200)), rel=0.05)


def test_diffraction_beyond_the_end_of_a_table() -> None:
    f = np.array([0.0, 20.0, 40.0])
    values = 0.9 ** (f / 20) * LENS.otf(f * 1e3, 550.0, 1.2)
    with raises(InputError, "values"):
        OtfTable([550.0], f, [values])
    spread = OtfTable([550.0], f, [values], beyond="diffraction").point_spread(LENS, 1.2)
    beyond = np.array([50e3, 100e3, 200e3])
    assert spread.cutoff_per_m(550.0) == LENS.cutoff_per_m(550.0, 1.2)
    assert isinstance(spread, RadialPsf)
    assert spread.otf(beyond, 550.0) == pytest.approx(0.81 * LENS.otf(beyond, 550.0, 1.2), rel=1e-12)
    assert spread.otf(np.array([40e3]), 550.0) == pytest.approx(values[2], rel=1e-12)


@pytest.mark.parametrize("half", ["neither", "rows", "columns"])
def test_phase_of_a_2d_table(half: str) -> None:
    """A Gaussian wider along the columns than along the rows, shifted by 2 um down and 1 um left."""
    whole = np.arange(-200.0, 201.0, 4.0)
    fy = whole[whole >= 0] if half == "rows" else whole
    fx = whole[whole >= 0] if half == "columns" else whole

    def exact(y: Array, x: Array) -> NDArray[np.complex128]:
        turn = np.exp(-2j * math.pi * (y * 2e-3 + x * -1e-3))
        return turn * np.exp(-2 * math.pi**2 * ((y * 3e-3) ** 2 + (x * 4e-3) ** 2))

    table = OtfTable([550.0], fy, exact(fy[:, None], fx)[None], fx_per_mm=fx)
    spread = table.point_spread(LENS, 1.2)
    assert isinstance(spread, PlanePsf)
    y, x = np.random.default_rng(1).uniform(-199, 199, (2, 500))
    assert np.abs(spread.otf(y * 1e3, x * 1e3, 550.0) - exact(y, x)).max() < 1e-4
    assert spread.otf(np.array([2.1e5]), np.array([0.0]), 550.0) == 0
    assert 10e-6 < spread.reach_m(550.0) < 4e-6 * math.sqrt(2 * math.log(200)) + 2.3e-6


@pytest.mark.parametrize("count", [60, 61])
def test_otf_of_a_sampled_gaussian(count: int) -> None:
    samples = np.stack([gaussian(2.0, 1.0, count), gaussian(3.0, 1.0, count, (1.25, -0.5))])
    spread = PsfTable([450.0, 650.0], samples, 1.0).point_spread(LENS, 1.2)
    fy, fx = np.random.default_rng(2).uniform(-150e3, 150e3, (2, 300))
    square = (fy**2 + fx**2) * 1e-12
    blue = np.exp(-2 * math.pi**2 * square * 4)
    red = np.exp(-2 * math.pi**2 * square * 9 - 2j * math.pi * (fy * 1.25e-6 - fx * 0.5e-6))
    # The Fourier sum of the samples includes the aliased part of the Gaussian.
    assert np.abs(spread.otf(fy, fx, 450.0) - blue).max() < 1e-5
    assert np.abs(spread.otf(fy, fx, 550.0) - (blue + red) / 2).max() < 1e-5
    assert spread.otf(np.zeros(1), np.zeros(1), 500.0)[0] == pytest.approx(1, abs=1e-12)
    assert spread.reach_m(300.0) == pytest.approx(2e-6 * math.sqrt(2 * math.log(200)), abs=0.6e-6)
    column, row = np.linspace(-4e5, 4e5, 7)[:, None], np.linspace(-4e5, 4e5, 9)[None]
    both = np.broadcast_arrays(column, row)
    assert np.abs(spread.otf(column, row, 450.0) - spread.otf(*both, 450.0)).max() < 1e-14


def test_sampled_psf_of_a_wavefront_has_its_otf() -> None:
    """PSF of coma, sampled at a third of the period of its cutoff. Wavefronts are transformed in single precision."""
    wave = Wavefront({7: 60.0, 6: 30.0}).point_spread(LENS, math.inf)
    assert isinstance(wave, PlanePsf)
    period_m, count = 550e-9 * 8, 257
    spacing = period_m / 3
    f = np.fft.fftfreq(count, spacing)
    image = np.fft.fftshift(np.fft.ifft2(wave.otf(f[:, None], f[None], 550.0)).real)
    table = PsfTable([550.0], [image], spacing * 1e6).point_spread(LENS, 1.2)
    fy, fx = (f[np.random.default_rng(k).integers(0, count, 200)] for k in (1, 2))
    assert np.abs(table.otf(fy, fx, 550.0) - wave.otf(fy, fx, 550.0)).max() < 1e-7


GOOD: dict[str, Any] = {"wavelength_nm": [450.0, 650.0], "frequency_per_mm": PER_MM}
VALUES = np.stack([gaussian_mtf(3.0), gaussian_mtf(5.0)])
AXIS = np.arange(-200.0, 201.0, 10.0)
PLANE = np.exp(-(AXIS[:, None] ** 2 + AXIS**2) / 2 / 60**2).astype(complex)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"wavelength_nm": [650.0, 450.0]}, "wavelength_nm"),
        ({"wavelength_nm": [0.45, 0.65]}, "wavelength_nm"),
        ({"values": VALUES * 100}, "values"),
        ({"values": VALUES * 0.9}, "values"),
        ({"values": VALUES[:1]}, "values"),
        ({"values": np.where(VALUES < 0.5, np.nan, VALUES)}, "values"),
        ({"frequency_per_mm": PER_MM[::-1]}, "frequency_per_mm"),
        ({"frequency_per_mm": PER_MM + 5}, "frequency_per_mm"),
        ({"values": VALUES**0.1, "frequency_per_mm": PER_MM / 4}, "values"),
        ({"beyond": "nothing"}, "beyond"),
        (
            {"wavelength_nm": [550.0], "frequency_per_mm": AXIS, "fx_per_mm": AXIS + 5, "values": [PLANE]},
            "frequency_per_mm and fx_per_mm",
        ),
        (
            {
                "wavelength_nm": [550.0],
                "frequency_per_mm": AXIS,
                "fx_per_mm": AXIS,
                "values": [PLANE + 5e-3j * AXIS**2 / 4e4],
            },
            "values",
        ),
        (
            {
                "wavelength_nm": [550.0],
                "frequency_per_mm": AXIS[20:],
                "fx_per_mm": AXIS[20:],
                "values": [PLANE[20:, 20:]],
            },
            "frequency_per_mm",
        ),
    ],
)
def test_invalid_otf_tables(change: dict[str, Any], what: str) -> None:
    with raises(InputError, what):
        OtfTable(**{**GOOD, "values": VALUES, **change})


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"samples": [gaussian(2.0) * 1.002]}, "samples"),
        ({"samples": [gaussian(2.0)[:, :-1]]}, "samples"),
        ({"samples": [gaussian(2.0) - 1e-4]}, "samples"),
        ({"samples": [np.full((9, 9), np.nan)]}, "samples"),
        ({"samples": [np.zeros((9, 9))]}, "samples"),
        ({"samples": [-gaussian(2.0)], "normalize": True}, "samples"),
        ({"spacing_um": 5e-7}, "spacing_um"),
        ({"wavelength_nm": [0.55]}, "wavelength_nm"),
        ({"samples": [gaussian(0.4) / gaussian(0.4).sum()]}, "spacing_um"),
        ({"spacing_um": None}, "spacing_um"),
        ({"spacing_um": -1.0}, "spacing_um"),
        ({"wavelength_nm": [550.0, 450.0], "samples": [gaussian(2.0)] * 2}, "wavelength_nm"),
    ],
)
def test_invalid_psf_tables(change: dict[str, Any], what: str) -> None:
    with raises(InputError, what):
        PsfTable(**{"wavelength_nm": [550.0], "samples": [gaussian(2.0)], "spacing_um": 1.0, **change})


def test_normalize_divides_by_the_sum() -> None:
    table = PsfTable([550.0], [gaussian(2.0) * 40], 1.0, normalize=True)
    assert table.samples.sum() == pytest.approx(1, abs=1e-12)


def test_mtf_from_a_file_with_comments(tmp_path: Path) -> None:
    path = tmp_path / "mtf.csv"
    rows = "\n".join(f"{f:g},{a:.6f},{b:.6f}" for f, a, b in zip(PER_MM, *VALUES, strict=True))
    path.write_text(f"# bench 3\nfrequency_per_mm,450nm, 650\n{rows}\n")
    table = load_otf_table(path)
    assert table.wavelength_nm.tolist() == [450, 650]
    assert table.values == pytest.approx(VALUES, abs=1e-6)


def test_2d_table_from_a_file_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "otf.csv"
    tilted = PLANE * np.exp(-2j * math.pi * AXIS * 1e-3)  # 1 um to the right
    lines = [
        f"{tilted[i, j].real:.8f},{tilted[i, j].imag:.8f},{x},{y},550"
        for i, y in enumerate(AXIS)
        for j, x in enumerate(AXIS)
    ]
    np.random.default_rng(1).shuffle(lines)
    path.write_text("real,imag,fx_per_mm,fy_per_mm,wavelength_nm\n" + "\n".join(lines))
    table = load_otf_table(path)
    assert np.abs(table.values[0] - tilted).max() < 1e-7
    path.write_text("real,imag,fx_per_mm,fy_per_mm,wavelength_nm\n" + "\n".join(lines[1:]))
    with raises(FileError, "entries"):
        load_otf_table(path)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", ("is empty", None)),
        ("a,b\n1,2\n", ("the header", 1)),
        ("frequency_per_mm,blue\n0,1\n", ("column name", 1)),
        ("frequency_per_mm,450\n0,1\n10,half\n", ("entry", 3)),
        ("frequency_per_mm,450\n0,1\n10,nan\n", ("entry", 3)),
        ("frequency_per_mm,450\n0,1\n10\n", ("entries in this line", 3)),
        ("frequency_per_mm,450\n0,1\n50,0.3\n40,0\n", ("frequency_per_mm", None)),
        ("frequency_per_mm,650,450\n0,1,1\n50,0,0\n", ("wavelength_nm", None)),
        ("frequency_per_mm,450\n", ("frequency_per_mm", None)),
        ("frequency_per_mm\n0\n1\n", ("wavelength_nm", None)),
    ],
)
def test_invalid_otf_files(tmp_path: Path, text: str, error: tuple[str, int | None]) -> None:
    path = tmp_path / "otf.csv"
    path.write_text(text)
    with raises(FileError, error[0], line=error[1]):
        load_otf_table(path)
    with raises(FileError, "there is no such file"):
        load_otf_table(tmp_path / "missing.csv")


def test_psfs_from_every_format(tmp_path: Path) -> None:
    stack = np.stack([gaussian(2.0), gaussian(3.0)])
    np.savez(tmp_path / "a.npz", psf=stack, spacing_um=1.0, wavelength_nm=[450.0, 650.0])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["psf"] = stack
        file["psf"].attrs["spacing_um"] = 1.0
        file["wavelength_nm"] = [450.0, 650.0]
    tifffile.imwrite(tmp_path / "a.tif", stack, photometric="minisblack")
    np.savetxt(tmp_path / "a.txt", stack[0])
    np.savetxt(tmp_path / "a.csv", stack[0], delimiter=",")
    stated = {"spacing_um": 1.0, "wavelength_nm": [450.0, 650.0]}
    for name, options in {"a.npz": {}, "a.h5": {"spacing_um": 1.0}, "a.tif": stated}.items():
        table = load_psf_table(tmp_path / name, **options)
        assert table.samples == pytest.approx(stack / stack.sum(axis=(1, 2), keepdims=True), abs=1e-15)
        assert table.wavelength_nm.tolist() == [450, 650]
    for name in ("a.txt", "a.csv"):
        table = load_psf_table(tmp_path / name, spacing_um=1.0, wavelength_nm=550)
        assert table.samples[0] == pytest.approx(stack[0] / stack[0].sum(), abs=1e-15)


def test_invalid_psf_files(tmp_path: Path) -> None:
    options = {"spacing_um": 1.0, "wavelength_nm": 550}

    def refused(name: str, what: str, **options: Any) -> None:
        with raises(FileError, what):
            load_psf_table(tmp_path / name, **options)

    np.savez(tmp_path / "a.npz", psf=gaussian(2.0))
    refused("a.npz", "does not state its spacing_um")
    refused("a.npz", "does not state its wavelength_nm", spacing_um=1.0)
    np.savez(tmp_path / "b.npz", psf=gaussian(2.0), spacing_um=2.0, wavelength_nm=550.0)
    refused("b.npz", "spacing_um", spacing_um=1.0)
    np.savez(tmp_path / "c.npz", image=gaussian(2.0))
    refused("c.npz", "holds no array 'psf', but image", **options)
    np.savez(tmp_path / "d.npz", psf=np.array([{}], dtype=object), spacing_um=1.0)
    refused("d.npz", "cannot be read")
    for place, psf, spacing in (
        ("psf", gaussian(2.0) * 1j, 1.0), ("psf", gaussian(2.0) > 0, 1.0), ("spacing_um", gaussian(2.0), "1.0")
    ):  # fmt: skip
        np.savez(tmp_path / "d.npz", psf=psf, spacing_um=spacing, wavelength_nm=550)
        refused("d.npz", place)
    np.savez(tmp_path / "d.npz", psf=np.zeros((1, 0, 0)), spacing_um=1.0, wavelength_nm=550)
    refused("d.npz", "psf")
    refused("a.npz", "spacing_um", spacing_um="1.0", wavelength_nm=550)
    np.savez(tmp_path / "e.npz", psf=gaussian(2.0) * 3)
    refused("e.npz", "samples", **options)
    (tmp_path / "f.txt").write_text("1 2 3\n4 5\n")
    refused("f.txt", "entries in this line", **options)
    tifffile.imwrite(tmp_path / "g.tif", np.zeros((8, 8, 3), np.uint8), photometric="rgb")
    refused("g.tif", "pages", **options)
    tifffile.imwrite(tmp_path / "h.tif", np.stack([gaussian(2.0)] * 3), photometric="minisblack")
    refused("h.tif", "samples", **options)
    with h5py.File(tmp_path / "i.h5", "w") as file:
        file.create_group("psf")
    refused("i.h5", "holds no data set 'psf', but psf", **options)
    refused("missing.npz", "no such file", **options)
    refused("a.mat", "suffix", **options)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".tif", ".txt"])
def test_damaged_psf_files_raise_file_errors_only(tmp_path: Path, suffix: str) -> None:
    good = tmp_path / f"good{suffix}"
    if suffix == ".npz":
        np.savez(good, psf=gaussian(2.0), spacing_um=1.0, wavelength_nm=550.0)
    elif suffix == ".h5":
        with h5py.File(good, "w") as file:
            file["psf"], file["spacing_um"], file["wavelength_nm"] = gaussian(2.0), 1.0, 550.0
    elif suffix == ".tif":
        tifffile.imwrite(good, gaussian(2.0))
    else:
        np.savetxt(good, gaussian(2.0))
    options: dict[str, Any] = {"spacing_um": 1.0, "wavelength_nm": 550.0}
    assert load_psf_table(good, **options).samples.shape == (1, 61, 61)
    data, rng = good.read_bytes(), np.random.default_rng(6)
    for trial in range(40):
        damaged = bytearray(data[: int(rng.integers(0, len(data)))] if trial % 2 else data)
        for place in rng.integers(0, max(len(damaged), 1), 12):
            if damaged:
                damaged[place] = int(rng.integers(0, 256))
        path = tmp_path / f"bad{suffix}"
        path.write_bytes(damaged)
        with contextlib.suppress(FileError):  # an error, or a valid table by chance
            load_psf_table(path, **options)


@pytest.mark.parametrize(
    "text",
    [
        "frequency_per_mm; 450; 650\n0; 1; 1\n40,5; 0,7; 0,6\n200; 0; 0\n",
        "frequency_per_mm;450;650\n0;1;1\n40.5;0.7;0.6\n200;0;0\n",
    ],
)
def test_semicolons_with_commas_or_points(text: str, tmp_path: Path) -> None:
    (tmp_path / "mtf.csv").write_text(text, encoding="utf-8")
    table = load_otf_table(tmp_path / "mtf.csv")
    np.testing.assert_array_equal(table.frequency_per_mm, [0, 40.5, 200])
    np.testing.assert_array_equal(table.values, [[1, 0.7, 0], [1, 0.6, 0]])


def test_ambiguous_decimal_commas_are_rejected(tmp_path: Path) -> None:
    (tmp_path / "mtf.csv").write_text("frequency_per_mm;450\n0;1\n40.5;0,7\n200;0\n", encoding="utf-8")
    with raises(FileError, "entry", line=3):
        load_otf_table(tmp_path / "mtf.csv")
