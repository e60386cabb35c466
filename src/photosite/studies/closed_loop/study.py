"""The closed loop: shoot a protocol with a known sensor, calibrate, simulate, and compare with the truth."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np

from photosite.calibration.calibrate import calibrate
from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.calibration.result import Calibration
from photosite.camera.camera import Camera
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSet
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.studies.progress import NoProgress, Progress
from photosite.studies.protocol import ShootingProtocol, paper_d200_protocol
from photosite.studies.truth import true_parameters
from photosite.studies.virtual_lab import VirtualLab, virtual_lab
from photosite.validation.result import Validation
from photosite.validation.validate import validate

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
class ClosedLoop:
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
        calibration = calibrate(frames, progress=progress)
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
