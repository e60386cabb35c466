"""Radiance pictures: eight decades, units and exposure, colors, damaged files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scene_files import error_of

from photosite.color.colorimetry import luminance_cd_m2
from photosite.scene.io.formats import read_scene
from photosite.scene.pictures import from_hdr

RNG = np.random.default_rng(8)


def encoded(values: np.ndarray) -> np.ndarray:
    """(rows, cols, 4) mantissas and exponents, by G. Ward's setcolr."""
    brightest = values.max(axis=2)
    mantissa, exponent = np.frexp(brightest)
    scale = np.where(brightest > 1e-32, mantissa * 256 / np.where(brightest > 0, brightest, 1), 0)
    codes = np.zeros((*values.shape[:2], 4), np.uint8)
    codes[..., :3] = (values * scale[..., None]).astype(np.uint8)
    codes[..., 3] = np.where(brightest > 1e-32, exponent + 128, 0)
    return codes


def run_length(codes: np.ndarray) -> bytes:
    """Each row's four planes by runs of one value, and stretches of others."""
    out = bytearray()
    for row in codes:
        out += bytes([2, 2, len(row) >> 8, len(row) & 255])
        for plane in row.T:
            at = 0
            while at < len(plane):
                same = 1
                while at + same < len(plane) and same < 127 and plane[at + same] == plane[at]:
                    same += 1
                if same > 2:
                    out += bytes([128 + same, plane[at]])
                else:
                    out += bytes([same]) + plane[at : at + same].tobytes()
                at += same
    return bytes(out)


def hdr(path: Path, values: np.ndarray, head: str = "", *, runs: bool = True, magic: str = "#?RADIANCE") -> Path:
    rows, cols = values.shape[:2]
    codes = encoded(values)
    lines = f"{magic}\nFORMAT=32-bit_rle_rgbe\n{head}\n-Y {rows} +X {cols}\n"
    path.write_bytes(lines.encode() + (run_length(codes) if runs else codes.tobytes()))
    return path


def decades(rows: int = 11, cols: int = 30) -> np.ndarray:
    """(rows, cols, 3) colors over eight decades, with runs of one value."""
    values = 10.0 ** np.linspace(-4, 4, rows)[:, None, None] * RNG.uniform(0.2, 1.0, (rows, cols, 3))
    values[:, 5:20] = values[:, 5:6]
    return values


@pytest.mark.parametrize("runs", [True, False])
def test_radiance_files_keep_eight_decades(tmp_path: Path, runs: bool) -> None:
    """A mantissa of 8 bits: half a step of 1/128 to 1/256 of the pixel's brightest."""
    values = decades()
    scene = read_scene(hdr(tmp_path / "a.hdr", values, runs=runs), mean_luminance_cd_m2=100.0)
    wanted = from_hdr(values, mean_luminance_cd_m2=100.0)
    factor = scene.basis[0, 40] / wanted.basis[0, 40]
    off = np.abs(factor * np.moveaxis(scene.weights, 0, 2) - values) / values.max(axis=2, keepdims=True)
    assert off.max() < 1 / 256 + 2e-3
    assert scene.shape == (11, 30)
    assert scene.reflectance is None


def test_units_of_radiance_and_exposure(tmp_path: Path) -> None:
    """White of 1 W/sr/m2 is 179 cd/m2; EXPOSURE multiplies. 0.501953125 = 128.5 / 256 is the middle of a step."""
    white = np.full((2, 9, 3), 0.501953125)
    scene = read_scene(hdr(tmp_path / "a.hdr", white, "EXPOSURE=2\nEXPOSURE=2.0\n"), units="radiance")
    seen = float(luminance_cd_m2(scene.radiance(1, 4), scene.wavelength_nm))
    assert seen == pytest.approx(179 * 0.501953125 / 4, rel=1e-6)


def test_black_stays_black(tmp_path: Path) -> None:
    values = np.zeros((1, 8, 3))
    values[0, 3] = 2.0
    scene = read_scene(hdr(tmp_path / "a.hdr", values), mean_luminance_cd_m2=1.0)
    assert not scene.weights[:, 0, :3].any()


@pytest.mark.parametrize(
    ("head", "options", "about"),
    [
        ("", {}, "luminance"),
        ("", {"units": "W/sr/m2/nm"}, "units"),
        ("", {"units": "radiance", "mean_luminance_cd_m2": 1}, "units and mean_luminance_cd_m2"),
        ("EXPOSURE=0\n", {"mean_luminance_cd_m2": 1}, "EXPOSURE"),
        ("EXPOSURE=much\n", {"mean_luminance_cd_m2": 1}, "EXPOSURE"),
        ("PRIMARIES= 0.7 0.3 0.2 0.7 0.1 0.1 0.33 0.33\n", {"mean_luminance_cd_m2": 1}, "PRIMARIES"),
        ("FORMAT=other\n", {"mean_luminance_cd_m2": 1}, "FORMAT"),
        ("COLORCORR=1 2 3\n", {"mean_luminance_cd_m2": 1}, "COLORCORR"),
    ],
)
def test_unsupported_files(tmp_path: Path, head: str, options: dict[str, object], about: str) -> None:
    assert about in error_of(hdr(tmp_path / "a.hdr", decades(), head), **options).what


@pytest.mark.parametrize("runs", [True, False])
def test_damaged_files_are_an_error(tmp_path: Path, runs: bool) -> None:
    whole = hdr(tmp_path / "a.hdr", decades(), runs=runs).read_bytes()
    for count in (12, 30, 55, 80, len(whole) // 2, len(whole) - 3):
        (tmp_path / "a.hdr").write_bytes(whole[:count])
        assert "truncated" in error_of(tmp_path / "a.hdr", mean_luminance_cd_m2=1).what
    (tmp_path / "a.hdr").write_bytes(whole.replace(b"-Y 11 +X 30", b"+X 30 -Y 11"))
    assert "rotated" in error_of(tmp_path / "a.hdr", mean_luminance_cd_m2=1).what
    (tmp_path / "a.hdr").write_bytes(whole.replace(b"-Y 11 +X 30", b"-Y 16000 +X 16000"))
    assert "cannot hold" in error_of(tmp_path / "a.hdr", mean_luminance_cd_m2=1).what


def test_values_are_the_middle_of_their_step(tmp_path: Path) -> None:
    """Radiance's colr_color: (mantissa + 0.5) / 256 times 2 to the exponent, of the bytes themselves."""
    codes = RNG.integers(0, 256, (6, 20, 4)).astype(np.uint8)
    codes[..., 0] |= 128  # as writers normalize
    codes[..., 3] = RNG.integers(100, 156, (6, 20))
    codes[0, :5, 3] = codes[0, :5, :3] = 0
    path = tmp_path / "a.hdr"
    path.write_bytes(b"#?RADIANCE\n\n-Y 6 +X 20\n" + run_length(codes))
    scale = np.ldexp(1.0, codes[..., 3].astype(int) - 136) * (codes[..., 3] > 0)
    wanted = from_hdr((codes[..., :3] + 0.5) * scale[..., None], mean_luminance_cd_m2=10.0)
    np.testing.assert_array_equal(read_scene(path, mean_luminance_cd_m2=10.0).weights, wanted.weights)


def test_pictures_in_xyz(tmp_path: Path) -> None:
    """D65's white in XYZ is equal red, green and blue."""
    file = hdr(tmp_path / "a.hdr", np.full((1, 8, 3), [0.9505, 1.0, 1.0890]))
    file.write_bytes(file.read_bytes().replace(b"rgbe\n", b"xyze\n", 1))
    weights = read_scene(file, mean_luminance_cd_m2=1.0).weights[:, 0, 0]
    assert weights / weights.mean() == pytest.approx(np.ones(3), abs=1 / 64)  # the matrix triples a step of 1 / 256


def test_xyz_outside_srgb_is_an_error_or_set_to_zero(tmp_path: Path) -> None:
    """BT.2020's green, outside sRGB: by colour-science's matrix negative in red and blue."""
    import colour

    values = np.full((2, 8, 3), [0.9505, 1.0, 1.0890])
    values[1, 3] = 0.1446, 0.6780, 0.0281
    file = hdr(tmp_path / "a.hdr", values)
    file.write_bytes(file.read_bytes().replace(b"rgbe\n", b"xyze\n", 1))
    assert error_of(file, mean_luminance_cd_m2=1).arguments == {"negative": "zero"}
    red, green, blue = read_scene(file, mean_luminance_cd_m2=1, negative="zero").weights
    wanted = colour.XYZ_to_RGB(values[1, 3], "sRGB")[1]
    assert (red[1, 3], blue[1, 3]) == (0, 0)
    assert green[1, 3] / green[0, 0] == pytest.approx(wanted, rel=1 / 32)
