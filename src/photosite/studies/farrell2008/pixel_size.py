"""Figure 7: a pixel of 1.4 um against one of 2.2 um, each with and without read noise and DSNU.

Curves follow from the noise model. Pictures and the noise on their faces come from simulated frames. The assumptions
about what the paper does not state are `pixel_size_assumptions` in `text.toml`; the preset files mark assumed values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.metrics.snr import noise_budget, signal_at_snr_e
from photosite.report.numbers import format_number
from photosite.report.page import Column, Paragraph, Table
from photosite.report.style import BLUE, GRAY, VERMILION, styled
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import ILLUMINANT, VENDOR, frame_key
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, listing, paragraph
from photosite.studies.farrell2008.portrait import (
    FACE,
    Captioned,
    Shot,
    portrait_scene,
    portraits_figure,
    region_luminance_cd_m2,
    shoot_portrait,
)
from photosite.values.cfa import channel_sites

LARGE_UM, SMALL_UM = 2.2, 1.4
PRESETS = {LARGE_UM: "vendor-2.2um", SMALL_UM: "vendor-1.4um"}
"""Presets by pixel width in um."""

LUMINANCES_CD_M2 = (5.0, 15.0, 40.0)
"""Luminances of the paper for the vendor sensor."""
PICTURE_LUMINANCE_CD_M2 = 15.0
"""Mean luminance of the portrait."""
PICTURE_ROWS, PICTURE_COLS = {2.2: 300, 1.4: 472}, {2.2: 256, 1.4: 402}
"""Frame sizes by pixel width: the same 0.66 x 0.56 mm of chip."""
GOOD_SNR_DB = 20.0
"""A signal-to-noise ratio of 10, the criterion of ISO 12232 for the first acceptable picture."""

_LOWEST_CD_M2, _POINTS = 0.5, 200
_COLORS = {LARGE_UM: BLUE, SMALL_UM: VERMILION}


@dataclass(frozen=True, eq=False)
class Pixel:
    """Green signal-to-noise ratio of one pixel against the luminance of a white surface, up to saturation, and the
    portrait captured with such pixels.

    `quiet` is whether read noise and DSNU are left out; `luminance_cd_m2` and `snr_db` are (points,).
    """

    width_um: float
    quiet: bool
    sensor: Sensor
    electrons_per_cd_m2: float
    luminance_cd_m2: NDArray[np.float64]
    snr_db: NDArray[np.float64]
    shot: Shot

    @property
    def equal_area_gain_db(self) -> float:
        """Gain of the mean over the area of one 2.2 um pixel; the noise of pixels is independent."""
        return 10 * math.log10((LARGE_UM / self.width_um) ** 2)

    @property
    def equal_area_db(self) -> NDArray[np.float64]:
        """(points,) ratio of the mean over the area of one 2.2 um pixel."""
        return self.snr_db + self.equal_area_gain_db

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
        return signal_at_snr_e(self.sensor, GOOD_SNR_DB - self.equal_area_gain_db) / self.electrons_per_cd_m2

    @property
    def kind(self) -> dict[str, Any]:
        """Width and noise, for `results.json`."""
        return {"width_um": self.width_um, "read_noise_and_dsnu": not self.quiet}

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`, with every tenth point of the curve."""
        return {
            **self.kind,
            "electrons_per_cd_m2": self.electrons_per_cd_m2,
            "saturation_cd_m2": float(self.luminance_cd_m2[-1]),
            "snr_db_at_cd_m2": {f"{level:g}": self.snr_at(level) for level in LUMINANCES_CD_M2},
            "equal_area_gain_db": self.equal_area_gain_db,
            "luminance_of_20_db_cd_m2": self.luminance_of_good_snr_cd_m2,
            "equal_area_luminance_of_20_db_cd_m2": self.equal_area_luminance_of_good_snr_cd_m2,
            "curve": {"luminance_cd_m2": self.luminance_cd_m2[::10].tolist(), "snr_db": self.snr_db[::10].tolist()},
        }


@dataclass(frozen=True, eq=False)
class PixelSize:
    """Result of the chapter: pixels of 2.2 and 1.4 um, each with and without read noise and DSNU, and the
    mean luminance of the face in the pictures."""

    pixels: tuple[Pixel, ...]
    face_luminance_cd_m2: float

    def pixel(self, width_um: float, quiet: bool) -> Pixel:
        """Return the pixel of a width."""
        return next(entry for entry in self.pixels if (entry.width_um, entry.quiet) == (width_um, quiet))

    def lost_db(self, luminance_cd_m2: float, quiet: bool) -> float:
        """Return what one small pixel loses against one large pixel at a luminance."""
        large, small = (self.pixel(width, quiet).snr_at(luminance_cd_m2) for width in (LARGE_UM, SMALL_UM))
        return large - small

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "assumptions": list(listing("pixel_size_assumptions").lines),
            "curves": [pixel.to_dict() for pixel in self.pixels],
            "pictures": {
                "mean_luminance_cd_m2": PICTURE_LUMINANCE_CD_M2,
                "face_luminance_cd_m2": self.face_luminance_cd_m2,
                "frames": [{**pixel.kind, **pixel.shot.to_dict()} for pixel in self.pixels],
            },
        }

    def part(self) -> Part:
        """Return pictures, curves, the values at the luminances of the paper, and the assumptions."""
        columns = [
            Captioned.of(f"{entry.width_um:g} µm, {'without' if entry.quiet else 'with'}\nread noise, DSNU", entry.shot)
            for entry in self.pixels
        ]
        return (
            Drawing.of(
                "figure7-pixel-size-pictures",
                portraits_figure(columns),
                level=PICTURE_LUMINANCE_CD_M2,
                face=self.face_luminance_cd_m2,
            ),
            Drawing.of("figure7-pixel-size-snr", pixel_size_figure(self)),
            self._table(),
            self._words(),
            Paragraph("Assumptions about what the paper does not state:"),
            listing("pixel_size_assumptions"),
        )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the line of Figure 7."""
        level = PICTURE_LUMINANCE_CD_M2
        large, small = (self.pixel(width, False).snr_at(level) for width in (LARGE_UM, SMALL_UM))
        area_db = self.pixel(SMALL_UM, False).equal_area_gain_db
        lost, quiet = (self.lost_db(level, quiet) for quiet in (False, True))
        return (
            (
                f"Figure 7, {LARGE_UM:g} µm against {SMALL_UM:g} µm at {level:g} cd/m²",
                "shown in figures; values not published",
                f"{large:.1f} and {small:.1f} dB on a white surface, one pixel each",
                f"The small pixel loses {lost:.1f} dB, and {lost - area_db:.1f} dB over the same area; without read "
                f"noise and DSNU the areas would differ by {abs(quiet - area_db):.1f} dB.",
            ),
        )

    def _table(self) -> Table:
        rows = tuple(
            (
                f"{curve.width_um:g} µm",
                "no" if curve.quiet else "yes",
                *(f"{curve.snr_at(level):.1f}".replace("-", "−") for level in LUMINANCES_CD_M2),
                format_number(curve.luminance_of_good_snr_cd_m2, 3),
                format_number(float(curve.luminance_cd_m2[-1]), 3),
            )
            for curve in self.pixels
        )
        titles = (*(f"dB at {level:g}" for level in LUMINANCES_CD_M2), "20 dB (10 : 1) at", "Saturates at")
        return Table(
            "Signal-to-noise ratio of one pixel, green, of a white surface; luminances in cd/m²",
            (Column("Pixel"), Column("Read noise and DSNU"), *(Column(title, numeric=True) for title in titles)),
            rows,
        )

    def _words(self) -> Paragraph:
        level = LUMINANCES_CD_M2[0]
        noisy, quiet = (self.lost_db(level, q) for q in (False, True))
        gain = float(self.pixel(SMALL_UM, True).equal_area_db[0] - self.pixel(SMALL_UM, True).snr_db[0])
        noisy_need, quiet_need = (
            self.pixel(SMALL_UM, q).equal_area_luminance_of_good_snr_cd_m2
            / self.pixel(LARGE_UM, q).equal_area_luminance_of_good_snr_cd_m2
            for q in (False, True)
        )
        return paragraph(
            "pixel_size",
            level=level,
            noisy=noisy,
            quiet=quiet,
            gain=gain,
            lost=noisy - gain,
            noisy_need=noisy_need,
            quiet_need=quiet_need,
        )


def pixel_sizes(seed: int) -> PixelSize:
    """Compute Figure 7 of the paper: curves, and the portrait of 15 cd/m2 with the four pixels.

    Frames with and without read noise and DSNU share photon noise and PRNU.
    """
    scene = portrait_scene(PICTURE_LUMINANCE_CD_M2)
    pixels = tuple(_pixel(width, quiet, scene, seed) for width in PRESETS for quiet in (False, True))
    return PixelSize(pixels, region_luminance_cd_m2(scene, FACE))


def pixel_sensor(width_um: float, quiet: bool) -> Sensor:
    """Return the vendor sensor of a pixel width, with or without read noise and DSNU."""
    sensor = load_sensor(PRESETS[width_um])
    return sensor.with_(read_noise_mv=0, dsnu_mv=0) if quiet else sensor


def pixel_snr_db(sensor: Sensor, signal_e: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return the total signal-to-noise ratio at a signal in electrons."""
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    return noise_budget(sensor, np.asarray(signal_e) * v_per_e).total_db


def _pixel(width_um: float, quiet: bool, scene: Scene, seed: int) -> Pixel:
    sensor = pixel_sensor(width_um, quiet)
    small = Camera(VENDOR.lens, sensor.with_(rows=2, cols=2))
    electrons = small.mean_electrons(charts.uniform(ILLUMINANT, 1.0), VENDOR.exposure_s)
    per_cd_m2 = float(electrons[channel_sites(sensor.array.cfa, "G")[0]])
    luminance = np.geomspace(_LOWEST_CD_M2, sensor.saturation_capacity_e / per_cd_m2, _POINTS)
    snr_db = pixel_snr_db(sensor, luminance * per_cd_m2)
    size = {"rows": PICTURE_ROWS[width_um], "cols": PICTURE_COLS[width_um]}
    camera = Camera(VENDOR.lens, sensor.with_(**size, serial=f"{width_um} um, section 5"))
    shot = shoot_portrait(camera, scene, VENDOR.exposure_s, frame_key(seed, f"pixel of {width_um} um"))
    return Pixel(width_um, quiet, sensor, per_cd_m2, luminance, snr_db, shot)


@styled()
def pixel_size_figure(chapter: PixelSize) -> Figure:
    """Draw the ratio against luminance, per pixel and per area."""
    figure = Figure(figsize=(8.6, 4.5))
    left, right = figure.subplots(1, 2, sharey=True)
    _draw(left, chapter, lambda curve: curve.snr_db)
    _draw(right, chapter, lambda curve: curve.equal_area_db)
    left.set_title("one pixel", loc="left")
    right.set_title("the area of one 2.2 µm pixel", loc="left")
    left.set_ylabel("signal-to-noise ratio, green (dB)")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def _draw(axes: Axes, chapter: PixelSize, ratio: Callable[[Pixel], NDArray[np.float64]]) -> None:
    for curve in chapter.pixels:
        label = f"{curve.width_um:g} µm, {'without' if curve.quiet else 'with'} read noise and DSNU"
        style, color = "--" if curve.quiet else "-", _COLORS[curve.width_um]
        axes.plot(curve.luminance_cd_m2, ratio(curve), style, color=color, label=label)
    for level in LUMINANCES_CD_M2:
        axes.axvline(level, color=GRAY, linestyle=":", linewidth=1.0)
        axes.annotate(
            f"{level:g}", (level, 0.0), (3, 4), ("data", "axes fraction"), "offset points", color=GRAY, fontsize=9
        )
    axes.set(xscale="log", xlabel="luminance of a white surface (cd/m²)")
