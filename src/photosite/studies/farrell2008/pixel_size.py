"""Figure 7: a pixel of 1.4 um against one of 2.2 um, each with and without read noise and DSNU.

Curves follow from the noise model. Pictures and the noise on their faces come from simulated frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.metrics.snr import noise_budget, signal_at_snr_e
from photosite.scene import charts
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import ILLUMINANT, VENDOR, frame_key
from photosite.studies.farrell2008.portrait import (
    FACE,
    Shot,
    portrait_scene,
    region_luminance_cd_m2,
    shoot_portrait,
)
from photosite.values.cfa import channel_sites

PRESETS = {2.2: "vendor-2.2um", 1.4: "vendor-1.4um"}
"""Presets by pixel width in um."""

ASSUMPTIONS = (
    "Both chips have the same area, lens (f/2.8, 4.88 mm) and exposure time (66 ms), and therefore the same "
    "irradiance; the 1.4 µm chip has (2.2 / 1.4)² = 2.47 times the pixels.",
    "Fill factor and quantum efficiency are those of the 2.2 µm pixel: the signal of a pixel in electrons scales with "
    "its area, by 0.405. This assumes that an equally good small pixel can be built.",
    "Well capacity scales with the area, 10 000 and 4050 electrons, and the conversion gain is the same, 100 µV per "
    "electron: the 1.4 µm pixel uses only 0.405 of the voltage swing and clips there.",
    "Read noise, DSNU (in millivolts, and so in electrons) and PRNU are those of Table 1 for both: the paper states "
    "that the noise of the smaller pixel is comparable. There is no dark current in 66 ms.",
    "Without read noise and DSNU, only shot noise and PRNU remain.",
)
"""How the small pixel is scaled; the preset files mark assumed values."""

LUMINANCES_CD_M2 = (5.0, 15.0, 40.0)
"""Luminances of the paper for the vendor sensor."""
PICTURE_LUMINANCE_CD_M2 = 15.0
"""Mean luminance of the portrait."""
PICTURE_ROWS, PICTURE_COLS = {2.2: 300, 1.4: 472}, {2.2: 256, 1.4: 402}
"""Frame sizes by pixel width: the same 0.66 x 0.56 mm of chip."""
GOOD_SNR_DB = 20.0
"""A signal-to-noise ratio of 10, the criterion of ISO 12232 for the first acceptable picture."""

_CHANNEL = "G"
_LOWEST_CD_M2, _POINTS = 0.5, 200


@dataclass(frozen=True, eq=False)
class PixelCurve:
    """Green signal-to-noise ratio of one pixel against the luminance of a white surface, up to saturation.

    Parameters
    ----------
    width_um
        Pixel width.
    quiet
        Whether read noise and DSNU are left out.
    sensor
        Simulated sensor.
    electrons_per_cd_m2
        Signal per luminance.
    luminance_cd_m2, snr_db
        (points,) curve.
    """

    width_um: float
    quiet: bool
    sensor: Sensor
    electrons_per_cd_m2: float
    luminance_cd_m2: NDArray[np.float64]
    snr_db: NDArray[np.float64]

    @property
    def per_large_pixel(self) -> float:
        """Number of these pixels on the area of one 2.2 um pixel."""
        return (max(PRESETS) / self.width_um) ** 2

    @property
    def equal_area_db(self) -> NDArray[np.float64]:
        """(points,) ratio of the mean over the area of one 2.2 um pixel; the noise of pixels is independent."""
        return self.snr_db + 10 * math.log10(self.per_large_pixel)

    def snr_at(self, luminance_cd_m2: float) -> float:
        """Return the ratio in dB at a luminance below saturation."""
        return float(pixel_snr_db(self.sensor, luminance_cd_m2 * self.electrons_per_cd_m2))

    @property
    def luminance_of_good_snr_cd_m2(self) -> float:
        """Luminance at which a pixel has 20 dB."""
        return signal_at_snr_e(self.sensor, GOOD_SNR_DB) / self.electrons_per_cd_m2

    @property
    def equal_area_luminance_of_good_snr_cd_m2(self) -> float:
        """Luminance at which the mean over the area of one 2.2 um pixel has 20 dB."""
        one_db = GOOD_SNR_DB - 10 * math.log10(self.per_large_pixel)
        return signal_at_snr_e(self.sensor, one_db) / self.electrons_per_cd_m2

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`, with every tenth point of the curve."""
        return {
            "width_um": self.width_um,
            "read_noise_and_dsnu": not self.quiet,
            "electrons_per_cd_m2": self.electrons_per_cd_m2,
            "saturation_cd_m2": float(self.luminance_cd_m2[-1]),
            "snr_db_at_cd_m2": {f"{level:g}": self.snr_at(level) for level in LUMINANCES_CD_M2},
            "equal_area_gain_db": 10 * math.log10(self.per_large_pixel),
            "luminance_of_20_db_cd_m2": self.luminance_of_good_snr_cd_m2,
            "equal_area_luminance_of_20_db_cd_m2": self.equal_area_luminance_of_good_snr_cd_m2,
            "curve": {"luminance_cd_m2": self.luminance_cd_m2[::10].tolist(), "snr_db": self.snr_db[::10].tolist()},
        }


@dataclass(frozen=True, eq=False)
class PixelPicture:
    """The portrait captured with one pixel size.

    Parameters
    ----------
    width_um, quiet
        As in `PixelCurve`.
    shot
        Frame, picture and noise.
    """

    width_um: float
    quiet: bool
    shot: Shot

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {"width_um": self.width_um, "read_noise_and_dsnu": not self.quiet, **self.shot.to_dict()}


@dataclass(frozen=True, eq=False)
class PixelSize:
    """Result of the chapter.

    Parameters
    ----------
    curves
        2.2 and 1.4 um, each with and without read noise and DSNU.
    pictures
        In the same order.
    face_luminance_cd_m2
        Mean luminance of the face in the pictures.
    """

    curves: tuple[PixelCurve, ...]
    pictures: tuple[PixelPicture, ...]
    face_luminance_cd_m2: float

    def curve(self, width_um: float, quiet: bool) -> PixelCurve:
        """Return the curve of a pixel width."""
        return next(entry for entry in self.curves if (entry.width_um, entry.quiet) == (width_um, quiet))

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "assumptions": list(ASSUMPTIONS),
            "curves": [curve.to_dict() for curve in self.curves],
            "pictures": {
                "mean_luminance_cd_m2": PICTURE_LUMINANCE_CD_M2,
                "face_luminance_cd_m2": self.face_luminance_cd_m2,
                "frames": [picture.to_dict() for picture in self.pictures],
            },
        }


def pixel_sizes(seed: int) -> PixelSize:
    """Compute Figure 7: curves, and the portrait of 15 cd/m2 with the four pixels.

    Parameters
    ----------
    seed
        Seed of the study. Frames with and without read noise and DSNU share photon noise and PRNU.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 5 and Figure 7. `ASSUMPTIONS` lists what the paper does not state.

    Examples
    --------
    >>> sizes = pixel_sizes(2008)
    >>> large, small = (sizes.curve(width, quiet=False).snr_at(5.0) for width in (2.2, 1.4))
    >>> round(large, 1), round(small, 1)
    (-0.9, -8.8)
    """
    kinds = [(width, quiet) for width in PRESETS for quiet in (False, True)]
    scene = portrait_scene(PICTURE_LUMINANCE_CD_M2)
    pictures = []
    for width, quiet in kinds:
        sensor = pixel_sensor(width, quiet).with_(
            rows=PICTURE_ROWS[width], cols=PICTURE_COLS[width], serial=f"{width} um, section 5"
        )
        shot = shoot_portrait(
            Camera(VENDOR.lens, sensor), scene, VENDOR.exposure_s, frame_key(seed, f"pixel of {width} um")
        )
        pictures.append(PixelPicture(width, quiet, shot))
    curves = tuple(_curve(width, quiet) for width, quiet in kinds)
    return PixelSize(curves, tuple(pictures), region_luminance_cd_m2(scene, FACE))


def pixel_sensor(width_um: float, quiet: bool) -> Sensor:
    """Return the vendor sensor of a pixel width, with or without read noise and DSNU."""
    sensor = load_sensor(PRESETS[width_um])
    return sensor.with_(read_noise_mv=0, dsnu_mv=0) if quiet else sensor


def pixel_snr_db(sensor: Sensor, signal_e: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return the total signal-to-noise ratio at a signal in electrons."""
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    return noise_budget(sensor, np.asarray(signal_e) * v_per_e).total_db


def _curve(width_um: float, quiet: bool) -> PixelCurve:
    sensor = pixel_sensor(width_um, quiet)
    small = Camera(VENDOR.lens, sensor.with_(rows=2, cols=2))
    electrons = small.mean_electrons(charts.uniform(ILLUMINANT, 1.0), VENDOR.exposure_s)
    per_cd_m2 = float(electrons[channel_sites(sensor.array.cfa, _CHANNEL)[0]])
    luminance = np.geomspace(_LOWEST_CD_M2, sensor.saturation_capacity_e / per_cd_m2, _POINTS)
    return PixelCurve(width_um, quiet, sensor, per_cd_m2, luminance, pixel_snr_db(sensor, luminance * per_cd_m2))
