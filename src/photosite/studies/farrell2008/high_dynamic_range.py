"""Section 5, a scene of high dynamic range: one portrait in bright light beside one in shade, and a gray wedge.

The scene of the paper is unknown. This one makes its numbers easy to check: each step of the wedge is half as bright as
the one before.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.develop.develop import develop
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.metrics.snr import noise_budget, signal_at_snr_e
from photosite.report.page import Paragraph
from photosite.report.style import BLUE, GRAY, VERMILION, new_figure, styled
from photosite.scene.pictures import from_rgb
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.studies.farrell2008.cameras import CASES, Case, frame_key
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, paragraph, text
from photosite.studies.farrell2008.portrait import (
    PORTRAIT_WIDTH_M,
    filling,
    portrait,
    portrait_source,
    white_exposure,
    white_surface_electrons,
)
from photosite.studies.farrell2008.snr import uniform_snr
from photosite.values.cfa import channel_mask
from photosite.values.region import Region
from photosite.values.uncertain import COVERAGE_95

SHADE = 1 / 64
"""Light on the right portrait relative to the left one."""
STEPS = 12
"""Steps of the wedge, from 1 to 1/2048 of a white surface in the bright light."""
ILLUMINANT, WHITE_CD_M2 = "D65", 2000.0
"""Daylight on a white surface by a window, an assumption that affects the exposure times only."""
WHITE_SHARE = 0.85
"""Signal of a white surface in the bright light relative to saturation."""

_WEDGE_ROWS, _WEDGE_INSET = 60, 4
_SAMPLES_PER_PIXEL = 2
_CHANNEL = "G"
_SEEN_ERRORS = 3.0
_LOOKS = (("o", "-", BLUE), ("s", "--", VERMILION))


@dataclass(frozen=True, eq=False)
class Wedge:
    """Green signal of the wedge; arrays are (steps,), brightest first. `level` is the light relative to the brightest
    step.

    `mean_e` includes diffraction from brighter parts of the scene. A frame's transform is periodic, so that light also
    arrives from the opposite border (0.0004 of the brightest step at the darkest one of the D200). `snr_db` is that of
    the raw frame, as in `snr.uniform_snr`; None if the mean is less than three standard errors above black.
    """

    level: NDArray[np.float64]
    mean_e: NDArray[np.float64]
    snr_db: tuple[float | None, ...]
    standard_error_db: tuple[float | None, ...]
    expected_db: NDArray[np.float64]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {name: np.asarray(values).tolist() for name, values in asdict(self).items()}


@dataclass(frozen=True, eq=False)
class HdrShot:
    """The scene captured with one camera, with white in the bright light at 85 % of the range.

    Pictures are (rows, cols, 3) in display sRGB: `picture` is exposed for the bright light, `lifted` is the same frame
    brightened for the shade.
    """

    case: Case
    sensor: Sensor
    exposure_s: float
    picture: NDArray[np.float32]
    lifted: NDArray[np.float32]
    wedge: Wedge

    @property
    def dynamic_range_db(self) -> float:
        """Dynamic range of the sensor: 20 log10 of the saturation capacity over the signal at an SNR of 0 dB.

        EMVA 1288 uses the signal that equals the temporal noise. Here, as in Figure 6, the fixed pattern counts as
        noise.
        """
        return 20 * math.log10(self.sensor.saturation_capacity_e / signal_at_snr_e(self.sensor, 0.0))

    def steps_above(self, snr_db: float) -> int:
        """Return the number of steps whose expected ratio exceeds a value."""
        return int((self.wedge.expected_db > snr_db).sum())

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "exposure_s": self.exposure_s,
            "pixels": list(self.picture.shape[:2]),
            "dynamic_range_db": self.dynamic_range_db,
            "wedge": self.wedge.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class HighDynamicRange:
    """Result of the chapter: the scene captured with both cameras."""

    shots: tuple[HdrShot, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "portrait": portrait_source(),
            "shade": SHADE,
            "white_cd_m2": WHITE_CD_M2,
            "cameras": {shot.case.key: shot.to_dict() for shot in self.shots},
        }

    def part(self) -> Part:
        """Return the pictures, the wedge with the noise budgets, and the dynamic ranges in words."""
        return (
            paragraph("high_dynamic_range", times=1 / SHADE, steps=STEPS, white=WHITE_CD_M2, percent=100 * WHITE_SHARE),
            Drawing.of("section5-high-dynamic-range", hdr_figure(self), times=1 / SHADE),
            Drawing.of("section5-high-dynamic-range-wedge", wedge_figure(self)),
            Paragraph(" ".join(_words(shot) for shot in self.shots)),
        )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the line of the scene."""
        ranges = ", ".join(f"{shot.dynamic_range_db:.0f} dB ({shot.case.title})" for shot in self.shots)
        here = f"Dynamic range of one frame: {ranges}"
        return (("Scene of high dynamic range", "pictures; scene not published", here, "Simulated, not measured."),)


def high_dynamic_range(seed: int) -> HighDynamicRange:
    """Capture the scene of 360 x 512 pixels with both cameras, each exposed for the bright light."""
    scene = hdr_scene()
    return HighDynamicRange(tuple(_shoot(case, scene, seed) for case in CASES))


def hdr_scene() -> Scene:
    """Return two portraits side by side, the right one in shade, above a gray wedge with a region per step.

    White in the bright light has weights of 1 and 2000 cd/m2.

    Examples
    --------
    >>> scene = hdr_scene()
    >>> scene.shape, float(scene.weights[0, -1, -1] * 2048), len(scene.regions)
    ((360, 512), 1.0, 12)
    """
    print_ = from_rgb(portrait(), ILLUMINANT)
    white = Scene.uniform(print_.basis.sum(axis=0), print_.wavelength_nm).mean_luminance_cd_m2()
    n = _SAMPLES_PER_PIXEL
    _, rows, cols = print_.weights.shape
    small = print_.weights.reshape(3, rows // n, n, cols // n, n).mean(axis=(2, 4))
    rows, cols = small.shape[1:]
    weights = np.empty((3, rows + _WEDGE_ROWS, 2 * cols), np.float32)
    weights[:, :rows, :cols], weights[:, :rows, cols:] = small, SHADE * small
    edges = np.linspace(0, 2 * cols, STEPS + 1).round().astype(int)
    inset, regions = _WEDGE_INSET, []
    for step, (left, right) in enumerate(itertools.pairwise(edges.tolist())):
        weights[:, rows:, left:right] = 0.5**step
        end = rows + _WEDGE_ROWS - inset
        regions.append(Region(f"step {step}", rows + inset, end, left + inset, right - inset))
    scene = replace(print_, weights=weights, regions=tuple(regions), name="portraits in bright light and in shade")
    return scene.scaled(WHITE_CD_M2 / white)


def _shoot(case: Case, scene: Scene, seed: int) -> HdrShot:
    rows, cols = scene.shape
    sensor = case.sensor(rows, cols).with_(serial=f"{case.key}, section 5")
    camera = Camera(case.lens, sensor)
    placed = filling(scene, camera, 2 * PORTRAIT_WIDTH_M)
    exposure_s = WHITE_SHARE * sensor.saturation_capacity_e / white_surface_electrons(camera, placed, 1.0)
    mean_e = camera.mean_electrons(placed, exposure_s)
    raw = camera.expose(mean_e, exposure_s, seed=frame_key(seed, f"high dynamic range, {case.key}"))
    white = white_exposure(camera, placed, exposure_s)
    return HdrShot(
        case,
        sensor,
        exposure_s,
        picture=develop(raw, "gray-world", exposure=white),
        lifted=develop(raw, "gray-world", exposure=white / SHADE),
        wedge=_wedge(raw, mean_e, sensor, camera.image_regions(placed)),
    )


def _wedge(raw: RawFrame, mean_e: NDArray[np.float32], sensor: Sensor, regions: tuple[Region, ...]) -> Wedge:
    v_per_e = sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    read = patch_statistics(raw, regions)
    green = channel_mask(raw.cfa, _CHANNEL, raw.shape)
    light_e, shown = [], []
    for step, region in enumerate(regions):
        inside = (slice(region.r0, region.r1), slice(region.c0, region.c1))
        light_e.append(float(mean_e[inside][green[inside]].mean(dtype=np.float64)))
        at = step, read.channels.index(_CHANNEL)
        seen = read.mean_dn[at] > _SEEN_ERRORS * read.standard_error_dn[at]
        shown.append(uniform_snr(read, step, _CHANNEL)[1:] if seen else (None, None))
    snr_db, errors_db = zip(*shown, strict=True)
    expected_db = noise_budget(sensor, np.array(light_e) * v_per_e).total_db
    level = np.asarray(0.5 ** np.arange(STEPS), dtype=np.float64)
    return Wedge(level, np.array(light_e), snr_db, errors_db, expected_db)


@styled()
def hdr_figure(chapter: HighDynamicRange) -> Figure:
    """Draw the frame of each camera at two brightnesses."""
    figure = Figure(figsize=(8.6, 6.5))
    panels = figure.subplots(len(chapter.shots), 2)
    for line, shot in zip(panels, chapter.shots, strict=True):
        for axes, picture, what in (
            (line[0], shot.picture, "exposed for the bright light"),
            (line[1], shot.lifted, f"the same frame, {1 / SHADE:g} times brighter"),
        ):
            axes.imshow(picture, interpolation="none")
            axes.set_axis_off()
            axes.set_title(f"{shot.case.title}, {what}", loc="left")
    return figure


@styled()
def wedge_figure(chapter: HighDynamicRange) -> Figure:
    """Draw the steps of the wedge and the noise budgets."""
    figure, axes = new_figure(height_in=4.4)
    for shot, (marker, line, color) in zip(chapter.shots, _LOOKS, strict=True):
        wedge, title = shot.wedge, shot.case.title
        white_e = wedge.mean_e[0]
        light = np.geomspace(0.5**STEPS, 1.0, 200)
        volts = light * white_e * shot.sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
        budget = noise_budget(shot.sensor, volts).total_db
        axes.plot(light, budget, line, color=color, label=f"{title}, noise budget")
        pairs = zip(wedge.mean_e / white_e, wedge.snr_db, wedge.standard_error_db, strict=True)
        x, snr_db, error_db = np.array([found for found in pairs if found[1] is not None], dtype=np.float64).T
        axes.errorbar(
            x,
            snr_db,
            COVERAGE_95 * error_db,
            fmt=marker,
            color=color,
            markerfacecolor="white",
            elinewidth=1.0,
            label=f"{title}, frame",
        )
    axes.axhline(0.0, color=GRAY, linewidth=0.8)
    axes.axvline(SHADE, color=GRAY, linewidth=1.0, linestyle=":")
    axes.annotate(
        "white in the shade",
        (SHADE, 1.0),
        (-5, -4),
        ("data", "axes fraction"),
        "offset points",
        ha="right",
        va="top",
        color=GRAY,
        fontsize=9,
    )
    axes.set_xscale("log", base=2)
    axes.set(xlabel="light, relative to white in the bright light", ylabel="signal-to-noise ratio, green (dB)")
    axes.legend(loc="lower right")
    return figure


def _words(shot: HdrShot) -> str:
    return text(
        "high_dynamic_range_camera",
        title=shot.case.title,
        decibel=shot.dynamic_range_db,
        stops=shot.dynamic_range_db / (20 * np.log10(2)),
        above_0=shot.steps_above(0.0),
        above_20=shot.steps_above(20.0),
        steps=STEPS,
        in_shade=f"{shot.wedge.expected_db[round(-np.log2(SHADE))]:.1f}".replace("-", "−"),
    )
