"""The portrait of section 5: scene, captures, noise on the face, figures; and the experiment of the dimly lit face.

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
from photosite.metrics.snr import noise_budget
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import Column, Paragraph, Table
from photosite.report.style import styled
from photosite.scene.pictures import from_rgb
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import D200, ILLUMINANT, VENDOR, Case, frame_key
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, bare, paragraph, text
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


# Section 5, a dimly lit face: a portrait of 5 cd/m2, exposed for 66 ms, captured with both sensors.


LUMINANCE_CD_M2, EXPOSURE_S = 5.0, 0.066
"""Values of the paper. That the luminance is the mean over the picture is an assumption; the face is brighter."""

ROWS, COLS = 300, 256
"""Size of the portrait on either chip in pixels, half of its 600 x 512 samples."""

CAMERAS: tuple[Case, ...] = (VENDOR, D200, replace(D200, key="d200_f2.8", f_number=VENDOR.f_number))
"""Both cameras with the lens of Table 1, and the D200 again with the f-number of the vendor camera, for the same
irradiance. The paper does not state the f-number of the D200 for this picture."""


@dataclass(frozen=True, eq=False)
class FaceShot:
    """The face captured with one camera; `white_e` are the electrons of a white surface in the most sensitive channel
    in this light."""

    case: Case
    shot: Shot
    white_e: float

    @property
    def title(self) -> str:
        """Camera and f-number."""
        return f"{self.case.title}, f/{self.case.f_number:g}"

    @property
    def read_dsnu_dominate_on_the_face(self) -> bool:
        """Whether read noise and DSNU exceed shot noise and PRNU at the green signal of the face."""
        sensor = self.shot.camera.sensor
        volts = self.shot.face["G"].mean_e * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
        return volts < noise_budget(sensor, volts).dark_limited_below_volts

    @property
    def floor_e(self) -> float:
        """Read noise and DSNU combined."""
        sensor = self.shot.camera.sensor
        read_mv, dsnu_mv = sensor.noise.read_noise_mv.value, sensor.noise.dsnu_mv.value
        return float(np.hypot(sensor.electrons(read_mv), sensor.electrons(dsnu_mv)))


@dataclass(frozen=True, eq=False)
class DimFace:
    """Result of the chapter: mean luminance of the face, and captures in the order of `CAMERAS`."""

    face_luminance_cd_m2: float
    shots: tuple[FaceShot, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "portrait": portrait_source(),
            "mean_luminance_cd_m2": LUMINANCE_CD_M2,
            "face_luminance_cd_m2": self.face_luminance_cd_m2,
            "cameras": {
                entry.case.key: {
                    "f_number": entry.case.f_number,
                    "white_surface_e": entry.white_e,
                    "read_noise_and_dsnu_dominate_on_the_face": entry.read_dsnu_dominate_on_the_face,
                    **entry.shot.to_dict(),
                }
                for entry in self.shots
            },
        }

    def part(self) -> Part:
        """Return the pictures, the noise on the face, and a comparison with the paper."""
        columns = [Captioned("the print", portrait(), "no camera")]
        columns += [Captioned.of(entry.title, entry.shot) for entry in self.shots]
        return (
            paragraph(
                "dim_face",
                level=LUMINANCE_CD_M2,
                milliseconds=1e3 * EXPOSURE_S,
                face=self.face_luminance_cd_m2,
                source=text("portrait_source"),
            ),
            Drawing.of("section5-dim-face", portraits_figure(columns), rows=ROWS, cols=COLS),
            self._table(),
            self._words(),
        )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the line of the face."""
        shots = ", ".join(f"{entry.shot.face['G'].snr_db:.0f} dB ({entry.title})" for entry in self.shots)
        limited = sum(entry.read_dsnu_dominate_on_the_face for entry in self.shots)
        return (
            (
                f"Face in dim light, {LUMINANCE_CD_M2:g} cd/m², {1e3 * EXPOSURE_S:g} ms",
                "pictures; portrait not published",
                f"SNR of green on the face: {shots}",
                f"Read noise and DSNU dominate with {limited} of {len(self.shots)} cameras. Simulated, not measured.",
            ),
        )

    def _table(self) -> Table:
        rows = tuple(
            (
                entry.title if channel == "R" else "",
                channel,
                format_number(noise.mean_e, 3),
                format_uncertain(noise.snr_db, noise.standard_error_db),
                f"{noise.expected_db:.2f}".replace("-", "−"),
            )
            for entry in self.shots
            for channel, noise in entry.shot.face.items()
        )
        numeric = ("Mean signal, e⁻", "SNR of the frame, dB", "SNR from the noise model, dB")
        return Table(
            "Signal-to-noise ratio on the face, raw mosaic",
            (Column("Camera"), Column("Channel"), *(Column(title, numeric=True) for title in numeric)),
            rows,
        )

    def _words(self) -> Paragraph:
        limited = [entry.title for entry in self.shots if entry.read_dsnu_dominate_on_the_face]
        free = [entry.title for entry in self.shots if not entry.read_dsnu_dominate_on_the_face]
        vendor, d200 = self.shots[:2]
        return paragraph(
            "dim_face_noise",
            limited=" and ".join(limited),
            others=f", but not with {' and '.join(free)}" if free else "",
            more=d200.shot.face["G"].snr_db - vendor.shot.face["G"].snr_db,
            light=(vendor.case.f_number / d200.case.f_number) ** 2,
            area=d200.shot.camera.sensor.pixel_area_m2 / vendor.shot.camera.sensor.pixel_area_m2,
            noise=d200.floor_e / vendor.floor_e,
        )


def dim_face(seed: int) -> DimFace:
    """Capture the dimly lit face with each camera of `CAMERAS`, simulated with the sensors of Table 1."""
    scene = portrait_scene(LUMINANCE_CD_M2)
    return DimFace(region_luminance_cd_m2(scene, FACE), tuple(_shoot(case, scene, seed) for case in CAMERAS))


def _shoot(case: Case, scene: Scene, seed: int) -> FaceShot:
    camera = Camera(case.lens, case.sensor(ROWS, COLS).with_(serial=f"{case.key}, section 5"))
    shot = shoot_portrait(camera, scene, EXPOSURE_S, frame_key(seed, f"dim face, {case.key}"))
    return FaceShot(case, shot, white_surface_electrons(camera, filling(scene, camera), EXPOSURE_S))
