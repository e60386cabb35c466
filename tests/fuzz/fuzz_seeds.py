"""Valid files of every format, from which damaged ones are made."""

from __future__ import annotations

import dataclasses
import gzip
import json
import re
import struct
import tempfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from photosite.frames.raw_frame import RawFrame
from photosite.sensor.chip import Blinking, DefectKind, Defects, MeasuredChip


def _frame(seed: int = 0, shape: tuple[int, int] = (12, 16), **changes: object) -> RawFrame:
    dn = np.random.default_rng(seed).integers(40, 900, shape).astype(np.uint16)
    cfa = (("R", "G"), ("G", "B"))
    return RawFrame(dn, **({"bits": 12, "cfa": cfa, "black_level_dn": 64, "exposure_s": 0.01} | changes))


def seeds_of(folder: Path) -> dict[str, tuple[bytes, ...]]:
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
        made["fits amplifiers"] = _fits_of_amplifiers(place)
        made["fits gz"] = tuple(gzip.compress(content, 1) for content in made["fits"])
        made["raw"] = tuple(np.random.default_rng(seed).bytes(12 * 24) for seed in range(2))
        made |= _camera_maps(place)
        made["maps"] = _maps(place)
        made |= _scenes(place)
        made |= _charts_and_renders(place)
        made["picture"] = _pictures(place)
        made["radiance"] = _radiance()
        made["lzw"] = _compressed_tiffs(place)
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
    made |= _lens_listings(folder)
    made |= _saved_lenses(folder)
    made["sensor"] = ((folder / "a.sensor.yaml").read_bytes(),)
    made["spectrum"] = ((folder / "diode.csv").read_bytes(),)
    made |= {name: tuple(text.encode() for text in texts) for name, texts in _TEXTS.items()}
    made |= _tables(folder)
    _files_of_commands(folder, made)
    return made


def _tables(folder: Path) -> dict[str, tuple[bytes, ...]]:
    """Return point spreads in all their formats, OTFs and electrons."""
    import h5py
    import tifffile

    axis = np.arange(-5, 6) * 0.5
    psf = np.stack([np.exp(-(axis[:, None] ** 2 + axis**2) / width) for width in (2, 4)])
    psf /= psf.sum(axis=(1, 2), keepdims=True)
    stated = {"spacing_um": 0.5, "wavelength_nm": [450.0, 650.0]}
    np.savez(folder / "psf.npz", psf=psf, **stated)
    np.savez_compressed(folder / "small.npz", psf=psf.astype(np.float32), **stated)
    with h5py.File(folder / "psf.h5", "w") as file:
        file["psf"] = psf
        file.attrs.update(stated)
    tifffile.imwrite(folder / "psf.tif", psf.astype(np.float32), photometric="minisblack", compression="zlib")
    np.save(folder / "electrons.npy", 1e5 * psf[0].astype(np.float32))
    names = {"psf arrays": ("psf.npz", "small.npz"), "psf hdf5": ("psf.h5",), "psf tiff": ("psf.tif",)}
    names["electrons"] = ("electrons.npy",)
    return {name: tuple((folder / file).read_bytes() for file in files) for name, files in names.items()}


_COMMAND_FILES = {
    "sensor": "a.sensor.yaml", "optics": "x.optics.yaml", "design": "x.optics.design.npz", "camera": "a.camera.yaml",
    "sweep": "a.sweep.yaml", "protocol": "protocol.yaml", "spectral": "spectral.yaml", "spectrum": "diode.csv",
    "dng": "a.dng", "png": "a.png", "tiff": "a.tif", "hdf5": "a.h5", "fits": "a.fits", "descriptor": "emva.txt",
    "scene": "scene.h5", "picture": "picture.png", "patches": "patches.csv", "darktable": "profiles.json",
    "libcamera": "tuning.json", "rawtoaces": "rawtoaces.json", "linearization": "linear.csv",
    "electrons": "electrons.npy", "camera index": "cameras.yaml", "mat5": "scene.mat", "psf": "psf.txt",
}  # fmt: skip


def _files_of_commands(folder: Path, made: dict[str, tuple[bytes, ...]]) -> None:
    """Write the folder that command lines are run in: valid files, a stack, and files that are none."""
    files = folder / "files"
    (files / "stack").mkdir(parents=True)
    for name, file in _COMMAND_FILES.items():
        (files / file).write_bytes(made[name][0])
        cut = files / f"cut.{file.rpartition('.')[2]}"
        cut.write_bytes(made[name][0][: len(made[name][0]) // 2])
    for place in (files, files / "stack"):
        for frame in folder.glob("*_?.tif"):
            (place / frame.name).write_bytes(frame.read_bytes())
    (files / "empty").write_bytes(b"")
    for suffix in ("tif", "yaml", "json"):
        (files / f"zero.{suffix}").symlink_to("/dev/zero")
    (files / "\udcff\udcfe\x1b.yaml").write_text("photosite_sensor: 1")


def _saved_lenses(folder: Path) -> dict[str, tuple[bytes, ...]]:
    """Return optics files written by photosite, and their arrays."""
    import photosite as ps
    from photosite.optics.distortion import Distortion, LateralColor
    from photosite.optics.field_points import FieldPoints
    from photosite.optics.illumination import IlluminationTable

    base, grid = ps.DiffractionLimited(4, 50), np.array([450.0, 650.0])
    axis = np.arange(-8, 9) * 0.5
    spots = np.stack([[np.exp(-(axis[:, None] ** 2 + axis**2) / (1 + k))] * 2 for k in range(2)])
    field = FieldPoints(height_mm=np.array([0.0, 9.0]))
    design = ps.optics.LensDesign(grid, spots, 0.5, np.zeros(2), np.array([0.0, 9.0]), nodes=3)
    array = ps.optics.Wavefront({8: 30.0}, pupil=ps.optics.Pupil(amplitude=np.pad(np.full((8, 8), 0.5), 4)))
    tables = {
        "illumination": IlluminationTable(field, np.array([1, 0.8])),
        "distortion": Distortion.from_percent(field, [0, -2]),
        "lateral_color": LateralColor.from_magnification(grid, [1.0001, 0.9999]),
    }
    for name, lens in (("x", ps.Lens(base, design)), ("y", ps.Lens(base, array, 2.0, **tables))):
        lens.save(folder / f"{name}.optics.yaml", {"source": "made up"})
    return {
        "optics": tuple((folder / f"{name}.optics.yaml").read_bytes() for name in "xy"),
        "design": ((folder / "x.optics.design.npz").read_bytes(),),
        "pupil": ((folder / "y.optics.pupil.npz").read_bytes(),),
    }


def _lens_listings(folder: Path) -> dict[str, tuple[bytes, ...]]:
    """Return a ray trace of ISET's macros with its data, and listings of Zemax."""
    for f in (1, 2):
        for w in (1, 2):
            field = f"{0.4 + 0.1 * w:.4f} µm at 0.0000, {1.0 - f:.4f} (mm)."
            numbers = "\n".join(
                "\t".join(f"{np.exp(-(x * x + y * y)):.3E}" for x in range(-3, 4)) for y in range(-3, 4)
            )
            text = _PSF.replace("FIELD", field) + numbers
            (folder / f"A_2D_PSF_Fld{f}_Wave{w}.dat").write_text(text, "utf-8")
    for kind, table in (("DI", _HEIGHTS), ("RI", "1 1\n0.9 0.9\n")):
        (folder / f"A_{kind}_.dat").write_text(table)
    parameters, listing = _RAY_TRACE.encode(), (folder / "A_2D_PSF_Fld2_Wave1.dat").read_bytes()
    return {
        "ray trace": (parameters, parameters.decode().encode("utf-16")),
        "heights": (_HEIGHTS.encode(), b"0\n0\n0.97\n0.98\n"),
        "psf": (listing, listing.decode().encode("utf-16")),
        "distortion": (_FIELD_CURVATURE.encode(), _GRID_DISTORTION.encode()),
    }


_CXF = b"""<?xml version="1.0" encoding="UTF-8"?>
<cc:CxF xmlns:cc="http://colorexchangeformat.com/CxF3-core"><cc:Resources><cc:ObjectCollection>
<cc:Object ObjectType="Target" Name="white" Id="c1"><cc:ColorValues>
<cc:ReflectanceSpectrum ColorSpecification="CS1" StartWL="400">0.8 0.85 0.88 0.9</cc:ReflectanceSpectrum>
</cc:ColorValues></cc:Object><cc:Object ObjectType="Target" Name="gray" Id="c2"><cc:ColorValues>
<cc:ReflectanceSpectrum ColorSpecification="CS1">0.19 0.19 0.2 0.2</cc:ReflectanceSpectrum></cc:ColorValues>
<cc:TagCollection Name="Location"><cc:Tag Name="Row" Value="1"/></cc:TagCollection></cc:Object></cc:ObjectCollection>
<cc:ColorSpecificationCollection><cc:ColorSpecification Id="CS1"><cc:MeasurementSpec><cc:WavelengthRange StartWL="400"
Increment="100"/></cc:MeasurementSpec></cc:ColorSpecification></cc:ColorSpecificationCollection></cc:Resources></cc:CxF>
"""


def _charts_and_renders(place: Path) -> dict[str, tuple[bytes, ...]]:
    import OpenEXR

    from photosite.scene.charts import reflectance_chart
    from photosite.scene.io.formats import write_scene

    grid = np.arange(400.0, 701.0, 100.0)
    chart = reflectance_chart(np.linspace(0.1, 0.9, 24).reshape(6, 4), grid, rows=2, cols=3).under("A")
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
        "cxf": (_CXF,),
        "patches": ((place / "a.csv").read_bytes(), across),
    }


def _gray_png(place: Path) -> bytes:
    from PIL import Image

    Image.fromarray(_frame().dn.astype(np.uint8)).save(place / "gray.png")
    return (place / "gray.png").read_bytes()


def _pictures(place: Path) -> tuple[bytes, ...]:
    """Pictures in color: PNG of 8 bits, JPEG with and without a profile, PNG of 16 bits with all filters."""
    from PIL import Image, ImageCms

    codes = np.random.default_rng(4).integers(1, 256, (8, 8, 3)).astype(np.uint8)
    exif = Image.Exif()
    exif[0x0112] = 6
    for name in ("c.png", "c.jpg"):
        Image.fromarray(codes).save(place / name, exif=exif)
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(codes).save(place / "p.jpg", icc_profile=profile)
    made = [(place / name).read_bytes() for name in ("c.png", "c.jpg", "p.jpg")]
    passes = [(1, 1), (1, 1), (1, 2), (2, 2), (2, 4), (4, 4), (4, 8)]
    for interlaced, parts in ((0, [(8, 8)]), (1, passes)):
        lines = [bytes([r % 5]) + codes.tobytes()[: 6 * wide] for high, wide in parts for r in range(high)]
        body = b""
        for name, content in (
            (b"IHDR", struct.pack(">IIBBBBB", 8, 8, 16, 2, 0, 0, interlaced)),
            (b"gAMA", struct.pack(">I", 45455)),
            (b"IDAT", zlib.compress(b"".join(lines))),
            (b"IEND", b""),
        ):
            body += struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        made.append(b"\x89PNG\r\n\x1a\n" + body)
    return tuple(made)


def _radiance() -> tuple[bytes, ...]:
    """A Radiance picture, run-length coded and flat."""
    import imagecodecs

    values = np.random.default_rng(5).random((6, 20, 3)).astype(np.float32)
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 6 +X 20\n"
    return tuple(head + imagecodecs.rgbe_encode(values, header=False, rle=rle) for rle in (True, False))


def _compressed_tiffs(place: Path) -> tuple[bytes, ...]:
    """Frames in the compressions of camera tools."""
    import imagecodecs
    import tifffile

    dn = _frame().dn
    found = []
    for compression in ("lzw", "packbits", "zstd"):
        tifffile.imwrite(place / "d.tif", dn, photometric="minisblack", compression=compression)
        found.append((place / "d.tif").read_bytes())
    strip = imagecodecs.ljpeg_encode(dn.astype(np.uint8), bitspersample=8)
    kind = {"shape": dn.shape, "dtype": np.uint8, "photometric": "minisblack", "compression": 7}
    tifffile.imwrite(place / "d.tif", iter([strip]), **kind)
    return (*found, (place / "d.tif").read_bytes())


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


def _fits_of_amplifiers(place: Path) -> tuple[bytes, ...]:
    """Return amplifiers of a chip with overscan, a frame with ESO's keywords, and one compressed as tiles."""
    from astropy.io import fits

    dn = _frame().dn
    units: list[Any] = [fits.PrimaryHDU(header=fits.Header({"EXPTIME": 1.0, "IMAGETYP": "FLAT"}))]
    for left in (0, 12):
        keywords = {"DATASEC": "[1:12,1:12]", "BIASSEC": "[13:16,1:12]", "DETSEC": f"[{left + 1}:{left + 12},1:12]"}
        units.append(fits.ImageHDU(dn, fits.Header(keywords)))
    fits.HDUList(units).writeto(place / "amps.fits")
    eso = fits.Header({"EXPTIME": 1.0, "HIERARCH ESO DET OUT1 PRSCX": 2, "HIERARCH ESO DET OUT1 OVSCX": 3})
    fits.PrimaryHDU(dn, eso).writeto(place / "eso.fits")
    fits.HDUList([units[0], fits.CompImageHDU(dn)]).writeto(place / "tiles.fits")
    return tuple((place / f"{name}.fits").read_bytes() for name in ("amps", "eso", "tiles"))


def _camera_maps(place: Path) -> dict[str, tuple[bytes, ...]]:
    """Return maps of microscope cameras, in each form that is one file."""
    from photosite.sensor.io.camera_maps import write_camera_maps

    rng = np.random.default_rng(4)
    offset, noise = rng.normal(0, 1, (2, 12, 16)).astype(np.float32)
    chip = MeasuredChip(offset_dn=offset, read_noise_dn=noise**2 + 1, black_level_dn=100, system_gain_dn_per_e=2.2)
    found: dict[str, tuple[bytes, ...]] = {}
    for suffix, forms in (("mat", ("smite", "smap")), ("calb", ("accent",)), ("tif", ("gdsc", "ome"))):
        for form in forms:
            path = place / f"{form}.{suffix}"
            write_camera_maps(chip, path, form)
            found[f"camera maps {suffix}"] = (*found.get(f"camera maps {suffix}", ()), path.read_bytes())
    np.save(place / "calib.npy", np.stack([offset + 100, noise**2 + 1, noise**2 + 2]))
    return found | {"camera maps npy": ((place / "calib.npy").read_bytes(),)}


def _scenes(place: Path) -> dict[str, tuple[bytes, ...]]:
    """Return scene files and cubes, written by photosite and by others."""
    import tifffile

    from photosite.scene.io.formats import write_scene
    from photosite.scene.scene import Scene
    from photosite.values.region import Region

    rng = np.random.default_rng(3)
    grid = np.arange(450.0, 651, 50)
    radiance = 1e15 * rng.random((6, 5, 2)) @ rng.random((2, grid.size))
    scene = dataclasses.replace(
        Scene.from_radiance(radiance, grid, width_m=0.3), regions=(Region("a", 0, 2, 0, 3), Region("b", 2, 4, 1, 3))
    )
    scene.save(place / "scene.h5")
    write_scene(scene, place / "cube.h5", cube=True)
    write_scene(scene, place / "scene.mat", version="7.3")
    write_scene(scene, place / "basis.mat", version="5")
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
        "mat5": ((place / "basis.mat").read_bytes(),),
        "stack": ((place / "stack.tif").read_bytes(), (place / "samples.tif").read_bytes()),
        # One file of data for both headers
        "envi": tuple(
            re.sub(rb"data digest.*\n", b"", (place / f"{interleave}.hdr").read_bytes())
            for interleave in ("bip", "bsq")
        ),
        "envi numbers": ((place / "bsq.img").read_bytes(),),
    }


def _maps(place: Path) -> tuple[bytes, ...]:
    from photosite.sensor.io.sensor_file import write_maps

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
_RAY_TRACE = """%   C:\\A.ZMX
lensFile='A.ZMX';     %Lens file name
psfSize=7;                 % PSF ROW AND COL SIZE
psfSpacing=0.0005000;   % PSF GRID SPACING IN MM
wave=500:100:600;            % WAVELENGTH SAMPLES (NM)
imgHeightNum=2;                % Number of IMAGE HEIGHTS
imgHeightMax=1.0000000;                % Maximum IMAGE HEIGHT (mm)
objDist=250.000;                 % OBJECT DISTANCE (MM)
mag=-0.023954;          % OPTICAL SYSTEM MAGNIFICATION
baseLensFileName='C:\\A\\A'
refWave=587.562;          % REFERENCE WAVELENGTH (NM)
efl=5.999968;          % EFFECTIVE FOCAL LENGTH
fnumber=1.774644;          % F-NUMBER
"""
_HEIGHTS = "0.000000E+000 0.000000E+000\n9.700000E-001 9.800000E-001\n"
_PSF = """Listing of Huygens PSF Data

HUYGENS PSF
FIELD
Data spacing is 0.5 µm.
Image grid size: 7 by 7
Center point is: 4, 4
Values are relative intensity.

"""
_FIELD_CURVATURE = """Results for:\t
0 message(s) in output.

Table series: Data for wavelength : 0.486133 µm.
   Y Angle (deg)       Tan Shift       Sag Shift     Real Height     Ref. Height      Distortion
      0.00000000     0.061287407     0.061287407      0.00000000      0.00000000      0.00000000
       2.0000000  1.5161449E-003     0.033852291      0.95186714      0.95190002 -3.4546014E-003

Table series: Data for wavelength : 0.587562 µm.
   Y Angle (deg)       Tan Shift       Sag Shift     Real Height     Ref. Height      Distortion
      0.00000000    -0.020734977    -0.020734977      0.00000000      0.00000000      0.00000000
       2.0000000    -0.079997892    -0.047949897      0.95133976      0.95137397 -3.5962686E-003
"""
_GRID_DISTORTION = """Listing of Grid Distortion Data

Units are Millimeters.
Wavelength: 0.55000 µm
Reference Coordinates: Xref = 0.00000E+000, Yref = 0.00000E+000

 i j X-Field Y-Field R-Field Predicted X Predicted Y Real X Real Y Distortion
 1 1 6.31213E-001 4.73418E-001 7.88998E-001 2.17504E-002 1.63128E-002 2.17493E-002 1.63120E-002 -0.004794%
 15 15 9.38376E+000 7.06540E+000 1.16715E+001 3.26255E-001 2.44691E-001 3.22789E-001 2.42092E-001 -1.062312%
 32 32 1.94201E+001 1.48108E+001 2.37825E+001 6.96011E-001 5.22008E-001 6.64084E-001 4.98063E-001 -4.587114%
"""
_DARKTABLE = """{"version": 0, "noiseprofiles": [{"maker": "M", "models": [{"model": "X", "profiles": [
{"name": "X iso 100", "iso": 100, "a": [1e-5, 1e-5, 1e-5], "b": [1e-8, 1e-8, 1e-8]},
{"name": "X iso 200", "iso": 200, "a": [2e-5, 2e-5, 2e-5], "b": [2e-8, 2e-8, 2e-8]}]}]}]}
"""
_LIBCAMERA = """{"version": 2.0, "target": "bcm2835", "algorithms": [
{"rpi.black_level": {"black_level": 4096}},
{"rpi.noise": {"reference_constant": 10, "reference_slope": 2.5}}]}
"""
_RAWTOACES = """{"header": {"manufacturer": "M", "model": "X", "license": null, "document_creator": "lab"},
"spectral_data": {"units": "relative", "index": {"main": ["R", "G"]},
"data": {"main": {"400": [0.1, 0.2], "410": [0.3, 0.4], "420": [1.0, 0.9]}}}}
"""
_SENSITIVITY = "wavelength_nm,red,green\n400,0.1,0.2\n410,0.3,0.4\n"
_CAMERA_INDEX = f"""photosite_camera_index: 1
cameras:
- folder: x-1-0a1b2c3d
  camera: Acme X-1
  license: CC0-1.0
  created: 2026-11
  gain_settings: [100, 400]
  sha256: {{entry.yaml: {"a" * 64}, sensor.yaml: {"b" * 64}, emva1288.json: {"c" * 64}}}
"""
_CAMERA = """photosite_camera: 1
name: small
sensor: a.sensor.yaml
optics: {f_number: 8, focal_length_mm: 50, blur: {kind: wavefront, zernike: {4: 20, 8: 30}, unit: nm}}
scene: {source: macbeth, illuminant: A, luminance_cd_m2: 40, distance_m: 1.2, width_m: 0.4}
exposure: 1/3
integration: trapezoid
cells_per_pixel: 1
"""
_PLANES = """photosite_camera: 1
sensor: nikon-d200
optics: {f_number: 4, focal_length_mm: 50, focus_distance_m: 1.0, falloff: cos4}
scene:
- {source: siemens-star, distance_m: 1.0, width_m: 0.2, options: {cycles: 8}}
- {source: slanted-edge, distance_m: 2.0}
exposure: 10ms
"""
_SWEEP = """photosite_sweep: 1
name: pixels
camera: {sensor: google-pixel-4a, optics: {f_number: 2.8, focal_length_mm: 4}}
values:
  pixel_width_um: [0.8, 1.0, 1.4]
  f_number: [1.8, 2.8]
measure: {snr: {luminance_cd_m2: 5, exposure: 1/15}}
"""
_OTF = "frequency_per_mm, 450, 650\n0, 1, 1\n40, 0.7, 0.6\n200, 0, 0\n"
_LINEAR = "code,value\n" + "".join(f"{k},{k * k / 15}\n" for k in range(16))
_TEXTS = {
    "camera": (_CAMERA, _PLANES),
    "sweep": (_SWEEP,),
    "otf": (_OTF,),
    "linearization": (_LINEAR,),
    "descriptor": (_DESCRIPTOR,),
    "protocol": (_PROTOCOL,),
    "spectral": (_SPECTRAL,),
    "chart": (_CHART,),
    "darktable": (_DARKTABLE,),
    "rawtoaces": (_RAWTOACES,),
    "sensitivity": (_SENSITIVITY,),
    "camera index": (_CAMERA_INDEX,),
    "libcamera": (_LIBCAMERA,),
}
