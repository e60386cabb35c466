"""What is fuzzed: valid files of every format, ways to damage them, and what must come of reading one.

Reading a damaged file gives a result that can be, or one photosite error of one line: never another exception, and
never a number that is none. Hangs, crashes and large allocations are for whoever watches the process (`run.py`).
"""

from __future__ import annotations

import dataclasses
import json
import math
import random
import tempfile
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path

import numpy as np

from photosite.errors import PhotositeError
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.measured_chip import Blinking, DefectKind, Defects, MeasuredChip

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
    """A reader: valid files for it, and how it is called.

    Parameters
    ----------
    suffix
        Of the file that is damaged.
    seeds
        Contents of valid files.
    read
        Called with the damaged file's path; returns what was read.
    text
        Whether the format is text, so that words are damaged too.
    """

    suffix: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]
    text: bool = False


def damaged(content: bytes, rng: random.Random, *, text: bool) -> bytes:
    """The content with one to eight things wrong with it."""
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
    """The PNG with the check sums of its chunks as they would be; else they alone would refuse all damage."""
    out, at = bytearray(data[:8]), 8
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        body = data[at + 4 : at + 8 + length]
        out += data[at : at + 4] + body + zlib.crc32(body).to_bytes(4, "big")
        at += 12 + length
    return bytes(out + data[at:])


def _damaged_bytes(data: bytearray, rng: random.Random) -> None:
    size = len(data)
    # The heads of files hold what matters most; half of all damage goes there.
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


def outcome(target: Target, path: Path) -> str:
    """Reads the file: "read" or "refused".

    Raises
    ------
    AssertionError
        If what was read cannot be, or the error is not one line.
    Exception
        Whatever else the reader let through.
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
    """Every number of a result is finite, and a frame is a frame."""
    if isinstance(found, RawFrame):
        assert found.dn.dtype == np.uint16
        assert found.dn.ndim == 2
        assert found.dn.size > 0
        assert 0 <= found.black_level_dn < found.white_level_dn < 1 << 16
        assert found.exposure_s is None or 0 < found.exposure_s < math.inf
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
    """All readers by name; valid frames that protocols and descriptors name are written to the folder."""
    from photosite.calibration.spectral_protocol import open_spectral
    from photosite.frames.noise_profiles import read_darktable, read_libcamera
    from photosite.frames.open import open_frames
    from photosite.frames.read import read_frame, read_headers
    from photosite.sensor.file import load_sensor
    from photosite.sensor.maps_file import read_maps
    from photosite.spectrum_file import read_spectrum
    from photosite.studies.chart_protocol import open_chart

    seeds = _seeds(folder)

    def frame(path: Path) -> object:
        headers = read_headers(path)
        whole = headers[0].place if len(headers) > 1 else None
        return [read_frame(path, None, None, whole)[0], [dict(header.metadata) for header in headers[:4]]]

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
        from photosite.scene.files import read_scene

        if path.suffix == ".hdr":  # the numbers beside the header
            path.with_suffix(".img").write_bytes(seeds["envi numbers"][0])
        return read_scene(path)

    def chart(path: Path) -> object:
        from photosite.scene.files import read_scene

        return read_scene(path, illuminant="D65", mean_luminance_cd_m2=100.0)

    return {
        "scene": Target(".h5", seeds["scene"], scene),
        "cube": Target(".h5", seeds["cube"], scene),
        "mat73": Target(".mat", seeds["mat73"], scene),
        "stack": Target(".tif", seeds["stack"], scene),
        "envi": Target(".hdr", seeds["envi"], scene, text=True),
        "exr": Target(".exr", seeds["exr"], scene),
        "cgats": Target(".cgats", seeds["cgats"], chart, text=True),
        "patches": Target(".csv", seeds["patches"], chart, text=True),
        "tiff": Target(".tif", seeds["tiff"], frame),
        "dng": Target(".dng", seeds["dng"], frame),
        "libraw": Target(".nef", seeds["dng"], frame),
        "png": Target(".png", seeds["png"], frame),
        "hdf5": Target(".h5", seeds["hdf5"], frame),
        "fits": Target(".fits", seeds["fits"], frame),
        "maps": Target(".h5", seeds["maps"], read_maps),
        "descriptor": Target(".txt", seeds["descriptor"], frames, text=True),
        "protocol": Target(".yaml", seeds["protocol"], frames, text=True),
        "sensor": Target(".yaml", seeds["sensor"], sensor, text=True),
        "spectral": Target(".yaml", seeds["spectral"], spectral, text=True),
        "chart": Target(".yaml", seeds["chart"], lambda path: open_chart(path)[0].electrons, text=True),
        "spectrum": Target(".csv", seeds["spectrum"], read_spectrum, text=True),
        "darktable": Target(".json", seeds["darktable"], lambda path: read_darktable(path, None), text=True),
        "libcamera": Target(".json", seeds["libcamera"], read_libcamera, text=True),
    }


def _frame(seed: int = 0, shape: tuple[int, int] = (12, 16), **changes: object) -> RawFrame:
    dn = np.random.default_rng(seed).integers(40, 900, shape).astype(np.uint16)
    cfa = (("R", "G"), ("G", "B"))
    return RawFrame(dn, **({"bits": 12, "cfa": cfa, "black_level_dn": 64, "exposure_s": 0.01} | changes))


def _seeds(folder: Path) -> dict[str, tuple[bytes, ...]]:
    import photosite as ps

    plain = _frame(shape=(22, 22), color_matrix=np.eye(3), noise_profile=np.full((3, 2), 1e-4))
    made: dict[str, tuple[bytes, ...]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        for suffix in ("tif", "dng", "png"):
            plain.save(place / f"a.{suffix}")
        made["dng"] = ((place / "a.dng").read_bytes(),)
        made["png"] = ((place / "a.png").read_bytes(), _gray_png(place))
        made["tiff"] = ((place / "a.tif").read_bytes(), *_other_tiffs(place))
        made["hdf5"] = _hdf5(place)
        made["fits"] = _fits(place)
        made["maps"] = _maps(place)
        made |= _scenes(place)
        made |= _charts_and_renders(place)
    for number in range(2):
        _frame(number).save(folder / f"dark_{number}.tif")
        _frame(number + 5).save(folder / f"light_{number}.tif")
    sensor = ps.load_sensor("nikon-d200").with_(rows=12, cols=16, black_level_dn=64)
    spectrum = {"wavelength_nm": (400.0, 700.0), "quantum_efficiency": (0.1, 0.3)}
    sensor = sensor.with_(channels=dict.fromkeys("RGB", spectrum))
    sensor.save(folder / "a.sensor.yaml")
    _frame(9, (33, 49)).save(folder / "chart.tif")
    sensor.with_(rows=33, cols=49).save(folder / "chart.sensor.yaml")
    (folder / "diode.csv").write_text("nm,r,u\n400,0.2,0.001\n700,0.4,0.001\n")
    made["sensor"] = ((folder / "a.sensor.yaml").read_bytes(),)
    made["spectrum"] = ((folder / "diode.csv").read_bytes(),)
    made |= {name: tuple(text.encode() for text in texts) for name, texts in _TEXTS.items()}
    return made


def _charts_and_renders(place: Path) -> dict[str, tuple[bytes, ...]]:
    import OpenEXR

    from photosite.scene.charts import reflectance_chart
    from photosite.scene.files import write_scene

    grid = np.arange(400.0, 701.0, 100.0)
    chart = reflectance_chart(np.linspace(0.1, 0.9, 24).reshape(6, 4), grid, rows=2, cols=3)
    for name in ("a.cgats", "a.csv", "a.exr"):
        write_scene(chart, place / name)
    write_scene(chart, place / "half.exr", half=True)
    light = np.random.default_rng(2).random((12, 16)).astype(np.float32)
    picture = {"whiteLuminance": 100.0, "chromaticities": (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)}
    OpenEXR.File(picture, dict.fromkeys("RGB", light)).write(str(place / "rgb.exr"))
    units = {"emissiveUnits": "W.m^-2.sr^-1.nm^-1", "name": "spectra"}
    bands = dict.fromkeys(("S0.500,0nm", "S0.600,0nm"), light)
    OpenEXR.File([OpenEXR.Part({"name": "depth"}, {"Z": light}), OpenEXR.Part(units, bands)]).write(
        str(place / "b.exr")
    )
    across = b"# units: percent\nwavelength_nm;white;grey\n400;90,5;20\n500;91;20,5\n"
    return {
        "exr": tuple((place / name).read_bytes() for name in ("a.exr", "half.exr", "rgb.exr", "b.exr")),
        "cgats": ((place / "a.cgats").read_bytes(),),
        "patches": ((place / "a.csv").read_bytes(), across),
    }


def _gray_png(place: Path) -> bytes:
    from PIL import Image

    Image.fromarray(_frame().dn.astype(np.uint8)).save(place / "gray.png")
    return (place / "gray.png").read_bytes()


def _other_tiffs(place: Path) -> list[bytes]:
    import tifffile

    dn = _frame().dn
    found = []
    for options in (
        {"compression": "zlib", "predictor": True},
        {"tile": (16, 16)},
        {"bigtiff": True},
        {"byteorder": ">"},
    ):
        tifffile.imwrite(place / "b.tif", np.stack([dn, dn]), photometric="minisblack", **options)
        found.append((place / "b.tif").read_bytes())
    return found


def _hdf5(place: Path) -> tuple[bytes, ...]:
    import h5py

    dn = _frame().dn
    with h5py.File(place / "a.h5", "w") as file:
        data = file.create_dataset("frames", data=np.stack([dn, dn]))
        data.attrs.update({"exposure_s": [0.1, 0.2], "kind": "dark", "bits": 12, "cfa": "RG/GB", "iso": 100})
    with h5py.File(place / "b.h5", "w") as file:
        group = file.create_group("run")
        group.attrs["exposure_ms"] = 5.0
        group.create_dataset("one", data=dn, chunks=(6, 8), compression="gzip", shuffle=True)
    return (place / "a.h5").read_bytes(), (place / "b.h5").read_bytes()


def _fits(place: Path) -> tuple[bytes, ...]:
    from astropy.io import fits

    dn = _frame().dn
    header = fits.Header({"EXPTIME": 0.5, "IMAGETYP": "Dark Frame", "BAYERPAT": "RGGB", "CCD-TEMP": -5.0, "GAIN": 100})
    fits.HDUList([fits.PrimaryHDU(dn, header)]).writeto(place / "a.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(np.stack([dn, dn]), header)]).writeto(place / "b.fits")
    return (place / "a.fits").read_bytes(), (place / "b.fits").read_bytes()


def _scenes(place: Path) -> dict[str, tuple[bytes, ...]]:
    """Scene files and cubes, each as photosite writes them and as others do."""
    import tifffile

    from photosite.regions import Region
    from photosite.scene.files import write_scene
    from photosite.scene.scene import Scene

    rng = np.random.default_rng(3)
    grid = np.arange(450.0, 651, 50)
    radiance = 1e15 * rng.random((6, 5, 2)) @ rng.random((2, grid.size))
    scene = dataclasses.replace(
        Scene.from_radiance(radiance, grid, width_m=0.3), regions=(Region("a", 0, 2, 0, 3), Region("b", 2, 4, 1, 3))
    )
    scene.save(place / "scene.h5")
    write_scene(scene, place / "cube.h5", cube=True)
    write_scene(scene, place / "scene.mat", version="7.3")
    for interleave in ("bip", "bsq"):
        write_scene(scene, place / f"{interleave}.hdr", interleave=interleave)
    scene.save(place / "stack.tif")
    told = json.dumps({"wavelength_nm": grid.tolist(), "units": "W/sr/m2/nm"})
    tifffile.imwrite(
        place / "samples.tif",
        (radiance / 1e13).astype(np.uint16),
        photometric="minisblack",
        planarconfig="contig",
        compression="zlib",
        description=told,
        metadata=None,
    )
    return {
        "scene": ((place / "scene.h5").read_bytes(),),
        "cube": ((place / "cube.h5").read_bytes(),),
        "mat73": ((place / "scene.mat").read_bytes(),),
        "stack": ((place / "stack.tif").read_bytes(), (place / "samples.tif").read_bytes()),
        "envi": tuple((place / f"{interleave}.hdr").read_bytes() for interleave in ("bip", "bsq")),
        "envi numbers": ((place / "bsq.img").read_bytes(),),
    }


def _maps(place: Path) -> tuple[bytes, ...]:
    from photosite.sensor.maps_file import write_maps

    write_maps(_chip(), place / "a.maps.h5")
    return ((place / "a.maps.h5").read_bytes(),)


def _chip() -> MeasuredChip:
    rng = np.random.default_rng(1)
    names = ("offset_dn", "offset_uncertainty_dn", "read_noise_dn", "prnu", "prnu_uncertainty")
    maps = {name: np.abs(rng.normal(0, 1, (6, 8))).astype(np.float32) for name in names}
    where = np.array([1, 5]), np.array([7, 0])
    return MeasuredChip(
        **maps,
        read_noise_freedom=15,
        black_level_dn=64.0,
        system_gain_dn_per_e=0.25,
        reference_exposure_s=0.01,
        defects=Defects(*where, np.array([DefectKind.HOT] * 2, np.uint8), np.array([9.0, 8.0]), np.ones(2)),
        blinking=Blinking(*where, np.array([20.0, 8.0]), np.array([0.5, 0.2]), np.array([2.0, 3.0])),
    )


_DESCRIPTOR = r"""# a note
v 4.0
n 12 16 12
b 10000000 2500.5
i .\light_0.tif
i .\light_1.tif
d 10000000
i .\dark_0.tif
i .\dark_1.tif
"""
_PROTOCOL = """photosite_protocol: 1
name: darks and flats
bits: 12
cfa: rggb
black_level_dn: 64.5
sensor: a.sensor.yaml
frames:
- {kind: dark, exposure: 1/100, files: dark_*.tif, temperature_c: 20}
- {kind: light, exposure: 0.01, files: [light_0.tif, light_1.tif], photons_per_pixel: 1200.0, gain_setting: 100}
"""
_SPECTRAL = """photosite_spectral: 1
sensor: a.sensor.yaml
bits: 12
cfa: rggb
region: [0, 12, 0, 16]
photodiode: {area_mm2: {value: 100, standard_uncertainty: 0.2}, responsivity: diode.csv}
scale_uncertainty_percent: 0.5
darks:
- {exposure: 1/100, files: dark_*.tif}
bands:
- {centre_nm: 500, bandwidth_nm: 10, exposure: 1/100, files: light_0.tif, irradiance_w_m2: 0.012}
- {passband: diode.csv, exposure: 0.01, files: light_1.tif, photocurrent_a: {value: 1e-8, standard_uncertainty: 1e-11}}
"""
_CHART = """photosite_spectral: 1
sensor: chart.sensor.yaml
lens: {f_number: 8, focal_length_mm: 50, distance_m: 1.2}
wavelength_nm: [400, 700, 100]
light_uncertainty_percent: 1
lights:
- {illuminant: A, mean_luminance_cd_m2: 40, exposure: 1/3, files: chart.tif}
"""
_DARKTABLE = """{"version": 0, "noiseprofiles": [{"maker": "M", "models": [{"model": "X", "profiles": [
{"name": "X iso 100", "iso": 100, "a": [1e-5, 1e-5, 1e-5], "b": [1e-8, 1e-8, 1e-8]},
{"name": "X iso 200", "iso": 200, "a": [2e-5, 2e-5, 2e-5], "b": [2e-8, 2e-8, 2e-8]}]}]}]}
"""
_LIBCAMERA = """{"version": 2.0, "target": "bcm2835", "algorithms": [
{"rpi.black_level": {"black_level": 4096}},
{"rpi.noise": {"reference_constant": 10, "reference_slope": 2.5}}]}
"""
_TEXTS = {
    "descriptor": (_DESCRIPTOR,),
    "protocol": (_PROTOCOL,),
    "spectral": (_SPECTRAL,),
    "chart": (_CHART,),
    "darktable": (_DARKTABLE,),
    "libcamera": (_LIBCAMERA,),
}
