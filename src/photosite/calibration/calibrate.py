"""From dark frames and flat fields to the sensor's parameters: the frames decide on the kind of calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, Literal, TypeAlias

from photosite.calibration.captures.combined import calibrate_combined
from photosite.calibration.captures.each_capture import calibrate_captures
from photosite.calibration.gain_series.calibrate_series import calibrate_series
from photosite.calibration.photon_transfer.knees import SeveralCapturesError
from photosite.calibration.reduction.frame_reader import Progress
from photosite.calibration.setting import MapsWanted, calibrate_setting
from photosite.calibration.settings_result import OneSetting, SettingsCalibration
from photosite.calibration.spatial.spatial_analysis import OutlierThresholds
from photosite.calibration.withheld import SEVERAL_CAPTURES
from photosite.errors import CalibrationError, InputError
from photosite.frames.conditions import label
from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.values.diagnostic import Diagnostic

CalibrationKind = Literal["setting", "series", "captures", "combined", "settings"]
"""What frames hold: one gain setting and capture, several gain settings, the frames of each capture of one exposure,
frames that combine captures, or several settings that differ in more than the gain."""

AnyCalibration: TypeAlias = OneSetting | SettingsCalibration

_OPTIONS: dict[CalibrationKind, tuple[str, ...]] = {
    "setting": ("outliers", "maps", "checkpoint", "processes", "scheduler"),
    "series": ("checkpoint",),
    "captures": ("outliers", "maps"),
    "combined": (),
    "settings": ("outliers", "maps", "processes", "scheduler"),
}
"""The options that each kind of calibration has."""

_DEFAULTS = {"maps": False, "processes": 1}
"""Defaults of options that are not None."""


def calibrate(
    frames: FrameSet | Mapping[str, FrameSet] | Sequence[FrameSet],
    sensor: Sensor | None = None,
    *,
    outliers: OutlierThresholds | None = None,
    maps: MapsWanted = False,
    progress: Progress | None = None,
    checkpoint: str | PathLike[str] | None = None,
    processes: int | None = 1,
    scheduler: str | None = None,
) -> AnyCalibration:
    """Estimate a sensor's parameters, with standard uncertainties, from dark frames and flat fields.

    Each group of frames is reduced to exact integer sums, in memory that does not grow with the number of frames. The
    methods are those of EMVA 1288 R4.0 and, for read noise, DSNU, PRNU and dark voltage, of Farrell, Okincha and
    Parmar, Proc. SPIE 6817 (2008); each estimate names its own.

    The frames decide on the kind of calibration. Those of one gain setting give a `Calibration`. Several gain settings
    are calibrated one by one and analyzed together. The frames of each capture of one exposure (high dynamic range),
    in a mapping, give the captures and the ratios of their sensitivities. Frames that combine captures are those of
    more than 16 bits, of a sensor with captures, or with steps of the temporal variance; they show the captures by
    their noise. Several settings (`photosite.frames.open.open_settings`), in a list, are calibrated one by one.

    Parameters
    ----------
    frames
        The measurement: dark frames, at least two of them at one exposure, and flat fields at two or more levels. Of
        an incomplete set, what it shows is estimated, and the other parameters have the reason why they are missing.
        Or one frame set for each capture, by name, from the most to the least sensitive. The light and the exposure
        times are those of the frame that the captures belong to, the same for all. Or a list of the frame sets of
        settings that differ in the filter, the read mode or another condition.
    sensor
        The sensor as known before the measurement, for millivolts, for `Calibration.sensor` and for the companding
        table of combined frames; default `frames.sensor`. Of several gain settings, it describes the lowest.
    outliers
        Thresholds for the deviating pixels listed in `Calibration.spatial`. One setting, or each capture.
    maps
        Also measure `Calibration.chip` and `Calibration.temporal`. All frames are read once more, and the dark frames
        for the read noise twice. Dark frames clipped at 0 give no maps: `Calibration.no_maps_reason` and a warning.
        "gain": also the gain of each pixel (`Calibration.pixel_gains`), which takes a hundred frames or more.
        One setting, or each capture.
    progress
        Called with (frames read, frames to read) after each frame. The second number grows where frames must be read
        again, and the count starts again for the maps.
    checkpoint
        Folder for intermediate sums, three times the size of a frame per exposure. An interrupted run resumes from it
        with bit-identical results when it is called again with the same frames. The files are removed at the end. One
        run at a time may use the folder. One or several settings.
    processes, scheduler
        Number of local processes (None: one for each core), or address of a Dask scheduler, whose workers read the
        frames first; sums are merged without rounding, and the result is the same. One process already reads in several
        threads, so that this pays where reading takes long: large compressed files, several disks. One setting.

    Returns
    -------
    Calibration, GainSeries, CaptureCalibration, CombinedCalibration or SettingsCalibration
        Parameters that could not be estimated have a reason instead of a value.

    Raises
    ------
    CalibrationError
        If the frames cannot support a calibration, for example: some frames have no gain setting, black levels clipped
        too far, flat fields that contradict the stated light or bit depth.
    FileError
        If a frame cannot be read or has another size, or the checkpoint folder holds other files or is in use.
    InputError
        If `frames` is not a FrameSet or a mapping of them, or `sensor` cannot have taken these frames; if there is no
        scheduler, or a checkpoint with several workers; if the frames' kind of calibration lacks an option.
    WorkerError
        If frames end the workers that read them.

    Examples
    --------
    >>> from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> def group(kind, exposure_s, electrons):
    ...     stack = 64 + 0.5 * rng.poisson(electrons, (8, 32, 32)) + rng.normal(0, 2, (8, 32, 32))
    ...     sources = [FrameSource(f"{kind}-{i}", lambda dn=dn: dn) for i, dn in enumerate(np.uint16(stack + 0.5))]
    ...     return FrameGroup(kind, exposure_s, tuple(sources))
    >>> groups = [group("dark", 0.01, 0), *(group("light", t, 1e5 * t) for t in (0.01, 0.02, 0.03))]
    >>> cal = calibrate(FrameSet(tuple(groups), rows=32, cols=32, bits=12))
    >>> low, high = cal.system_gain_dn_per_e.interval_95
    >>> low < 0.5 < high, cal.quantum_efficiency_percent.reason
    (True, 'the photons per pixel are not known; give them in a descriptor or a protocol')
    """
    kind = calibration_kind(frames, sensor)
    given = {"outliers": outliers, "maps": maps, "checkpoint": checkpoint, "processes": processes}
    given["scheduler"] = scheduler
    check_options(kind, given)
    if not isinstance(frames, FrameSet | Mapping):
        return _calibrate_settings(frames, sensor, {**given, "progress": progress})
    if not isinstance(frames, FrameSet):
        return calibrate_captures(frames, sensor, outliers=outliers, maps=maps, progress=progress)
    if kind == "series":
        return calibrate_series(frames, sensor, progress, checkpoint=checkpoint)
    if kind == "combined":
        return calibrate_combined(frames, sensor)
    try:
        return calibrate_setting(
            frames,
            sensor,
            outliers=outliers,
            maps=maps,
            progress=progress,
            checkpoint=checkpoint,
            processes=processes,
            scheduler=scheduler,
        )
    except SeveralCapturesError as error:
        check_options("combined", given)
        found = calibrate_combined(frames, sensor)
        seen = Diagnostic(SEVERAL_CAPTURES.id, "note", f"{error.what}; the captures are distinguished by their noise")
        return replace(found, diagnostics=(seen, *found.diagnostics))


def _calibrate_settings(
    settings: Sequence[FrameSet], sensor: Sensor | None, options: Mapping[str, Any]
) -> SettingsCalibration:
    found: dict[str, OneSetting] = {}
    refused: dict[str, str] = {}
    for frames in settings:
        name = label(frames.conditions)
        kind = calibration_kind(frames, sensor)
        given = {key: value for key, value in options.items() if key in (*_OPTIONS[kind], "progress")}
        try:
            result = calibrate(frames, sensor, **given)
        except CalibrationError as error:
            refused[name] = str(error)
        else:
            assert not isinstance(result, SettingsCalibration)
            found[name] = result
    return SettingsCalibration(found, refused)


def calibration_kind(
    frames: FrameSet | Mapping[str, FrameSet] | Sequence[FrameSet], sensor: Sensor | None = None
) -> CalibrationKind:
    """Return the kind of calibration that frames need, as far as their settings and the sensor show it.

    Frames of one setting may turn out to combine captures, once they are read.

    Raises
    ------
    InputError
        If `frames` is neither a FrameSet nor a mapping of names to them, nor a list of several.

    Examples
    --------
    >>> import numpy as np
    >>> from photosite.frames.frame_set import FrameSet
    >>> frames = [("dark", 0.1, np.zeros((4, 4), np.uint16))] * 2
    >>> calibration_kind(FrameSet.from_arrays(frames, bits=12))
    'setting'
    """
    if isinstance(frames, Mapping) and all(isinstance(each, FrameSet) for each in frames.values()):
        return "captures"
    if isinstance(frames, Sequence) and frames and all(isinstance(each, FrameSet) for each in frames):
        return "settings"
    if not isinstance(frames, FrameSet):
        path = repr(str(frames)) if isinstance(frames, str | PathLike) else "..."
        hint = f"Open the frames with open_frames({path})"
        raise InputError("frames", value=frames, expected="a FrameSet, or one for each capture by name", hint=hint)
    known = sensor if sensor is not None else frames.sensor
    if frames.bits > 16:
        return "combined"
    if len(frames.gain_settings) > 1:
        return "series"
    return "combined" if known is not None and known.captures is not None else "setting"


def check_options(kind: CalibrationKind, given: Mapping[str, Any]) -> None:
    """Check that a kind of calibration has all options that are given.

    Raises
    ------
    InputError
        With the name of the first option that it lacks.
    """
    for name, value in given.items():
        if name not in _OPTIONS[kind] and value != _DEFAULTS.get(name):
            having = " or ".join(_HOLDS[each] for each, names in _OPTIONS.items() if name in names)
            raise InputError(name, value=value, expected=f"omitted for {_HOLDS[kind]}", hint=f"It applies to {having}")


_HOLDS: dict[CalibrationKind, str] = {
    "setting": "frames of one gain setting and capture",
    "series": "several gain settings",
    "captures": "the frames of each capture",
    "combined": "frames that combine captures",
    "settings": "several settings",
}
