"""Targets of the fuzzing: readers, valid files of every format, ways to damage them, and the accepted outcomes.

Reading a damaged file gives a valid result or a photosite error of one line; never another exception, and never a
number that is not finite. `run.py` watches for hangs, crashes and large allocations.
"""

from __future__ import annotations

import copy
import json
import math
import os
import random
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_seeds import seeds_of

from photosite.errors import InputError, PhotositeError
from photosite.files.child import call_in_child
from photosite.frames.raw_frame import RawFrame

INTEGERS = (0, 1, 2, 3, 7, 8, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000)
INTEGERS += (0xFFFFFFFF, 1 << 32, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)
_PLAIN = """0 -0 -1 1e999 -1e999 1e-400 nan .nan inf .inf -.inf null ~ true false yes 1/0 0/0 1/3 1/1e9 1e999999999
0x10 0o7 1_000 1:30 2001-01-01 [] {} [[]] {a: [{}]} ! !!int !!binary !!set !!timestamp !!omap &a *a <<: | > - -- --- ...
# : , ' " % @ ` ../.. / . .. * ** ?["""
WORDS = (*_PLAIN.split(), "\\", "\0", "\ufeff", "é", "\U0001d11e", "\t", "\n", "%s{0}")
WORDS += ("9" * 400, "x" * 5000, "[" * 300, " " * 300, "1" + "0" * 5000, "1e" + "9" * 30)
_DEEPEST = 12


@dataclass(frozen=True)
class Target:
    """A reader with valid files for it.

    Parameters
    ----------
    suffix
        Suffix of the damaged file.
    seeds
        Contents of valid files.
    read
        Called with the damaged file's path; returns the result.
    text
        Whether the format is text, so that words are damaged too.
    tree
        Whether the format is YAML or JSON, so that its values are replaced too.
    draw
        Makes a whole input, instead of damage to a valid one.
    """

    suffix: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]
    text: bool = False
    tree: bool = False
    draw: Callable[[random.Random], bytes] | None = None

    def hostile(self, rng: random.Random) -> bytes:
        """Return an input: drawn, or a valid file with damage or other values."""
        if self.draw is not None:
            return self.draw(rng)
        seed = rng.choice(self.seeds)
        if self.tree and rng.random() < 0.5:
            return regrown(seed, rng)
        return damaged(seed, rng, text=self.text)


_VALUES: tuple[object, ...] = (
    *(0, -1, 1, 2, 65_536, 10**30, -(10**30), 1e300, -1e300, 5e-324, 1e-40, 1e40, 0.5, math.inf, -math.inf, math.nan),
    *(
        None,
        True,
        False,
        "",
        "x",
        "1/3",
        "1e9",
        "0x10",
        "nan",
        "../../etc/passwd",
        "/dev/zero",
        "a\0b",
        "\x1b[31m",
        "é",
    ),
    *([], {}, [[]], [None], [0.0] * 300, {"value": 1, "standard_uncertainty": 1e300}, {"value": None}),
)
"""Values of any type, magnitude and kind; many are valid in one field and invalid in others."""


def regrown(content: bytes, rng: random.Random) -> bytes:
    """Return a YAML or JSON document with one to four of its values or keys replaced, removed, repeated or moved."""
    from ruamel.yaml import YAML

    tree = json.loads(json.dumps(YAML(typ="safe").load(content.decode()), default=str))
    places: list[tuple[Any, Any]] = []

    def collect(node: Any) -> None:
        for key in node if isinstance(node, dict) else range(len(node)):
            places.append((node, key))
            if isinstance(node[key], dict | list):
                collect(node[key])

    collect(tree)
    for _ in range(min(1 + int(rng.expovariate(1.0)), 4)):
        node, key = rng.choice(places)
        value = copy.deepcopy(rng.choice(_VALUES))
        if key not in node if isinstance(node, dict) else not 0 <= key < len(node):
            continue  # removed before
        match rng.randrange(8):
            case 0:
                del node[key]
            case 1 if isinstance(node, dict):
                node[str(rng.choice(WORDS))[:50]] = node.pop(key)
            case 2:
                other, place = rng.choice(places)
                if place in other if isinstance(other, dict) else 0 <= place < len(other):
                    node[key] = copy.deepcopy(other[place])
            case 3 if isinstance(node, list):
                node.insert(key, value)
            case 4 if isinstance(node[key], int | float) and not isinstance(node[key], bool):
                node[key] *= rng.choice((-1, 0, 1e-30, 1e-6, 1e3, 1e6, 1e30, 1e200))
            case _:
                node[key] = value
    return json.dumps(tree).replace("Infinity", ".inf").replace("NaN", ".nan").encode("utf-8", "surrogatepass")


def damaged(content: bytes, rng: random.Random, *, text: bool) -> bytes:
    """Return the content with one to eight errors."""
    data = bytearray(content)
    for _ in range(min(1 + int(rng.expovariate(0.7)), 8)):
        if text and rng.random() < 0.75:
            data = bytearray(_damaged_words(bytes(data), rng))
        else:
            _damaged_bytes(data, rng)
    if data.startswith(b"\x89PNG") and rng.random() < 0.8:
        return _checked_png(bytes(data))
    return bytes(data)


def _checked_png(data: bytes) -> bytes:
    """Return the PNG with correct checksums of its chunks; otherwise these alone would reject all damage."""
    out, at = bytearray(data[:8]), 8
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        body = data[at + 4 : at + 8 + length]
        out += data[at : at + 4] + body + zlib.crc32(body).to_bytes(4, "big")
        at += 12 + length
    return bytes(out + data[at:])


def _damaged_bytes(data: bytearray, rng: random.Random) -> None:
    size = len(data)
    # Half of all damage goes to the headers, which matter most.
    near = min(size, 2048) if rng.random() < 0.5 else size
    at = rng.randrange(near) if near else 0
    match rng.randrange(8):
        case 0 if size:
            data[at] ^= 1 << rng.randrange(8)
        case 1 if size:
            data[at] = rng.choice((0, 1, 0x7F, 0x80, 0xFE, 0xFF, rng.randrange(256)))
        case 2 | 3:
            width = rng.choice((1, 2, 4, 8))
            value = rng.choice(INTEGERS) if rng.random() < 0.8 else rng.getrandbits(64)
            order = rng.choice(("little", "big"))
            data[at : at + width] = (value % (1 << (8 * width))).to_bytes(width, order)
        case 4:
            del data[at:]
        case 5:
            del data[at : at + rng.choice((1, 2, 4, 12, 100))]
        case 6:
            data[at:at] = rng.randbytes(rng.choice((1, 2, 4, 16)))
        case _:
            other = rng.randrange(size + 1)
            length = rng.choice((1, 4, 12, 64))
            data[at : at + length] = data[other : other + length]


def _damaged_words(data: bytes, rng: random.Random) -> bytes:
    text = data.decode("utf-8", "surrogateescape")
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    match rng.randrange(6):
        case 0:
            del lines[at]
        case 1:
            lines.insert(rng.randrange(len(lines) + 1), lines[at])
        case 2:
            lines[at] = rng.choice(("", " ", "  ", "- ", "\t")) + lines[at].lstrip()
        case 3:
            other = rng.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        case _:
            words = lines[at].split(" ")
            words[rng.randrange(len(words))] = rng.choice(WORDS)
            lines[at] = " ".join(words)
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def start_child() -> None:
    """Start the child process of some readers if the last input ended it, so that its start is not timed."""
    call_in_child(os.getpid, time_s=120.0, memory_bytes=1 << 30)


def outcome(target: Target, path: Path) -> str:
    """Read the file and return "read" or "refused".

    Raises
    ------
    AssertionError
        If the result is invalid, or the error is empty or too long.
    Exception
        Any other exception of the reader.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = target.read(path)
        except PhotositeError as error:
            message = str(error)
            assert message.strip(), "an error without words"
            assert len(message) < 20_000, f"an error of {len(message)} letters"
            return "refused"
    check(found)
    return "read"


def check(found: object, depth: int = 0) -> None:
    """Check that every number of a result is finite, and that a frame is consistent."""
    if isinstance(found, RawFrame):
        assert found.dn.dtype == np.uint16
        assert found.dn.ndim == 2
        assert found.dn.size > 0
        assert 0 <= found.black_level_dn < found.white_level_dn < 1 << 16
        assert found.exposure_s is None or 0 <= found.exposure_s < math.inf
        for table in (found.color_matrix, found.noise_profile):
            assert table is None or np.isfinite(table).all()
        return
    if depth > _DEEPEST:
        return
    if isinstance(found, bool | str | bytes | None | Path) or callable(found):
        return
    if isinstance(found, int | float):
        assert math.isfinite(found), f"a result holds {found}"
    elif isinstance(found, np.ndarray):
        assert found.dtype.kind != "f" or np.isfinite(found).all(), "a result's array is not finite"
    elif isinstance(found, dict):
        for value in found.values():
            check(value, depth + 1)
    elif isinstance(found, list | tuple):
        for value in found[:1000]:
            check(value, depth + 1)
    elif is_dataclass(found):
        for entry in fields(found):
            check(getattr(found, entry.name), depth + 1)


def targets(folder: Path) -> dict[str, Target]:
    """Return all readers by name; frames that protocols and descriptors refer to are written to the folder."""
    from photosite.calibration.spectral.protocol import open_spectral
    from photosite.camera.file import load_camera
    from photosite.color.spectrum import load_spectrum
    from photosite.frames.io.darktable import read_darktable
    from photosite.frames.io.formats import read_frame, read_headers, read_raw
    from photosite.frames.io.libcamera import read_libcamera
    from photosite.frames.linearization import read_linearization
    from photosite.frames.open import open_frames
    from photosite.library.entry import index_file
    from photosite.library.sources import find_cameras
    from photosite.library.spectra import csv_camera
    from photosite.optics.io.formats import load_psf_table
    from photosite.optics.io.tables import load_otf_table
    from photosite.sensor.io.camera_maps import read_camera_maps
    from photosite.sensor.io.sensor_file import load_sensor, read_maps
    from photosite.studies.chart_spectral import read_chart
    from photosite.studies.sweep_file import load_sweep
    from photosite.training.light import Electrons

    seeds = seeds_of(folder)

    def frame(path: Path) -> object:
        headers = read_headers(path)
        first = headers[0].location if len(headers) > 1 else None
        return [read_frame(path, None, None, first)[0], [dict(header.metadata) for header in headers[:4]]]

    def frames(path: Path) -> object:
        found = open_frames(path)
        return [group.frames[0].read().dtype.name for group in found.groups], [
            (group.exposure_s, group.photons_per_pixel, group.gain_setting, group.temperature_c)
            for group in found.groups
        ]

    def sensor(path: Path) -> object:
        return load_sensor(path).model_dump()

    def spectral(path: Path) -> object:
        return [(band.exposure_s, band.photons_m2(), band.passband.centre_nm) for band in open_spectral(path).bands]

    def scene(path: Path) -> object:
        from photosite.scene.io.formats import read_scene

        if path.suffix == ".hdr":  # the numbers beside the header
            path.with_suffix(".img").write_bytes(seeds["envi numbers"][0])
        return read_scene(path)

    def lens(path: Path) -> object:
        from photosite.optics.io.formats import load_optics

        return load_optics(path)

    def optics(path: Path) -> object:
        from photosite.optics.lens import Lens

        found = lens(path)  # its focus may be at infinity
        return [getattr(found, f.name) for f in fields(Lens) if f.name != "focus_distance_m" and hasattr(found, f.name)]

    def design(path: Path) -> object:
        from photosite.optics.io.tables import read_design

        return read_design(path)

    def pupil(path: Path) -> object:
        from photosite.optics.io.tables import read_amplitude

        return read_amplitude(path)

    def psf(path: Path) -> object:
        from photosite.optics.io.zemax import read_psf

        return read_psf(path)

    def distortion(path: Path) -> object:
        from photosite.optics.io.zemax import read_distortion

        return read_distortion(path)

    def heights(path: Path) -> object:  # the table of real heights beside the parameters
        from photosite.optics.io.iset import read_ray_trace

        folder = path.parent / "heights"
        folder.mkdir(exist_ok=True)
        (folder / "ISETPARMS.txt").write_bytes(seeds["ray trace"][0])
        (folder / "A_DI_.dat").write_bytes(path.read_bytes())
        return read_ray_trace(folder).distortion()

    def camera(path: Path) -> object:
        found = load_camera(path)
        return found.exposure_s, found.camera.cells_per_pixel, found.seen.__class__.__name__

    def sweep(path: Path) -> object:
        return dict(load_sweep(path).values)

    def linearization(path: Path) -> object:
        return read_linearization(path).values

    def psf_pages(path: Path) -> object:
        return load_psf_table(path, spacing_um=0.5, wavelength_nm=[450.0, 650.0])

    def electrons(path: Path) -> object:
        return Electrons([path]).shape

    def headerless(path: Path) -> object:
        return read_raw(path, layout="16x12,packed=mipi12").dn

    def camera_maps(path: Path) -> object:
        return read_camera_maps([path]).chip()

    files = folder / "files"
    grammar: list[Any] = []

    def draw_command(rng: random.Random) -> bytes:
        from command_lines import Grammar

        if not grammar:
            grammar.append(Grammar(files))
        return json.dumps(grammar[0].draw(rng)).encode()

    def command(path: Path) -> object:
        import command_lines

        if command_lines.outcome(json.loads(path.read_text()), files) == "refused":
            raise InputError("refused")
        return None

    def chart(path: Path) -> object:
        from photosite.scene.io.formats import read_scene

        return read_scene(path, illuminant="D65", mean_luminance_cd_m2=100.0)

    return {
        "scene": Target(".h5", seeds["scene"], scene),
        "cube": Target(".h5", seeds["cube"], scene),
        "mat73": Target(".mat", seeds["mat73"], scene),
        "mat5": Target(".mat", seeds["mat5"], scene),
        "radiance": Target(".pic", seeds["radiance"], chart),
        "lzw": Target(".tif", seeds["lzw"], frame),
        "stack": Target(".tif", seeds["stack"], scene),
        "envi": Target(".hdr", seeds["envi"], scene, text=True),
        "exr": Target(".exr", seeds["exr"], scene),
        "cgats": Target(".cgats", seeds["cgats"], chart, text=True),
        "cxf": Target(".cxf", seeds["cxf"], chart, text=True),
        "patches": Target(".csv", seeds["patches"], chart, text=True),
        "optics": Target(".yaml", seeds["optics"], optics, text=True, tree=True),
        "design": Target(".npz", seeds["design"], design),
        "pupil": Target(".npz", seeds["pupil"], pupil),
        "ray trace": Target(".txt", seeds["ray trace"], lens, text=True),
        "heights": Target(".dat", seeds["heights"], heights, text=True),
        "psf": Target(".txt", seeds["psf"], psf, text=True),
        "distortion": Target(".txt", seeds["distortion"], distortion, text=True),
        "tiff": Target(".tif", seeds["tiff"], frame),
        "dng": Target(".dng", seeds["dng"], frame),
        "libraw": Target(".nef", seeds["dng"], frame),
        "png": Target(".png", seeds["png"], frame),
        "picture": Target(".png", seeds["picture"], chart),
        "hdf5": Target(".h5", seeds["hdf5"], frame),
        "fits": Target(".fits", seeds["fits"], frame),
        "fits gz": Target(".fits.gz", seeds["fits gz"], frame),
        "fits amplifiers": Target(".fits", seeds["fits amplifiers"], frame),
        "raw": Target(".raw", seeds["raw"], headerless),
        **{
            name: Target(f".{name.rpartition(' ')[2]}", seeds[name], camera_maps)
            for name in ("camera maps mat", "camera maps calb", "camera maps tif", "camera maps npy")
        },
        "maps": Target(".h5", seeds["maps"], read_maps),
        "descriptor": Target(".txt", seeds["descriptor"], frames, text=True),
        "protocol": Target(".yaml", seeds["protocol"], frames, text=True, tree=True),
        "sensor": Target(".yaml", seeds["sensor"], sensor, text=True, tree=True),
        "spectral": Target(".yaml", seeds["spectral"], spectral, text=True, tree=True),
        "chart": Target(".yaml", seeds["chart"], lambda path: read_chart(path)[0].electrons, text=True, tree=True),
        "spectrum": Target(".csv", seeds["spectrum"], load_spectrum, text=True),
        "darktable": Target(".json", seeds["darktable"], lambda path: read_darktable(path, None), text=True, tree=True),
        "libcamera": Target(".json", seeds["libcamera"], read_libcamera, text=True, tree=True),
        "rawtoaces": Target(".json", seeds["rawtoaces"], find_cameras, text=True, tree=True),
        "sensitivity": Target(".csv", seeds["sensitivity"], csv_camera, text=True),
        "camera index": Target(".yaml", seeds["camera index"], index_file, text=True, tree=True),
        "camera": Target(".yaml", seeds["camera"], camera, text=True, tree=True),
        "sweep": Target(".yaml", seeds["sweep"], sweep, text=True, tree=True),
        "linearization": Target(".csv", seeds["linearization"], linearization, text=True),
        "otf": Target(".csv", seeds["otf"], load_otf_table, text=True),
        "psf arrays": Target(".npz", seeds["psf arrays"], load_psf_table),
        "psf hdf5": Target(".h5", seeds["psf hdf5"], load_psf_table),
        "psf tiff": Target(".tif", seeds["psf tiff"], psf_pages),
        "electrons": Target(".npy", seeds["electrons"], electrons),
        "commands": Target(".json", (b'["sensors", "list"]',), command, draw=draw_command),
    }
