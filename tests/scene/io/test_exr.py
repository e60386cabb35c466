"""OpenEXR: channel names, units, round trips, and invalid files."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from raising import raises, warns
from scene_files import error_of, radiance

import photosite as ps
from photosite.color.spectrum import photons_from_energy
from photosite.errors import FileError, InputError
from photosite.scene.cube import Block
from photosite.scene.io import exr
from photosite.scene.io.exr import channel_name, spectral_channel
from photosite.scene.io.formats import open_cube, read_scene, write_scene
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import SceneCube

OpenEXR = pytest.importorskip("OpenEXR")

GRID = np.arange(400.0, 701.0, 50)
PER_NM = "W.m^-2.sr^-1.nm^-1"


def spectral(path: Path, values: np.ndarray, grid: np.ndarray = GRID, layer: str = "S0", **head: object) -> Path:
    """A file of (rows, cols, bands), as the layout's paper writes it."""
    channels = {
        f"{layer}.{wavelength:.6f}".replace(".", ",").replace(",", ".", 1) + "nm": np.ascontiguousarray(values[..., k])
        for k, wavelength in enumerate(grid)
    }
    OpenEXR.File({"type": OpenEXR.scanlineimage, **head}, channels).write(str(path))
    return path


def some_radiance(rows: int = 37, cols: int = 20) -> np.ndarray:
    """W/m2/sr/nm."""
    return np.random.default_rng(5).uniform(1e-3, 2e-3, (rows, cols, GRID.size)).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "kind", "wavelength_nm"),
    [
        ("S0.380,000000nm", "emissive", 380.0),
        ("S0.5,5e2nm", "emissive", 550.0),
        ("S0.0,55um", "emissive", 550.0),
        ("S0.545,077196363636THz", "emissive", 550.0),
        ("S3.550,0nm", "polarized", 550.0),
        ("M00.550,0nm", "reflective", 550.0),
        ("T.550,0nm", "reflective", 550.0),
        ("T.450,0nm.550,0nm", "reradiated", 450.0),
        ("420.00-430.00nm", "plain", 425.0),
        ("550nm", "plain", 550.0),
    ],
)
def test_names_of_channels(name: str, kind: str, wavelength_nm: float) -> None:
    channel = spectral_channel(name)
    assert channel is not None
    assert (channel.kind, channel.wavelength_nm) == (kind, pytest.approx(wavelength_nm, rel=1e-9))


@pytest.mark.parametrize("name", ["R", "A", "S4.500nm", "S0.nm", "S0.500.0nm.x.nmx", "depth.Z", "S0.0,0nm", "S0.500"])
def test_other_names_are_not_spectral(name: str) -> None:
    assert spectral_channel(name) is None


def test_name_written_is_name_read() -> None:
    channel = spectral_channel(channel_name(532.125))
    assert channel is not None
    assert (channel.wavelength_nm, channel.kind) == (532.125, "emissive")


def test_energy_radiance_becomes_photons(tmp_path: Path) -> None:
    energy = some_radiance()
    file = spectral(tmp_path / "render.exr", energy, emissiveUnits=PER_NM)
    scene = read_scene(file, tolerance=1e-6)
    assert_allclose(radiance(scene), photons_from_energy(energy, GRID), rtol=2e-5)
    assert (scene.name, scene.width_m) == ("render", None)


def test_prefix_of_the_units_counts(tmp_path: Path) -> None:
    energy = some_radiance()
    watts = read_scene(spectral(tmp_path / "a.exr", energy, emissiveUnits=PER_NM))
    milli = read_scene(spectral(tmp_path / "b.exr", energy, emissiveUnits=f"m{PER_NM}"))
    assert_allclose(radiance(milli) * 1000, radiance(watts), rtol=1e-5)


def test_bands_come_in_order_of_wavelength(tmp_path: Path) -> None:
    """OpenEXR sorts channels as text, 1000 before 400."""
    grid = np.array([400.0, 700.0, 1000.0])
    energy = np.stack([np.full((3, 4), value, np.float32) for value in (1, 2, 3)], axis=-1)
    scene = read_scene(spectral(tmp_path / "a.exr", energy, grid, emissiveUnits=PER_NM))
    assert scene.wavelength_nm.tolist() == grid.tolist()
    assert_allclose(scene.radiance(0, 0), photons_from_energy([1, 2, 3], grid), rtol=1e-5)


def test_blocks_of_any_size_are_read_alike(tmp_path: Path) -> None:
    """With a data window that does not begin at 0, compressed in blocks of 16 rows, tiles too."""
    energy = some_radiance()
    window = {"dataWindow": (np.array([5, 11], "i"), np.array([24, 47], "i"))}
    tile = OpenEXR.TileDescription()
    tile.xSize = tile.ySize = 16
    heads = [{}, window, {"type": OpenEXR.tiledimage, "tiles": tile}, {"compression": OpenEXR.NO_COMPRESSION}]
    for number, head in enumerate(heads):
        file = spectral(tmp_path / f"{number}.exr", energy, emissiveUnits=PER_NM, **head)
        cube = open_cube(file)
        assert cube.shape == energy.shape
        for rows in (1, 10, 100):
            blocks = list(cube.blocks(rows))
            assert [first for first, _ in blocks] == list(range(0, 37, rows))
            assert_allclose(np.concatenate([block for _, block in blocks]), energy, rtol=0)


def test_half_precision_and_a_part_that_is_not_the_first(tmp_path: Path) -> None:
    energy = some_radiance().astype(np.float16)
    names = [channel_name(wavelength) for wavelength in GRID]
    preview = {name: energy[..., 0].copy() for name in "RGB"}
    channels = {name: energy[..., k].copy() for k, name in enumerate(names)}
    parts = [
        OpenEXR.Part({"name": "preview"}, preview),
        OpenEXR.Part({"name": "spectra", "emissiveUnits": PER_NM}, channels),
    ]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    values = np.concatenate([block for _, block in open_cube(tmp_path / "a.exr").blocks(8)])
    assert_allclose(values, energy.astype(float), rtol=0)


def test_layout_of_pbrt(tmp_path: Path) -> None:
    """Names, units and picture as PBRT-v4's spectral film writes them (film.cpp): centers of 16 buckets, 3 decimals."""
    edges = np.linspace(360, 830, 17)
    names = [
        f"S0.{center:.3f}".replace(".", ",").replace(",", ".", 1) + "nm" for center in (edges[1:] + edges[:-1]) / 2
    ]
    rng = np.random.default_rng(1)
    channels = {name: rng.uniform(0.1, 1, (9, 12)).astype(np.float16) for name in names}
    head = {"spectralLayoutVersion": "1.0", "emissiveUnits": "W.m^-2.sr^-1"}
    picture = {name: np.ones((9, 12), np.float16) for name in "RGB"}
    OpenEXR.File(head, channels | picture).write(str(tmp_path / "a.exr"))
    with warns("units", arguments={"units": "W/m2/sr/nm"}):
        scene = read_scene(tmp_path / "a.exr", tolerance=1e-6)
    assert scene.wavelength_nm[0] == pytest.approx(374.688, abs=5e-4)
    expected = photons_from_energy(float(channels[names[3]][2, 5]), scene.wavelength_nm[3])
    assert scene.radiance(2, 5)[3] == pytest.approx(float(expected), rel=1e-4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        relative = read_scene(tmp_path / "a.exr", units="relative", mean_luminance_cd_m2=50)
    assert relative.mean_luminance_cd_m2() == pytest.approx(50, rel=2e-3)


def test_polarized_light_is_its_first_component(tmp_path: Path) -> None:
    energy = some_radiance()
    names = [f"S{s}.{w:.0f},0nm" for s in range(4) for w in GRID]
    planes = {name: energy[..., k % GRID.size] * (1 if k < GRID.size else -0.5) for k, name in enumerate(names)}
    OpenEXR.File({"emissiveUnits": PER_NM}, planes).write(str(tmp_path / "a.exr"))
    with warns("S"):
        scene = read_scene(tmp_path / "a.exr", tolerance=1e-6)
    assert_allclose(radiance(scene), photons_from_energy(energy, GRID), rtol=2e-5)


def test_reflectances_are_under_the_illuminant(tmp_path: Path) -> None:
    reflectance = np.random.default_rng(2).uniform(0.1, 0.9, (5, 6, GRID.size)).astype(np.float32)
    file = spectral(tmp_path / "a.exr", reflectance, layer="T")
    scene = read_scene(file, illuminant="D65", mean_luminance_cd_m2=80, tolerance=1e-6)
    assert scene.mean_luminance_cd_m2() == pytest.approx(80)
    assert scene.reflectance is not None
    lit = np.tensordot(scene.weights.astype(float), scene.reflectance, axes=(0, 0))
    assert_allclose(lit, reflectance, rtol=1e-4)


def test_radiance_and_reflectance_in_one_file(tmp_path: Path) -> None:
    values = some_radiance(4, 4)
    planes = {f"{layer}.{w:.0f},0nm": values[..., k] * (k + 1) for layer in ("S0", "T") for k, w in enumerate(GRID)}
    OpenEXR.File({"emissiveUnits": PER_NM}, planes).write(str(tmp_path / "a.exr"))
    with pytest.raises(FileError) as caught:
        read_scene(tmp_path / "a.exr")
    assert "units" in caught.value.arguments
    assert open_cube(tmp_path / "a.exr", units="W/m2/sr/nm").quantity == "energy radiance"
    assert open_cube(tmp_path / "a.exr", units="reflectance").quantity == "reflectance"


def test_wavelengths_of_the_caller(tmp_path: Path) -> None:
    """Channels of Mitsuba's spectral film have the names of the scene's bands."""
    planes = {f"band{k}": np.full((4, 5), k + 1, np.float32) for k in range(3)}
    OpenEXR.File({}, planes).write(str(tmp_path / "a.exr"))
    scene = read_scene(tmp_path / "a.exr", units="W/m2/sr/nm", wavelength_nm=[450, 550, 650])
    assert_allclose(scene.radiance(1, 1), photons_from_energy([1, 2, 3], [450, 550, 650]), rtol=1e-5)


@pytest.mark.parametrize(("half", "within"), [(False, 1e-6), (True, 5e-4)])
def test_round_trip(tmp_path: Path, half: bool, within: float) -> None:
    whole = ps.charts.macbeth("A", 40, distance_m=1.37, width_m=0.31)
    chart = replace(whole, weights=whole.weights[:, ::4, ::4], regions=())
    file = tmp_path / "chart.exr"
    write_scene(chart, file, half=half)
    values = np.concatenate([block for _, block in open_cube(file).blocks(50)])
    expected = radiance(chart)
    assert_allclose(photons_from_energy(values, chart.wavelength_nm), expected, rtol=within, atol=within * 1e-6)
    back = read_scene(file)
    error = np.sqrt(np.mean((radiance(back) - expected) ** 2) / np.mean(expected**2))
    assert error < 1.2e-3
    assert back.relative_error < 1e-3
    assert (back.distance_m, back.width_m, back.name) == (1.37, 0.31, chart.name)


@pytest.mark.parametrize("shape", [(300, 3), (6, 400)])
def test_rows_are_written_by_their_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shape: tuple[int, int]
) -> None:
    """Wide scenes some rows at a time, narrow ones many: at most the given bytes, or one row."""
    taken: list[int] = []
    blocks = SceneCube.blocks

    def watched(cube: SceneCube, rows: int) -> Iterator[Block]:
        for first, block in blocks(cube, rows):
            taken.append(block.nbytes)
            yield first, block

    monkeypatch.setattr(SceneCube, "blocks", watched)
    monkeypatch.setattr(exr, "_WRITE_BYTES", 40_000)
    weights = np.random.default_rng(3).random((1, *shape)).astype(np.float32)
    scene = Scene(weights, np.full((1, GRID.size), 1e15), GRID)
    write_scene(scene, tmp_path / "a.exr", half=True)
    row = 8 * shape[1] * GRID.size
    assert sum(taken) == 2 * row * shape[0]  # once for the brightest value
    assert max(taken) == min(max(40_000 // row, 1), shape[0]) * row
    assert_allclose(radiance(read_scene(tmp_path / "a.exr")), radiance(scene), rtol=1e-3)


def test_half_precision_takes_the_unit_that_holds_the_scene(tmp_path: Path) -> None:
    for factor, unit in ((1e19, f"m{PER_NM}"), (1e26, "too bright")):
        scene = Scene.uniform(np.full(GRID.size, factor), GRID)
        if unit == "too bright":
            with raises(InputError, "radiance"):
                write_scene(scene, tmp_path / "a.exr", half=True)
        else:
            write_scene(scene, tmp_path / "a.exr", half=True)
            assert OpenEXR.File(str(tmp_path / "a.exr")).header()["emissiveUnits"] == unit
            assert_allclose(read_scene(tmp_path / "a.exr").radiance(0, 0), factor, rtol=5e-4)


@pytest.mark.parametrize(
    ("head", "options", "about"),
    [
        ({}, {}, "units"),
        ({"emissiveUnits": "lx"}, {}, "units"),
        ({"emissiveUnits": PER_NM}, {"illuminant": "D65"}, ""),
        ({"emissiveUnits": PER_NM, "pixelAspectRatio": 2.0}, {}, "pixelAspectRatio"),
        ({"emissiveUnits": PER_NM}, {"wavelength_nm": [400, 500]}, "wavelength"),
    ],
)
def test_invalid_spectral_files(
    tmp_path: Path, head: dict[str, object], options: dict[str, object], about: str
) -> None:
    assert about in error_of(spectral(tmp_path / "a.exr", some_radiance(), **head), **options).what


@pytest.mark.parametrize(
    ("names", "options", "about"),
    [
        (["depth.Z", "N.X"], {}, "neither spectral channels"),
        ([f"AOV{k:02d}" for k in range(20)], {}, "and 12 more"),
        (["S1.500,0nm"], {}, "only polarized light"),
        (["T.500,0nm", "T.450,0nm.500,0nm"], {}, "re-radiation"),
        (["T.500,0nm"], {"units": "W/m2/sr/nm"}, "has reflectances"),
        (["T.500,0nm"], {}, "reflectances"),
        (["R", "G", "B"], {}, "luminance of white"),
        (["R", "G", "B"], {"units": "W/m2/sr/nm"}, ""),
        (["a", "b"], {"wavelength_nm": [500], "units": "relative"}, "1 wavelengths are given"),
    ],
)
def test_invalid_channels(tmp_path: Path, names: list[str], options: dict[str, object], about: str) -> None:
    file = tmp_path / "a.exr"
    OpenEXR.File({}, {name: np.ones((4, 5), np.float32) for name in names}).write(str(file))
    assert about in error_of(file, **options).what


@pytest.mark.parametrize(("keep", "parts"), [(6, 1), (40, 2), (300, 1), (0.3, 2), (0.9, 1), (0.9, 2)])
def test_truncated_file(tmp_path: Path, keep: float, parts: int, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.exr"
    noise = np.random.default_rng(0).random((64, 64)).astype(np.float32)
    planes = {channel_name(wavelength): noise for wavelength in GRID}
    wanted = OpenEXR.Part({"name": "spectra", "emissiveUnits": PER_NM}, planes)
    preview = OpenEXR.Part({"name": "preview"}, dict.fromkeys("RGB", noise))
    OpenEXR.File([wanted] if parts == 1 else [preview, wanted]).write(str(file))
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * keep) if keep < 1 else int(keep)])
    assert "truncated" in error_of(file).what
    assert capfd.readouterr() == ("", "")


def test_file_of_an_interrupted_writer(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The offsets of the last rows, which are written at the end, are 0."""
    file = spectral(tmp_path / "a.exr", some_radiance(), emissiveUnits=PER_NM)
    content = bytearray(file.read_bytes())
    chunks = 3  # 37 rows, 16 in each
    table = next(k for k in range(len(content)) if content[k : k + 8] == (k + 8 * chunks).to_bytes(8, "little"))
    content[table + 16 : table + 24] = bytes(8)
    file.write_bytes(content[: int.from_bytes(content[table + 8 : table + 16], "little")])
    assert "is truncated" in error_of(file).what
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("good", "bad"), [(b"S0.500", b"S0.\xff00"), (b"dataWindow\0box2i", b"dataWindow\0box2f")])
def test_damaged_head(tmp_path: Path, good: bytes, bad: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    file = spectral(tmp_path / "a.exr", some_radiance(), emissiveUnits=PER_NM)
    content = file.read_bytes()
    assert good in content
    file.write_bytes(content.replace(good, bad))
    error_of(file)
    assert capfd.readouterr() == ("", "")


def test_not_an_exr(tmp_path: Path) -> None:
    file = tmp_path / "a.exr"
    file.write_bytes(b"\x89PNG not an exr at all")
    assert error_of(file).what == "is not an OpenEXR file"


def test_missing_extra_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    file = spectral(tmp_path / "a.exr", some_radiance(2, 2))
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with raises(FileError, "is OpenEXR"):
        read_scene(file)


def test_a_write_that_fails_leaves_nothing(tmp_path: Path) -> None:
    with raises(FileError, "cannot be written"):
        write_scene(ps.charts.macbeth(), tmp_path / "nowhere" / "a.exr")
    assert list(tmp_path.iterdir()) == []
