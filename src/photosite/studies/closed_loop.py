"""The closed loop: shoot a protocol with a known sensor, calibrate, simulate, and compare with the truth."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.calibration.result import Calibration
from photosite.calibration.setting import calibrate_setting
from photosite.camera.camera import Camera
from photosite.develop.develop import develop_pair
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSet
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.optics.diffraction import DiffractionLimited
from photosite.report.calibration import FOOTER, curve_blocks, provenance_blocks, rejected_blocks, warning_blocks
from photosite.report.diagnostics import explanations
from photosite.report.figures.sensor import noise_budget_figure
from photosite.report.figures.validation import (
    color_difference_figure,
    deviations_figure,
    patch_means_figure,
    patch_snr_figure,
)
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import (
    Block,
    Column,
    Details,
    Image,
    Images,
    Listing,
    Notice,
    Page,
    Paragraph,
    Section,
    Table,
    enlarge,
    figure_block,
    jpeg_bytes,
    magnified,
    sentence,
    shrink,
)
from photosite.report.pages import page
from photosite.scene import charts
from photosite.scene.charts import macbeth_regions
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.studies.progress import NoProgress, Progress
from photosite.studies.protocol import ShootingProtocol, paper_d200_protocol
from photosite.studies.truth import true_parameters
from photosite.studies.virtual_lab import VirtualLab, virtual_lab
from photosite.validation.result import Validation
from photosite.validation.validate import validate
from photosite.values.shown import Reported
from photosite.values.uncertain import COVERAGE_95

CHART_EXPOSURE_S = 1 / 3
FEWEST_PIXELS = 4
"""Pixels of a channel in a patch that a comparison of noise needs."""
TOLERANCE_PERCENT = 1.0
"""Relative tolerance for patch means and noise: it covers the calibration's uncertainty, which many pixels resolve."""

HEADLINE = (
    "read_noise_dn",
    "read_noise_e",
    "read_noise_mv",
    "dsnu_dn",
    "dsnu_e",
    "dsnu_mv",
    "prnu_percent",
    "dark_voltage_mv_per_s",
    "dark_current_e_per_s",
    "system_gain_dn_per_e",
    "saturation_dn",
    "saturation_capacity_e",
    "quantum_efficiency_percent",
    "temporal_dark_noise_e",
    "dsnu1288_e",
    "prnu1288_percent",
    "snr_max_db",
    "dynamic_range_db",
    "sensitivity_threshold_photons",
    "saturation_capacity_photons",
)
"""Parameters that are compared with their true values."""

_TRUE, _CALIBRATED = "true sensor", "calibrated sensor"

_MAGNIFICATION = 8.0
"""Factor for differences between pictures and for noise around a mean color."""

_DETAIL = (48, 72)
"""Largest enlarged part of a picture, (rows, cols) in pixels."""

_DETAIL_ENLARGED = 6
_DETAIL_PATCH = "neutral 3.5"


@dataclass(frozen=True)
class ParameterRow:
    """True value of a parameter, from the true sensor's description and its light, and the estimate or the reason
    why it is missing."""

    name: str
    label: str
    unit: str
    true: float
    estimated: float | None
    standard_uncertainty: float | None
    reason: str | None

    @property
    def deviation(self) -> float | None:
        """Estimate minus truth in standard uncertainties; None without an estimate or uncertainty."""
        if self.estimated is None or not self.standard_uncertainty:
            return None
        return (self.estimated - self.true) / self.standard_uncertainty


@dataclass(frozen=True, eq=False)
class ClosedLoop(Reported):
    """Result of a closed loop.

    Parameters
    ----------
    true_sensor, calibration
        Sensor that the frames were simulated with, and their calibration, whose `sensor` is the calibrated sensor.
    parameters
        True and estimated values.
    scene
        The ColorChecker.
    true_raw, calibrated_raw
        Captures of the chart by the true and the calibrated sensor, with different fixed pattern and temporal noise.
    validation
        Comparison of `true_raw` as measured with `calibrated_raw` as simulated.
    protocol
        Protocol of the frames that were calibrated.
    seconds
        Wall-clock time by stage: shoot, calibrate, simulate, compare.
    """

    true_sensor: Sensor
    calibration: Calibration
    parameters: tuple[ParameterRow, ...]
    scene: Scene
    true_raw: RawFrame
    calibrated_raw: RawFrame
    validation: Validation
    protocol: ShootingProtocol
    seconds: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters by name: true, estimated, standard_uncertainty, and reason where there is one."""
        names = ("true", "estimated", "standard_uncertainty")
        entries: dict[str, Any] = {row.name: {name: getattr(row, name) for name in names} for row in self.parameters}
        for row in self.parameters:
            if row.reason is not None:
                entries[row.name]["reason"] = row.reason
        return {"parameters": entries}


def closed_loop(
    sensor: Sensor,
    protocol: ShootingProtocol | None = None,
    *,
    photons_known: bool = False,
    seed: int = 0,
    folder: str | PathLike[str] | None = None,
    source: str | None = None,
    progress: Progress | None = None,
) -> ClosedLoop:
    """Shoot, calibrate, simulate a ColorChecker with the true and the calibrated sensor, and compare.

    Parameters
    ----------
    sensor
        The true sensor. Clipped dark frames are less informative; `virtual_lab.with_pedestal` prevents clipping.
    protocol
        Frames to take; the D200 protocol of the 2008 paper by default.
    photons_known, seed
        Whether the light of the flat fields is metered, and key of the temporal noise, as for `virtual_lab`.
    folder
        Empty or new folder to write the frames to and read them back from. With None, each frame is simulated when it
        is read; the numbers are the same.
    source
        Name of the frames in the calibration; the folder by default.
    progress
        Receives stages and frame counts.

    Raises
    ------
    CalibrationError
        If the frames cannot support a calibration.
    InputError, FileError
        If an argument is invalid, a patch of the ColorChecker has too few pixels, or the folder cannot be written.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.studies.virtual_lab import with_pedestal
    >>> loop = closed_loop(with_pedestal(ps.load_sensor("nikon-d200").with_(rows=66, cols=98)))
    >>> gain = next(row for row in loop.parameters if row.name == "system_gain_dn_per_e")
    >>> round(gain.true, 4), abs(gain.deviation) < 4
    (0.1253, True)
    """
    progress = progress or NoProgress()
    protocol = protocol or paper_d200_protocol()
    lab = virtual_lab(sensor, protocol, seed=seed, photons_known=photons_known)
    chart = charts.macbeth("A", 40)
    _check_patches(sensor, chart)
    seconds: dict[str, float] = {}
    with _timed(seconds, "shoot"):
        frames = _shoot(lab, folder, progress)
        frames = frames if source is None else replace(frames, source=source)
    with _timed(seconds, "calibrate"):
        progress.stage(f"calibrating from {protocol.frame_count} frames")
        calibration = calibrate_setting(frames, progress=progress)
    with _timed(seconds, "simulate"):
        progress.stage("simulating a ColorChecker with the true and with the calibrated sensor")
        true_raw = _capture_chart(sensor, chart, seed, protocol.frame_count)
        simulated = calibration.sensor.with_(serial=f"{sensor.serial}, calibrated")
        calibrated_raw = _capture_chart(simulated, chart, seed, protocol.frame_count + 1)
    with _timed(seconds, "compare"):
        progress.stage("comparing them")
        validation = validate(true_raw, calibrated_raw, chart="macbeth", tolerance_percent=TOLERANCE_PERCENT)
    return ClosedLoop(
        sensor,
        calibration,
        compared_parameters(lab, calibration),
        chart,
        true_raw,
        calibrated_raw,
        validation,
        protocol,
        seconds,
    )


def compared_parameters(lab: VirtualLab, calibration: Calibration) -> tuple[ParameterRow, ...]:
    """Return true and estimated values of the parameters in `HEADLINE`."""
    truth = true_parameters(lab.camera.sensor, lab.light, lab.camera.optics)
    estimates = calibration.estimates()
    rows = []
    for name in HEADLINE:
        words, found = PARAMETER_LABELS[name], estimates[name]
        values = (truth[name], found.value, found.standard_uncertainty, found.reason)
        rows.append(ParameterRow(name, words.label, words.unit, *values))
    return tuple(rows)


def _shoot(lab: VirtualLab, folder: str | PathLike[str] | None, progress: Progress) -> FrameSet:
    array = lab.camera.sensor.array
    progress.stage(f"shooting {lab.protocol.frame_count} frames of {array.rows} x {array.cols} pixels")
    if folder is None:
        return lab.frame_set()
    lab.write(folder, progress)
    return open_frames(folder)


def _check_patches(sensor: Sensor, chart: Scene) -> None:
    """Raise before hundreds of frames are shot if the patches are too small for the comparison at the end."""
    array = sensor.array
    blank = RawFrame(np.zeros((array.rows, array.cols), np.uint16), sensor.readout.bits, array.cfa)
    fewest = int(patch_statistics(blank, _camera(sensor).image_regions(chart)).pixels.min())
    if fewest < FEWEST_PIXELS:
        raise InputError(
            f"frames of {array.rows} x {array.cols} pixels leave {fewest} pixels of a channel in a patch of the chart, "
            f"fewer than {FEWEST_PIXELS}",
            hint="Pass {rows} and {cols}, or more",
            arguments={"rows": 132, "cols": 196},
        )


def _camera(sensor: Sensor) -> Camera:
    return Camera(DiffractionLimited(f_number=8, focal_length_mm=50), sensor)


def _capture_chart(sensor: Sensor, chart: Scene, seed: int, frame: int) -> RawFrame:
    return _camera(sensor).capture(chart, CHART_EXPOSURE_S, seed=seed, frame=frame)


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - begin


# The page of a closed loop: true and estimated parameters, pictures, comparison, and fits.


@page.register(ClosedLoop)
def demo_page(result: ClosedLoop) -> Page:
    """Return the page of a closed loop."""
    sensor, calibration = result.true_sensor, result.calibration
    array, frames = sensor.array, result.protocol.frame_count
    lead = (
        f"A virtual {sensor.name} of {array.rows} × {array.cols} pixels took {frames} dark frames and flat "
        "fields. A calibration estimated the sensor's parameters from these frames alone. The true and the calibrated "
        "sensor then captured a color chart."
    )
    notice = Notice(
        "All images on this page come from a virtual camera. “Measured” refers to frames of the virtual sensor with "
        "the true parameters; “simulated” refers to frames of the calibrated sensor."
    )
    problems = (*warning_blocks(calibration), *rejected_blocks(calibration), *explanations(calibration.diagnostics))
    sections = (
        Section("Method", (notice, *_method(result))),
        Section("Parameters", parameter_blocks(result.parameters)),
        Section("Pictures", _picture_blocks(result)),
        Section("Comparison", _comparison_blocks(result)),
        Section("Noise budget", (_budget_block(result),)),
        Section("Fits", curve_blocks(calibration)),
        Section("Provenance", (*problems, *provenance_blocks(calibration))),
    )
    return Page(f"Closed loop with a virtual {sensor.name}", lead, sections, FOOTER)


def _method(result: ClosedLoop) -> tuple[Block, ...]:
    metered = any(row.name == "quantum_efficiency_percent" and row.estimated is not None for row in result.parameters)
    protocol = result.protocol
    light = " and the photons per pixel of each exposure" if metered else ""
    steps = (
        f"The virtual sensor took the frames of a protocol ({protocol.name}): {protocol.frame_count} raw frames.",
        "The calibration read the frames. Known beforehand were the pixel's geometry, the converter, the voltage "
        f"swing, the spectral response{light}; the parameters below were not.",
        f"The true and the calibrated sensor captured the same scene ({result.scene.name}) with the same lens, as two "
        "chips of one design: temporal noise and fixed pattern differ.",
        "Patch means, noise and colors of the two raw frames were compared.",
    )
    columns = (Column("Frames"), Column("Exposure (s)", numeric=True), Column("Count", numeric=True))
    rows = tuple((step.kind, format_number(step.exposure_s, 4), str(step.count)) for step in protocol.steps)
    return (
        Listing(steps),
        Details("The protocol", (Table("Frames in the order in which they were taken", columns, rows),)),
    )


def parameter_blocks(parameters: tuple[ParameterRow, ...]) -> tuple[Block, ...]:
    """Return true and estimated values, the parameters without an estimate, and the deviations."""
    found = [row for row in parameters if row.estimated is not None]
    missing = [row for row in parameters if row.estimated is None]
    numeric = ("True", "Estimated ± standard uncertainty", "(Estimated − true) / uncertainty")
    columns = (Column("Parameter"), Column("Unit"), *(Column(title, numeric=True) for title in numeric))
    blocks: list[Block] = [Table("Truth and estimate", columns, tuple(_parameter_row(row) for row in found))]
    if missing:
        lines = tuple((row.label, row.unit, row.reason or "") for row in missing)
        blocks.append(Table("Not estimated", (Column("Parameter"), Column("Unit"), Column("Why")), lines))
    drawn = [(f"{row.label} ({row.unit})", row.deviation) for row in found if row.deviation is not None]
    if drawn:
        inside = sum(abs(deviation) <= COVERAGE_95 for _, deviation in drawn)
        caption = (
            "Estimate minus truth in standard uncertainties. 95 % of the estimates of a correct calibration lie in the "
            f"band, here {inside} of {len(drawn)}. They are not independent: all come from the same frames, some "
            "quantities appear in several units, and those in electrons and decibels share the error of the system "
            "gain."
        )
        figure = deviations_figure(*zip(*drawn, strict=True))
        blocks.append(figure_block(figure, "Estimate minus truth of each parameter", caption))
    return tuple(blocks)


def _parameter_row(row: ParameterRow) -> tuple[str, ...]:
    estimated = "" if row.estimated is None else format_uncertain(row.estimated, row.standard_uncertainty or 0.0)
    deviation = "" if row.deviation is None else f"{row.deviation:+.2f}".replace("-", "−")
    return row.label, row.unit, format_number(row.true, 5), estimated, deviation


def _picture_blocks(result: ClosedLoop) -> tuple[Block, ...]:
    colors = result.validation.color
    both = develop_pair(result.true_raw, result.calibrated_raw, None if colors is None else colors.matrix)
    small, small_calibrated = (shrink(picture) for picture in both)
    detail = _detail(result.true_raw.shape)
    level = both[0][detail].mean(axis=(0, 1))
    noise = (enlarge(magnified(picture[detail], level, _MAGNIFICATION), _DETAIL_ENLARGED) for picture in both)
    difference = jpeg_bytes(magnified(small_calibrated, small, _MAGNIFICATION))
    return (
        _pair(
            (small, small_calibrated),
            "the chart",
            "The chart captured by each sensor, developed in the same way: bilinear demosaic, one color matrix and "
            "one exposure for both.",
        ),
        _pair(
            noise,
            "noise in the chart",
            f"Center of the patch “{_DETAIL_PATCH}”, pixel by pixel: deviations from its mean color, magnified "
            f"{_MAGNIFICATION:g} times. The noise differs; its size and grain should not.",
        ),
        Images(
            (Image(difference, "image/jpeg", "Difference of the two pictures: noise around middle gray"),),
            f"Calibrated minus true, magnified {_MAGNIFICATION:g} times around middle gray. The noise and fixed "
            "pattern of two chips remain, strongest in dark patches, where the display curve is steep. A patch with a "
            "visible color would indicate a wrong parameter.",
        ),
    )


def _detail(shape: tuple[int, int]) -> tuple[slice, slice]:
    region = next(region for region in macbeth_regions(*shape) if region.name == _DETAIL_PATCH)
    rows, cols = (min(most, size) for most, size in zip(_DETAIL, region.shape, strict=True))
    r0, c0 = (region.r0 + region.r1 - rows) // 2, (region.c0 + region.c1 - cols) // 2
    return slice(r0, r0 + rows), slice(c0, c0 + cols)


def _comparison_blocks(result: ClosedLoop) -> tuple[Block, ...]:
    validation = result.validation
    blocks: list[Block] = [
        Paragraph("Result: the two cameras " + ("agree." if validation.agrees else "differ.")),
        Listing(tuple(sentence(line) for line in (*validation.reasons, *validation.notes))),
        figure_block(
            patch_means_figure(validation, _TRUE, _CALIBRATED),
            "Patch means of the true sensor against those of the calibrated sensor",
            "Patch means of each channel on the raw mosaic. Below, the difference relative to the calibrated sensor; "
            "bars are 95 % intervals.",
        ),
        figure_block(
            patch_snr_figure(validation, _TRUE, _CALIBRATED),
            "Patch signal-to-noise ratios of the true sensor against those of the calibrated sensor",
            "Signal-to-noise ratio over the pixels of each patch. Below, the difference; bars are 95 % intervals.",
        ),
    ]
    if validation.color is not None:
        caption = (
            "Color difference between the patch means of the true and the calibrated sensor, through one color "
            "matrix. A difference of about 1 is just visible between adjacent surfaces."
        )
        figure = color_difference_figure(validation.color)
        blocks.append(figure_block(figure, "Color difference of each patch", caption))
    return tuple(blocks)


def _budget_block(result: ClosedLoop) -> Images:
    caption = (
        "Signal-to-noise ratio of one frame of a uniform surface against the signal, in total and for each noise "
        "source alone: lines for the true sensor, rings for the calibrated sensor (Farrell, Okincha and Parmar 2008, "
        "Figure 6)."
    )
    figure = noise_budget_figure(result.true_sensor, result.calibration.sensor)
    return figure_block(figure, "Signal-to-noise ratio against signal, true and calibrated", caption)


def _pair(pictures: Iterable[NDArray[np.float32]], what: str, caption: str) -> Images:
    images = (
        Image(jpeg_bytes(picture), "image/jpeg", f"{what.capitalize()} by the {title}", title.capitalize())
        for picture, title in zip(pictures, (_TRUE, _CALIBRATED), strict=True)
    )
    return Images(tuple(images), caption)
