"""The loop closed on itself: shoot a protocol with a known sensor, calibrate, and compare with what is known."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any, Protocol

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
from photosite.studies.protocol import ShootingProtocol, paper_d200_protocol
from photosite.studies.truth import true_parameters
from photosite.studies.virtual_lab import DEFAULT_LEVEL, VirtualLab, virtual_lab
from photosite.validation.result import Validation
from photosite.validation.validate import validate

CHART_EXPOSURE_S = 1 / 3
FEWEST_PIXELS = 4
"""Of a channel in a patch, for its noise to be compared."""
TOLERANCE_PERCENT = 1.0
"""Difference of patch means and noise let pass: what the calibration's uncertainty may do; many pixels resolve less."""

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
"""The parameters that are compared."""


class Watcher(Protocol):
    """Whoever wants to know how far the study is."""

    def stage(self, what: str) -> None:
        """A stage begins."""
        ...

    def __call__(self, done: int, total: int) -> None:
        """So many frames of the stage are done."""
        ...


@dataclass(frozen=True)
class ParameterRow:
    """A parameter as it is and as it was estimated.

    Parameters
    ----------
    name, label, unit
        What it is called in results and in words, and its unit in symbols.
    true
        From the true sensor's description and the light it was shot in.
    estimated, standard_uncertainty
        The estimate; None where there is none.
    reason
        Why there is no estimate.
    """

    name: str
    label: str
    unit: str
    true: float
    estimated: float | None
    standard_uncertainty: float | None
    reason: str | None

    @property
    def deviation(self) -> float | None:
        """Estimate less truth in standard uncertainties; None without an estimate, or where it is exact."""
        if self.estimated is None or not self.standard_uncertainty:
            return None
        return (self.estimated - self.true) / self.standard_uncertainty


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """What the closed loop found.

    Parameters
    ----------
    true_sensor
        The sensor that shot the frames.
    calibration
        What was estimated from them; its `sensor` is the calibrated sensor.
    parameters
        Truth and estimate side by side.
    scene
        The ColorChecker.
    true_raw, calibrated_raw
        The chart by the true sensor, and by the calibrated one: another chip (serial) and other temporal noise.
    validation
        The first as measured against the second as simulated.
    frames_shot
        Frames behind the calibration.
    protocol
        What was shot.
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
    frames_shot: int
    protocol: ShootingProtocol
    seconds: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """The parameters by name: true, estimated, standard_uncertainty, and the reason where there is one."""
        entries = {}
        for row in self.parameters:
            entry: dict[str, Any] = {
                "true": row.true,
                "estimated": row.estimated,
                "standard_uncertainty": row.standard_uncertainty,
            }
            entries[row.name] = entry if row.reason is None else {**entry, "reason": row.reason}
        return {"parameters": entries}


def closed_loop(
    sensor: Sensor,
    protocol: ShootingProtocol | None = None,
    *,
    illuminant: str = "D65",
    level: float = DEFAULT_LEVEL,
    photons_known: bool = False,
    seed: int = 0,
    folder: str | PathLike[str] | None = None,
    source: str | None = None,
    watcher: Watcher | None = None,
) -> ClosedLoop:
    """Shoot, calibrate, simulate a ColorChecker with the true and with the calibrated sensor, compare.

    Parameters
    ----------
    sensor
        The true sensor, as it is: darks that clip at 0 tell less than others (`virtual_lab.with_pedestal`).
    protocol
        What to shoot; the 2008 paper's if None.
    illuminant, level, photons_known
        Light of the flat frames, as for `virtual_lab.virtual_lab`.
    seed
        Key of the temporal noise.
    folder
        Where to write the frames and read them back from, as someone with a camera would; it must not hold anything.
        None makes each frame when it is read, from the same numbers.
    source
        What the calibration calls its frames, if not by the folder: one that is to be moved or removed, say.
    watcher
        Is told of stages and frames.

    Raises
    ------
    CalibrationError
        If the frames cannot support a calibration.
    InputError, FileError
        If an argument cannot be, a patch of the ColorChecker would hold too few pixels, or the folder cannot be
        written.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.studies.virtual_lab import with_pedestal
    >>> loop = closed_loop(with_pedestal(ps.load_sensor("nikon-d200").with_(rows=66, cols=98)))
    >>> gain = next(row for row in loop.parameters if row.name == "system_gain_dn_per_e")
    >>> round(gain.true, 4), abs(gain.deviation) < 4
    (0.1253, True)
    """
    watch = watcher or Silence()
    protocol = protocol or paper_d200_protocol()
    lab = virtual_lab(sensor, protocol, illuminant=illuminant, level=level, seed=seed, photons_known=photons_known)
    chart = charts.macbeth("A", 40)
    _check_patches(sensor, chart)
    seconds: dict[str, float] = {}
    with _timed(seconds, "shoot"):
        frames = _shoot(lab, folder, watch)
        frames = frames if source is None else replace(frames, source=source)
    with _timed(seconds, "calibrate"):
        watch.stage(f"calibrating from {protocol.frame_count} frames")
        calibration = calibrate(frames, progress=watch)
    with _timed(seconds, "simulate"):
        watch.stage("simulating a ColorChecker with the true and with the calibrated sensor")
        true_raw = _portrait(sensor, chart, seed, protocol.frame_count)
        simulated = calibration.sensor.with_(serial=f"{sensor.serial}, calibrated")
        calibrated_raw = _portrait(simulated, chart, seed, protocol.frame_count + 1)
    with _timed(seconds, "compare"):
        watch.stage("comparing them")
        validation = validate(true_raw, calibrated_raw, chart="macbeth", tolerance_percent=TOLERANCE_PERCENT)
    return ClosedLoop(
        sensor,
        calibration,
        compared_parameters(lab, calibration),
        chart,
        true_raw,
        calibrated_raw,
        validation,
        protocol.frame_count,
        protocol,
        seconds,
    )


def compared_parameters(lab: VirtualLab, calibration: Calibration) -> tuple[ParameterRow, ...]:
    """Truth and estimate side by side, for the parameters of `HEADLINE`."""
    truth = true_parameters(lab.camera.sensor, lab.light, lab.camera.optics)
    estimates = calibration.estimates()
    return tuple(
        ParameterRow(
            name,
            PARAMETER_LABELS[name].label,
            PARAMETER_LABELS[name].unit,
            truth[name],
            estimates[name].value,
            estimates[name].standard_uncertainty,
            estimates[name].reason,
        )
        for name in HEADLINE
    )


def _shoot(lab: VirtualLab, folder: str | PathLike[str] | None, watch: Watcher) -> FrameSet:
    array = lab.camera.sensor.array
    watch.stage(f"shooting {lab.protocol.frame_count} frames of {array.rows} x {array.cols} pixels")
    if folder is None:
        return lab.frame_set()
    lab.write(folder, watch)
    return open_frames(folder)


def _check_patches(sensor: Sensor, chart: Scene) -> None:
    """Whether the comparison at the end can be made: worth knowing before hundreds of frames are shot."""
    array = sensor.array
    blank = RawFrame(np.zeros((array.rows, array.cols), np.uint16), sensor.readout.bits, array.cfa)
    pixels = patch_statistics(blank, _camera(sensor).image_regions(chart)).pixels
    if pixels.min() < FEWEST_PIXELS:
        raise InputError(
            f"frames of {array.rows} x {array.cols} pixels leave {pixels.min()} of a channel in a patch of the chart; "
            f"comparing its noise needs {FEWEST_PIXELS}: take more rows and columns"
        )


def _camera(sensor: Sensor) -> Camera:
    return Camera(DiffractionLimited(f_number=8, focal_length_mm=50), sensor)


def _portrait(sensor: Sensor, chart: Scene, seed: int, frame: int) -> RawFrame:
    """The chart at the paper's conditions."""
    return _camera(sensor).capture(chart, CHART_EXPOSURE_S, seed=seed, frame=frame)


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - begin


class Silence:
    """A watcher who does not want to know."""

    def stage(self, what: str) -> None:
        """Nothing."""

    def __call__(self, done: int, total: int) -> None:
        """Nothing."""
