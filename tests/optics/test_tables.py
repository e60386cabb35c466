"""Tables of transfer functions and point spreads against closed forms, and files that are wrong."""

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

from photosite.errors import FileError, InputError
from photosite.optics.io.table_files import read_otf_table, read_psf_table
from photosite.optics.lens import DiffractionLimited
from photosite.optics.spread import PlaneSpread, RadialSpread
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


def test_a_radial_table_is_its_curve_between_entries_and_wavelengths() -> None:
    table = OtfTable([450.0, 650.0], PER_MM, [gaussian_mtf(3.0), gaussian_mtf(5.0)])
    spread = table.spread(LENS, 1.2)
    assert isinstance(spread, RadialSpread)
    f = np.linspace(0, 300, 777)
    blue, red = gaussian_mtf(3.0, f), gaussian_mtf(5.0, f)
    assert spread.otf(f * 1e3, 450.0) == pytest.approx(blue, abs=1e-3)
    assert spread.otf(f * 1e3, 500.0) == pytest.approx(0.75 * blue + 0.25 * red, abs=1e-3)
    assert spread.otf(f * 1e3, 900.0) == pytest.approx(red, abs=2e-3)
    assert spread.otf(np.array([3.1e5]), 500.0) == 0
    # 99.5 % of a Gaussian's light lies within sigma sqrt(2 ln 200).
    assert spread.reach_m(450.0) == pytest.approx(3e-6 * math.sqrt(2 * math.log(200)), rel=0.05)


def test_a_table_that_ends_early_goes_on_as_diffraction_where_told() -> None:
    f = np.array([0.0, 20.0, 40.0])
    values = 0.9 ** (f / 20) * LENS.otf(f * 1e3, 550.0, 1.2)
    with pytest.raises(InputError, match=r"ends while its modulation is still 0\.6.*diffraction"):
        OtfTable([550.0], f, [values])
    spread = OtfTable([550.0], f, [values], beyond="diffraction").spread(LENS, 1.2)
    beyond = np.array([50e3, 100e3, 200e3])
    assert spread.cutoff_per_m(550.0) == LENS.cutoff_per_m(550.0, 1.2)
    assert isinstance(spread, RadialSpread)
    assert spread.otf(beyond, 550.0) == pytest.approx(0.81 * LENS.otf(beyond, 550.0, 1.2), rel=1e-12)
    assert spread.otf(np.array([40e3]), 550.0) == pytest.approx(values[2], rel=1e-12)


@pytest.mark.parametrize("half", ["neither", "rows", "columns"])
def test_a_plane_table_keeps_its_phase(half: str) -> None:
    """A Gaussian wider along the columns than along the rows, 2 um down and 1 um left of its place."""
    whole = np.arange(-200.0, 201.0, 4.0)
    fy = whole[whole >= 0] if half == "rows" else whole
    fx = whole[whole >= 0] if half == "columns" else whole

    def exact(y: Array, x: Array) -> NDArray[np.complex128]:
        turn = np.exp(-2j * math.pi * (y * 2e-3 + x * -1e-3))
        return turn * np.exp(-2 * math.pi**2 * ((y * 3e-3) ** 2 + (x * 4e-3) ** 2))

    table = OtfTable([550.0], fy, exact(fy[:, None], fx)[None], fx_per_mm=fx)
    spread = table.spread(LENS, 1.2)
    assert isinstance(spread, PlaneSpread)
    y, x = np.random.default_rng(1).uniform(-199, 199, (2, 500))
    assert np.abs(spread.otf(y * 1e3, x * 1e3, 550.0) - exact(y, x)).max() < 1e-4
    assert spread.otf(np.array([2.1e5]), np.array([0.0]), 550.0) == 0
    assert 10e-6 < spread.reach_m(550.0) < 4e-6 * math.sqrt(2 * math.log(200)) + 2.3e-6


@pytest.mark.parametrize("count", [60, 61])
def test_samples_of_a_gaussian_have_its_transfer_function(count: int) -> None:
    samples = np.stack([gaussian(2.0, 1.0, count), gaussian(3.0, 1.0, count, (1.25, -0.5))])
    spread = PsfTable([450.0, 650.0], samples, 1.0).spread(LENS, 1.2)
    fy, fx = np.random.default_rng(2).uniform(-150e3, 150e3, (2, 300))
    square = (fy**2 + fx**2) * 1e-12
    blue = np.exp(-2 * math.pi**2 * square * 4)
    red = np.exp(-2 * math.pi**2 * square * 9 - 2j * math.pi * (fy * 1.25e-6 - fx * 0.5e-6))
    # The band-limited function through the samples: their Fourier sum, which adds the Gaussian's own beyond the limit.
    assert np.abs(spread.otf(fy, fx, 450.0) - blue).max() < 1e-5
    assert np.abs(spread.otf(fy, fx, 550.0) - (blue + red) / 2).max() < 1e-5
    assert spread.otf(np.zeros(1), np.zeros(1), 500.0)[0] == pytest.approx(1, abs=1e-12)
    assert spread.reach_m(300.0) == pytest.approx(2e-6 * math.sqrt(2 * math.log(200)), abs=0.6e-6)
    column, row = np.linspace(-4e5, 4e5, 7)[:, None], np.linspace(-4e5, 4e5, 9)[None]
    both = np.broadcast_arrays(column, row)
    assert np.abs(spread.otf(column, row, 450.0) - spread.otf(*both, 450.0)).max() < 1e-14


def test_a_wavefront_sampled_is_the_wavefront_again() -> None:
    """Coma's point spread, at a third of its period: both blurs say the same."""
    wave = Wavefront({7: 60.0, 6: 30.0}).spread(LENS, math.inf)
    assert isinstance(wave, PlaneSpread)
    period_m, count = 550e-9 * 8, 257
    spacing = period_m / 3
    f = np.fft.fftfreq(count, spacing)
    image = np.fft.fftshift(np.fft.ifft2(wave.otf(f[:, None], f[None], 550.0)).real)
    table = PsfTable([550.0], [image], spacing * 1e6).spread(LENS, 1.2)
    fy, fx = (f[np.random.default_rng(k).integers(0, count, 200)] for k in (1, 2))
    assert np.abs(table.otf(fy, fx, 550.0) - wave.otf(fy, fx, 550.0)).max() < 1e-10


GOOD: dict[str, Any] = {"wavelength_nm": [450.0, 650.0], "frequency_per_mm": PER_MM}
VALUES = np.stack([gaussian_mtf(3.0), gaussian_mtf(5.0)])
AXIS = np.arange(-200.0, 201.0, 10.0)
PLANE = np.exp(-(AXIS[:, None] ** 2 + AXIS**2) / 2 / 60**2).astype(complex)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wavelength_nm": [650.0, 450.0]}, "must increase"),
        ({"wavelength_nm": [0.45, 0.65]}, "multiply by 1000"),
        ({"values": VALUES * 100}, "never above 1.*divide it by 100"),
        ({"values": VALUES * 0.9}, "is 1 at frequency 0"),
        ({"values": VALUES[:1]}, r"\(wavelengths, frequencies\), \(2, 61\) here"),
        ({"values": np.where(VALUES < 0.5, np.nan, VALUES)}, "NaN"),
        ({"frequency_per_mm": PER_MM[::-1]}, "increasing; sort the table"),
        ({"frequency_per_mm": PER_MM + 5}, "begin at 0"),
        ({"values": VALUES**0.1, "frequency_per_mm": PER_MM / 4}, "ends while its modulation"),
        ({"beyond": "nothing"}, "'zero', or for radial ones 'diffraction'"),
        ({"wavelength_nm": [550.0], "frequency_per_mm": AXIS, "fx_per_mm": AXIS + 5, "values": [PLANE]}, "frequency 0"),
        (
            {
                "wavelength_nm": [550.0],
                "frequency_per_mm": AXIS,
                "fx_per_mm": AXIS,
                "values": [PLANE + 5e-3j * AXIS**2 / 4e4],
            },
            "conjugates",
        ),
        (
            {
                "wavelength_nm": [550.0],
                "frequency_per_mm": AXIS[20:],
                "fx_per_mm": AXIS[20:],
                "values": [PLANE[20:, 20:]],
            },
            "nothing of a quarter",
        ),
    ],
)
def test_transfer_functions_that_cannot_be(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        OtfTable(**{**GOOD, "values": VALUES, **change})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"samples": [gaussian(2.0) * 1.002]}, "sums to 1.002, not to 1.*normalise=True"),
        ({"samples": [gaussian(2.0)[:, :-1]]}, "square"),
        ({"samples": [gaussian(2.0) - 1e-4]}, "negative somewhere"),
        ({"samples": [np.full((9, 9), np.nan)]}, "NaN"),
        ({"samples": [np.zeros((9, 9))]}, "holds no light: its samples sum to 0, the largest is 0; check"),
        ({"samples": [-gaussian(2.0)], "normalise": True}, "holds no light: its samples sum to -1"),
        ({"spacing_um": 5e-7}, "5e-07 um apart .* in um: if that is in m, multiply by 1e6"),
        ({"wavelength_nm": [0.55]}, "0.55 nm .* in um, multiply by 1000"),
        ({"samples": [gaussian(0.4) / gaussian(0.4).sum()]}, "too coarse"),
        ({"spacing_um": None}, "spacing_um.*must be above 0"),
        ({"spacing_um": -1.0}, "must be above 0"),
        ({"wavelength_nm": [550.0, 450.0], "samples": [gaussian(2.0)] * 2}, "must increase"),
    ],
)
def test_point_spreads_that_cannot_be(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        PsfTable(**{"wavelength_nm": [550.0], "samples": [gaussian(2.0)], "spacing_um": 1.0, **change})
    assert "\n" not in str(caught.value)


def test_normalise_divides_by_the_sum() -> None:
    table = PsfTable([550.0], [gaussian(2.0) * 40], 1.0, normalise=True)
    assert table.samples.sum() == pytest.approx(1, abs=1e-12)


def test_mtf_from_a_file_with_comments(tmp_path: Path) -> None:
    path = tmp_path / "mtf.csv"
    rows = "\n".join(f"{f:g},{a:.6f},{b:.6f}" for f, a, b in zip(PER_MM, *VALUES, strict=True))
    path.write_text(f"# bench 3\nfrequency_per_mm,450nm, 650\n{rows}\n")
    table = read_otf_table(path)
    assert table.wavelength_nm.tolist() == [450, 650]
    assert table.values == pytest.approx(VALUES, abs=1e-6)


def test_a_plane_table_from_a_file_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "otf.csv"
    tilted = PLANE * np.exp(-2j * math.pi * AXIS * 1e-3)  # 1 um to the right
    lines = [
        f"{tilted[i, j].real:.8f},{tilted[i, j].imag:.8f},{x},{y},550"
        for i, y in enumerate(AXIS)
        for j, x in enumerate(AXIS)
    ]
    np.random.default_rng(1).shuffle(lines)
    path.write_text("real,imag,fx_per_mm,fy_per_mm,wavelength_nm\n" + "\n".join(lines))
    table = read_otf_table(path)
    assert np.abs(table.values[0] - tilted).max() < 1e-7
    path.write_text("real,imag,fx_per_mm,fy_per_mm,wavelength_nm\n" + "\n".join(lines[1:]))
    with pytest.raises(FileError, match="1680 entries are no full grid of 1 x 41 x 41"):
        read_otf_table(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("a,b\n1,2\n", "otf.csv:1: the first line names the columns"),
        ("frequency_per_mm,blue\n0,1\n", "otf.csv:1: 'blue' is not a wavelength in nm"),
        ("frequency_per_mm,450\n0,1\n10,half\n", "otf.csv:3: 'half' is not a number"),
        ("frequency_per_mm,450\n0,1\n10,nan\n", "otf.csv:3: 'nan' is not a finite number"),
        ("frequency_per_mm,450\n0,1\n10\n", "otf.csv:3: has 1 entries where 2 are expected"),
        ("frequency_per_mm,450\n0,1\n50,0.3\n40,0\n", "increasing; sort the table"),
        ("frequency_per_mm,650,450\n0,1,1\n50,0,0\n", "must increase"),
        ("frequency_per_mm,450\n", "2 or more finite frequencies"),
        ("frequency_per_mm\n0\n1\n", "wavelengths are a list"),
    ],
)
def test_wrong_files_of_transfer_functions(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "otf.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=message) as caught:
        read_otf_table(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(FileError, match="cannot be read"):
        read_otf_table(tmp_path / "missing.csv")


def test_point_spreads_from_every_kind_of_file(tmp_path: Path) -> None:
    stack = np.stack([gaussian(2.0), gaussian(3.0)])
    np.savez(tmp_path / "a.npz", psf=stack, spacing_um=1.0, wavelength_nm=[450.0, 650.0])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["psf"] = stack
        file["psf"].attrs["spacing_um"] = 1.0
        file["wavelength_nm"] = [450.0, 650.0]
    tifffile.imwrite(tmp_path / "a.tif", stack, photometric="minisblack")
    np.savetxt(tmp_path / "a.txt", stack[0])
    np.savetxt(tmp_path / "a.csv", stack[0], delimiter=",")
    said = {"spacing_um": 1.0, "wavelength_nm": [450.0, 650.0]}
    for name, options in {"a.npz": {}, "a.h5": {"spacing_um": 1.0}, "a.tif": said}.items():
        table = read_psf_table(tmp_path / name, **options)
        assert table.samples == pytest.approx(stack / stack.sum(axis=(1, 2), keepdims=True), abs=1e-15)
        assert table.wavelength_nm.tolist() == [450, 650]
    for name in ("a.txt", "a.csv"):
        table = read_psf_table(tmp_path / name, spacing_um=1.0, wavelength_nm=550)
        assert table.samples[0] == pytest.approx(stack[0] / stack[0].sum(), abs=1e-15)


def test_wrong_files_of_point_spreads(tmp_path: Path) -> None:
    said = {"spacing_um": 1.0, "wavelength_nm": 550}

    def refused(name: str, message: str, **options: Any) -> None:
        with pytest.raises(FileError, match=message) as caught:
            read_psf_table(tmp_path / name, **options)
        assert "\n" not in str(caught.value)

    np.savez(tmp_path / "a.npz", psf=gaussian(2.0))
    refused("a.npz", "does not say its spacing_um; give spacing_um=")
    refused("a.npz", "does not say its wavelength_nm; give wavelength_nm=", spacing_um=1.0)
    np.savez(tmp_path / "b.npz", psf=gaussian(2.0), spacing_um=2.0, wavelength_nm=550.0)
    refused("b.npz", r"the file says spacing_um \[2.0\], the call \[1.0\]", spacing_um=1.0)
    np.savez(tmp_path / "c.npz", image=gaussian(2.0))
    refused("c.npz", "no array 'psf', but image", **said)
    np.savez(tmp_path / "d.npz", psf=np.array([{}], dtype=object), spacing_um=1.0)
    refused("d.npz", "cannot be read: it is no .npz archive of numbers, or damaged$")
    for place, psf, spacing in (
        ("psf", gaussian(2.0) * 1j, 1.0), ("psf", gaussian(2.0) > 0, 1.0), ("spacing_um", gaussian(2.0), "1.0")
    ):  # fmt: skip
        np.savez(tmp_path / "d.npz", psf=psf, spacing_um=spacing, wavelength_nm=550)
        refused("d.npz", f"'{place}' holds no real numbers")
    np.savez(tmp_path / "d.npz", psf=np.zeros((1, 0, 0)), spacing_um=1.0, wavelength_nm=550)
    refused("d.npz", "'psf' is empty")
    refused("a.npz", "spacing_um is a list of numbers, not '1.0'", spacing_um="1.0", wavelength_nm=550)
    np.savez(tmp_path / "e.npz", psf=gaussian(2.0) * 3)
    refused("e.npz", "sums to 3, not to 1", **said)
    (tmp_path / "f.txt").write_text("1 2 3\n4 5\n")
    refused("f.txt", "f.txt:2: has 2 entries where 3", **said)
    tifffile.imwrite(tmp_path / "g.tif", np.zeros((8, 8, 3), np.uint8), photometric="rgb")
    refused("g.tif", "grey and of one size", **said)
    tifffile.imwrite(tmp_path / "h.tif", np.stack([gaussian(2.0)] * 3), photometric="minisblack")
    refused("h.tif", "with 1 wavelengths here", **said)
    with h5py.File(tmp_path / "i.h5", "w") as file:
        file.create_group("psf")
    refused("i.h5", "no data set 'psf', but psf", **said)
    refused("missing.npz", "no such file", **said)
    refused("a.mat", "not from '.mat'", **said)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".tif", ".txt"])
def test_damaged_files_of_point_spreads_are_one_line(tmp_path: Path, suffix: str) -> None:
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
    assert read_psf_table(good, **options).samples.shape == (1, 61, 61)
    data, rng = good.read_bytes(), np.random.default_rng(6)
    for trial in range(40):
        damaged = bytearray(data[: int(rng.integers(0, len(data)))] if trial % 2 else data)
        for place in rng.integers(0, max(len(damaged), 1), 12):
            if damaged:
                damaged[place] = int(rng.integers(0, 256))
        path = tmp_path / f"bad{suffix}"
        path.write_bytes(damaged)
        with contextlib.suppress(FileError):  # one error line, or a table after all
            read_psf_table(path, **options)


@pytest.mark.parametrize(
    "text",
    [
        "frequency_per_mm; 450; 650\n0; 1; 1\n40,5; 0,7; 0,6\n200; 0; 0\n",
        "frequency_per_mm;450;650\n0;1;1\n40.5;0.7;0.6\n200;0;0\n",
    ],
)
def test_semicolons_with_commas_or_points(text: str, tmp_path: Path) -> None:
    (tmp_path / "mtf.csv").write_text(text, encoding="utf-8")
    table = read_otf_table(tmp_path / "mtf.csv")
    np.testing.assert_array_equal(table.frequency_per_mm, [0, 40.5, 200])
    np.testing.assert_array_equal(table.values, [[1, 0.7, 0], [1, 0.6, 0]])


def test_commas_among_points_are_not_guessed_at(tmp_path: Path) -> None:
    (tmp_path / "mtf.csv").write_text("frequency_per_mm;450\n0;1\n40.5;0,7\n200;0\n", encoding="utf-8")
    with pytest.raises(FileError, match=r"mtf\.csv:3: '0,7' is not a number"):
        read_otf_table(tmp_path / "mtf.csv")
