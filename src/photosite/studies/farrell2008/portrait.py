"""The portrait of section 5: the scene, a capture, the noise on the face, and a figure of several captures.

The scenes of the paper were not published. This portrait is one that matplotlib ships.
"""

from __future__ import annotations

import hashlib
import io
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from photosite.camera.camera import Camera
from photosite.develop.develop import develop
from photosite.errors import FileError
from photosite.frames.raw_frame import RawFrame
from photosite.report.numbers import format_number
from photosite.report.style import styled
from photosite.scene.pictures import from_rgb
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import ILLUMINANT
from photosite.studies.farrell2008.drawing import bare, text
from photosite.values.cfa import channel_mask
from photosite.values.region import Region

_PORTRAIT = Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg"
_SHAPE = (600, 512, 3)
FACE = Region("face", 140, 320, 180, 350)
"""Forehead to chin, in samples of the portrait."""

PORTRAIT_WIDTH_M = 0.5
"""Width of head and shoulders, an assumption. The distance is such that they fill the chip."""


@lru_cache(maxsize=1)
def portrait() -> NDArray[np.uint8]:
    """Return the portrait that matplotlib ships, (600, 512, 3) in display sRGB.

    Raises
    ------
    FileError
        If the file is missing or has another size.
    """
    with Image.open(io.BytesIO(_portrait_file())) as image:
        picture = np.asarray(image.convert("RGB"))
    if picture.shape != _SHAPE:
        raise FileError(_PORTRAIT, "shape", value=picture.shape, expected=f"{_SHAPE}, the portrait of this study")
    return picture


def portrait_source() -> dict[str, str]:
    """Return the source of the portrait, and the SHA-256 of its file."""
    return {"source": text("portrait_source"), "file_sha256": hashlib.sha256(_portrait_file()).hexdigest()}


def _portrait_file() -> bytes:
    try:
        return _PORTRAIT.read_bytes()
    except OSError as error:
        problem = f"the file cannot be read ({error.strerror})"
        hint = "Install matplotlib from PyPI, which includes its sample data"
        raise FileError(_PORTRAIT, problem, hint=hint) from None


def portrait_scene(luminance_cd_m2: float) -> Scene:
    """Return the portrait as a print under tungsten light, with the face as a region.

    Parameters
    ----------
    luminance_cd_m2
        Mean luminance of the whole picture.

    Examples
    --------
    >>> scene = portrait_scene(5.0)
    >>> scene.weights.shape, round(region_luminance_cd_m2(scene, FACE), 1)
    ((3, 600, 512), 11.3)
    """
    scene = from_rgb(portrait(), ILLUMINANT, luminance_cd_m2, name="portrait")
    return replace(scene, regions=(FACE,))


def region_luminance_cd_m2(scene: Scene, region: Region) -> float:
    """Return the mean luminance of a region."""
    part = scene.weights[:, region.r0 : region.r1, region.c0 : region.c1]
    return replace(scene, weights=part, regions=()).mean_luminance_cd_m2()


def filling(scene: Scene, camera: Camera, width_m: float = PORTRAIT_WIDTH_M) -> Scene:
    """Return the scene at the distance at which its width fills the chip.

    For a thin lens, |m| = f / (d - f), with |m| the width of the chip over that of the scene.

    Examples
    --------
    >>> from photosite.studies.farrell2008.cameras import VENDOR
    >>> camera = Camera(VENDOR.lens, VENDOR.sensor(300, 256))
    >>> scene = filling(portrait_scene(5.0), camera)
    >>> round(scene.distance_m, 2), round(camera.optics.magnification(scene.distance_m) * 0.5 * 1e6, 1)
    (4.34, 563.2)
    """
    sensor = camera.sensor
    chip_m = sensor.array.cols * sensor.pixel.width_um.value * 1e-6
    # The focal length of a thin lens follows from the magnification at any distance.
    ratio = camera.optics.magnification(1.0)
    focal_m = ratio / (1.0 + ratio)
    return replace(scene, distance_m=focal_m * (1.0 + width_m / chip_m), width_m=None)


@dataclass(frozen=True)
class RegionNoise:
    """Signal-to-noise ratio of a channel in a region of one frame, measured and expected.

    `mean_e` are electrons from light. `snr_db` is 20 log10 of them over the RMS difference between the frame and the
    mean electrons: temporal noise and fixed pattern, without the structure of the scene, which a simulation knows.
    `expected_db` follows from shot noise, read noise, DSNU, PRNU and rounding at the signal of each pixel.
    """

    mean_e: float
    snr_db: float
    standard_error_db: float
    expected_db: float


@dataclass(frozen=True, eq=False)
class Shot:
    """A capture of the portrait: the frame, the picture (rows, cols, 3) in display sRGB, and the noise on the face by
    channel.

    The picture has a bilinear demosaic and gray world; a white surface in this light is white.
    """

    camera: Camera
    exposure_s: float
    raw: RawFrame
    picture: NDArray[np.float32]
    face: dict[str, RegionNoise]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "exposure_s": self.exposure_s,
            "pixels": list(self.raw.shape),
            "face": {channel: asdict(noise) for channel, noise in self.face.items()},
        }


def shoot_portrait(camera: Camera, scene: Scene, exposure_s: float, key: int) -> Shot:
    """Capture a scene from `portrait_scene`, moved to the distance at which it fills the chip, and develop the frame.

    `key` is that of the temporal noise.
    """
    placed = filling(scene, camera)
    mean_e = camera.mean_electrons(placed, exposure_s)
    raw = camera.expose(mean_e, exposure_s, seed=key)
    picture = develop(raw, "gray-world", exposure=white_exposure(camera, placed, exposure_s))
    face = region_noise(raw, mean_e, camera.sensor, camera.image_regions(placed)[0])
    return Shot(camera, exposure_s, raw, picture, face)


def white_surface_electrons(camera: Camera, scene: Scene, exposure_s: float) -> float:
    """Return the electrons of a white surface in the scene's light, in the most sensitive channel.

    The scene is from `photosite.scene.pictures.from_rgb`: its basis spectra add up to that of white.
    """
    white = Scene.uniform(scene.basis.sum(axis=0), scene.wavelength_nm, scene.distance_m)
    tile = camera.sensor.array.cfa
    small = replace(camera, sensor=camera.sensor.with_(rows=len(tile), cols=len(tile[0])))
    return float(small.mean_electrons(white, exposure_s).max())


def white_exposure(camera: Camera, scene: Scene, exposure_s: float) -> float:
    """Return the exposure factor for `develop` at which a white surface in the scene's light is display white."""
    sensor = camera.sensor
    range_e = (sensor.white_level_dn - sensor.readout.black_level_dn.value) / sensor.system_gain_dn_per_e
    return range_e / white_surface_electrons(camera, scene, exposure_s)


def region_noise(
    raw: RawFrame, mean_electrons: NDArray[np.float32], sensor: Sensor, region: Region
) -> dict[str, RegionNoise]:
    """Return the noise of each channel in a region of a frame, measured and from the noise model.

    Parameters
    ----------
    raw
        The frame; its region is neither saturated nor clipped at black.
    mean_electrons
        (rows, cols) mean electrons from light.
    sensor
        Its sensor, without dark current.
    region
        The region.
    """
    inside = (slice(region.r0, region.r1), slice(region.c0, region.c1))
    read_e = (raw.dn[inside] - raw.black_level_dn) / sensor.system_gain_dn_per_e
    light_e = mean_electrons[inside].astype(np.float64)
    floor_e2 = sum(sensor.electrons(q.value) ** 2 for q in (sensor.noise.read_noise_mv, sensor.noise.dsnu_mv))
    floor_e2 += 1.0 / 12.0 / sensor.system_gain_dn_per_e**2
    prnu2 = (sensor.noise.prnu_percent.value / 100.0) ** 2
    found = {}
    for channel in "RGB":
        mask = channel_mask(raw.cfa, channel, raw.shape)[inside]
        light, square = light_e[mask], (read_e - light_e)[mask] ** 2
        mean, variance = float(light.mean()), float(square.mean())
        expected = float((light + floor_e2 + prnu2 * light**2).mean())
        relative = float(square.std(ddof=1)) / variance / math.sqrt(square.size)
        found[channel] = RegionNoise(
            mean,
            snr_db=10 * math.log10(mean**2 / variance),
            standard_error_db=10 / math.log(10) * relative,
            expected_db=10 * math.log10(mean**2 / expected),
        )
    return found


@dataclass(frozen=True, eq=False)
class Captioned:
    """A picture (rows, cols, 3) of the portrait in display sRGB, with a title above it and a note below its face."""

    title: str
    picture: NDArray[Any]
    note: str

    @classmethod
    def of(cls, title: str, shot: Shot) -> Captioned:
        """Return a capture with the noise of its green channel."""
        return cls(title, shot.picture, f"green: {format_number(shot.face['G'].snr_db, 3)} dB")


@styled()
def portraits_figure(columns: Sequence[Captioned]) -> Figure:
    """Draw pictures of the portrait in a row, from left to right and equally large, with the enlarged faces below."""
    figure = Figure(figsize=(8.6, 5.2))
    wholes, faces = figure.subplots(
        2, len(columns), height_ratios=(600 / 512, (FACE.r1 - FACE.r0) / (FACE.c1 - FACE.c0))
    )
    rows, cols = portrait().shape[:2]
    for column, whole, face in zip(columns, wholes, faces, strict=True):
        height, width = column.picture.shape[:2]
        r0, r1 = (round(height * r / rows) for r in (FACE.r0, FACE.r1))
        c0, c1 = (round(width * c / cols) for c in (FACE.c0, FACE.c1))
        whole.imshow(column.picture, interpolation="none")
        face.imshow(column.picture[r0:r1, c0:c1], interpolation="none")
        whole.set_title(column.title)
        face.set_xlabel(column.note)
        bare(whole)
        bare(face)
    return figure
