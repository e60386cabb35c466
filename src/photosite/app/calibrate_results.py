"""What the page shows of a calibration: tables with intervals, curves, maps of the chip, and files for download."""

from __future__ import annotations

import base64
import math
import os
import pickle
import re
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import singledispatch
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.app.places import Part, Places
from photosite.app.recorded_warnings import recorded_warnings
from photosite.app.workers import Progress
from photosite.calibration.captures.combined import CombinedCalibration
from photosite.calibration.captures.each_capture import CaptureCalibration
from photosite.calibration.chip_maps.pixel_gain import PixelGains
from photosite.calibration.export.noise_profile import calibration_noise_profile
from photosite.calibration.gain_series.result import GainSeries
from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.calibration.photon_transfer.channel import Curve
from photosite.calibration.result import Calibration
from photosite.calibration.settings_result import SHOWN, SettingsCalibration
from photosite.errors import InputError, PhotositeError
from photosite.frames.io.darktable import write_darktable
from photosite.frames.io.libcamera import write_libcamera
from photosite.sensor.chip import DefectKind, MeasuredChip
from photosite.values.estimate import Estimate
from photosite.values.uncertain import COVERAGE_95

MOST_SHOWN = 260_000
"""Pixels of a map on the page: one of every n x n of larger chips."""
MOST_DEFECTS = 5000

Rows = list[dict[str, Any]]
Step = tuple[Calibration, float | None]


@dataclass(frozen=True)
class Result:
    """The result of a calibration for the page.

    Parameters
    ----------
    method, title
        How it was calibrated, and of what.
    parts
        Parameters, those of each channel, curves and maps of the chip, of each gain setting or capture.
    tables, curves
        Results of all parts together.
    files
        Names and addresses of the files for download.
    id
        Name of the result for `write_report`, empty where no files are kept.
    """

    method: str
    title: str
    parts: tuple[dict[str, Any], ...] = ()
    tables: tuple[dict[str, Any], ...] = ()
    curves: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    files: tuple[dict[str, str], ...] = ()
    id: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, for JSON."""
        return asdict(self)


@singledispatch
def result_of(found: object, places: Places) -> Result:
    """Return the result of a calibration for the page."""
    raise TypeError(f"{type(found).__name__} is no calibration")


@result_of.register
def _(found: Calibration, places: Places) -> Result:
    writers: dict[str, Callable[[Path], object]] = {}
    if found.base is not None:
        writers["mine.sensor.yaml"] = found.save
    result_id, files, problems = _written(found, places, writers | _profile_writers(_steps(found)))
    return Result(
        "setting",
        f"{found.frame_count} frames of {found.rows} × {found.cols} pixels, {found.bits} bits",
        parts=(_part("", found),),
        warnings=(*found.warnings, *problems),
        rejected=found.rejected,
        files=files,
        id=result_id,
    )


@result_of.register
def _(found: GainSeries, places: Places) -> Result:
    first = found.steps[0].calibration
    writers: dict[str, Callable[[Path], object]] = {}
    if first.base is not None:
        writers["mine.sensor.yaml"] = found.save
    result_id, files, problems = _written(found, places, writers | _profile_writers(_steps(found)))
    names = ("system_gain_dn_per_e", "read_noise_e", "read_noise_dn", "saturation_capacity_e", "dynamic_range_db")
    switch = found.switch
    rows = [
        {"part": f"{mode.settings[0]:g} to {mode.settings[-1]:g}", **_estimate(label, unit, entry)}
        for mode in found.modes
        for label, unit, entry in (
            ("Noise before the amplifier", "e⁻", mode.pre_amplifier_noise_e),
            ("Noise after the amplifier", "DN", mode.post_amplifier_noise_dn),
        )
    ]
    rows.append({"part": "all", **_estimate("Gain setting of 1 DN per electron", "", found.unity_gain)})
    if switch is not None:
        between = f"{switch.between[0]:g} and {switch.between[1]:g}"
        rows.append(
            {"part": between, **_estimate("Conversion gain above over below the switch", "", switch.gain_ratio)}
        )
    where = (
        "no switch of the conversion gain was found"
        if switch is None
        else f"conversion gain switches between {between}"
    )
    return Result(
        "series",
        f"{len(found.settings)} gain settings: {where}",
        parts=tuple(_part(f"gain setting {step.setting:g}", step.calibration) for step in found.steps),
        tables=({"title": "All gain settings together", "first": "Gain settings", "rows": rows},),
        curves=tuple(_over_settings(found, name) for name in names),
        warnings=(*found.warnings, *problems),
        rejected=tuple(text for step in found.steps for text in step.calibration.rejected),
        files=files,
        id=result_id,
    )


@result_of.register
def _(found: CaptureCalibration, places: Places) -> Result:
    result_id, files, problems = _written(found, places, {})
    rows = [
        {"part": name, **_estimate(label, "", ratios[name])}
        for label, ratios in (
            ("Signal over that of the first capture, in DN", found.signal_ratio),
            ("Sensitivity over that of the first capture, in electrons", found.sensitivity_ratio),
        )
        for name in ratios
    ]
    return Result(
        "captures",
        f"captures {', '.join(found.captures)}",
        parts=tuple(_part(f"capture {name}", each) for name, each in found.captures.items()),
        tables=({"title": "Captures together", "first": "Capture", "rows": rows},),
        warnings=(*found.warnings, *problems),
        rejected=tuple(text for each in found.captures.values() for text in each.rejected),
        files=files,
        id=result_id,
    )


@result_of.register
def _(found: CombinedCalibration, places: Places) -> Result:
    result_id, files, problems = _written(found, places, {})
    count = len(found.captures)
    named: list[tuple[str, Mapping[str, Estimate]]] = [
        *((f"capture {k}", each.estimates()) for k, each in enumerate(found.captures, start=1)),
        *((f"knee {k}", vars(each)) for k, each in enumerate(found.knees, start=1)),
        ("frames", {"black_level_dn": found.black_level_dn}),
    ]
    rows = [
        {"part": what, **_estimate(_label(name), "", entry)}
        for what, entries in named
        for name, entry in entries.items()
    ]
    channels = {}
    for piece in sorted(set(found.piece.tolist())):
        chosen = found.piece == piece
        name = "transition or saturated" if piece < 0 else f"capture {piece + 1}"
        half = COVERAGE_95 * found.variance_uncertainty_dn2[chosen]
        channels[name] = _plain_points(
            found.signal_dn[chosen], found.variance_dn2[chosen], half, np.full(len(half), piece >= 0)
        )
    transfer = {
        "kind": "photon_transfer",
        "title": "Photon transfer of the combined frames",
        "x_label": "signal (DN)",
        "y_label": "variance (DN²)",
        "logarithmic": [True, True],
        "channels": channels,
    }
    return Result(
        "combined",
        f"{count} capture{'s' * (count > 1)} distinguished by their noise",
        tables=({"title": "Parameters", "first": "Part", "rows": rows},),
        curves=(transfer,),
        warnings=(*found.warnings, *problems),
        files=files,
        id=result_id,
    )


@result_of.register
def _(found: SettingsCalibration, places: Places) -> Result:
    writers: dict[str, Callable[[Path], object]] = {
        f"{_file_name(name)}.sensor.yaml": each.save
        for name, each in found.settings.items()
        if isinstance(each, Calibration | GainSeries) and (steps := _steps(each)) and steps[0][0].base is not None
    }
    result_id, files, problems = _written(found, places, writers)
    labels = {parameter: PARAMETER_LABELS[parameter] for parameter in SHOWN}
    rows = [
        {"part": name, **_estimate(label.label, label.unit, getattr(each, parameter))}
        for parameter, label in labels.items()
        for name, each in found.calibrations.items()
    ]
    return Result(
        "settings",
        f"{len(found.settings) + len(found.refused)} settings, each calibrated by itself",
        parts=tuple(_part(f"setting {name}", each) for name, each in found.calibrations.items()),
        tables=({"title": "Settings compared", "first": "Setting", "rows": rows},) if rows else (),
        warnings=(*found.warnings, *problems),
        rejected=tuple(text for each in found.calibrations.values() for text in each.rejected),
        files=files,
        id=result_id,
    )


def _steps(found: Calibration | GainSeries) -> list[Step]:
    """Return the calibrations of a setting and their gain settings."""
    if isinstance(found, GainSeries):
        return [(step.calibration, step.setting) for step in found.steps]
    return [(found, found.gain_setting)]


def _file_name(setting: str) -> str:
    """Return the conditions of a setting as the name of a file."""
    return re.sub(r"[^\w.=-]+", "_", setting.replace(",", "."))


def _part(name: str, found: Calibration) -> dict[str, Any]:
    result = found.to_dict()
    gains = (
        [_estimate("Gain of the pixels, spread", "%", found.pixel_gains.spread_percent)]
        if isinstance(found.pixel_gains, PixelGains)
        else []
    )
    return {
        "name": name,
        "parameters": [*(_row(parameter, entry) for parameter, entry in result["parameters"].items()), *gains],
        "channels": {
            channel: [_row(parameter, entry) for parameter, entry in entries.items()]
            for channel, entries in result["channels"].items()
        },
        "curves": _curves(found),
        "maps": () if found.chip is None else _maps(found.chip),
        "defects": {} if found.chip is None else _defects(found.chip),
    }


def _row(name: str, entry: dict[str, Any]) -> dict[str, Any]:
    label = PARAMETER_LABELS[name]
    interval = entry.get("interval_95")
    return {
        "name": name,
        "label": label.label,
        "unit": label.unit,
        "topic": label.topic,
        "value": _finite(entry["value"]),
        "standard_uncertainty": _finite(entry["standard_uncertainty"]),
        "interval_95": None if interval is None else [_finite(end) for end in interval],
        "upper_limit_95": entry.get("upper_limit_95"),
        "reason": entry.get("reason", ""),
    }


def _estimate(label: str, unit: str, entry: Estimate) -> dict[str, Any]:
    interval = entry.interval_95
    return {
        "label": label,
        "unit": unit,
        "value": _finite(entry.shown_value),
        "interval_95": None if interval is None else [_finite(end) for end in interval],
        "upper_limit_95": entry.upper_limit_95,
        "reason": entry.reason or "",
    }


def _label(name: str) -> str:
    known = PARAMETER_LABELS.get(name)
    text = name.replace("_", " ")
    return f"{known.label} ({known.unit or '1'})" if known is not None else text[:1].upper() + text[1:]


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _curves(found: Calibration) -> list[dict[str, Any]]:
    """Return the points and lines behind the fits, by kind of curve."""
    kinds: dict[str, dict[str, Curve]] = {}
    for channel, curves in found.curves.items():
        for kind, curve in curves.items():
            kinds.setdefault(kind, {})[channel] = curve
    return [
        {
            "kind": kind,
            "title": next(iter(curves.values())).title,
            "x_label": next(iter(curves.values())).x_label,
            "y_label": next(iter(curves.values())).y_label,
            "logarithmic": [False, False],
            "channels": {channel: _points(curve) for channel, curve in curves.items()},
        }
        for kind, curves in kinds.items()
    ]


def _points(curve: Curve) -> dict[str, Any]:
    keep = np.isfinite(curve.x) & np.isfinite(curve.y)
    x, y, u = curve.x[keep], curve.y[keep], curve.y_uncertainty[keep]
    residual: list[float | None] = []
    if curve.intercept is not None and curve.slope is not None:
        spread = np.sqrt(u**2 + curve.extra_variance)
        with np.errstate(divide="ignore", invalid="ignore"):
            residual = [_finite(value) for value in ((y - curve.intercept - curve.slope * x) / spread).tolist()]
    return _plain_points(x, y, COVERAGE_95 * u, curve.used[keep]) | {
        "intercept": curve.intercept,
        "slope": curve.slope,
        "residual": residual,
    }


def _plain_points(
    x: NDArray[np.float64], y: NDArray[np.float64], half_95: NDArray[np.float64], used: NDArray[np.bool_]
) -> dict[str, Any]:
    """Return points without a line."""
    return {
        "x": x.tolist(),
        "y": y.tolist(),
        "half_95": [_finite(value) for value in half_95.tolist()],
        "used": used.tolist(),
        "intercept": None,
        "slope": None,
        "residual": [],
    }


def _over_settings(series: GainSeries, name: str) -> dict[str, Any]:
    """Return a parameter over the gain settings, with its intervals."""
    label = PARAMETER_LABELS[name]
    found = [(step.setting, getattr(step.calibration, name)) for step in series.steps]
    known = [(setting, entry) for setting, entry in found if entry.value is not None]
    halves = np.array([COVERAGE_95 * (entry.standard_uncertainty or 0.0) for _, entry in known])
    points = _plain_points(
        np.array([setting for setting, _ in known]),
        np.array([entry.value for _, entry in known]),
        halves,
        np.ones(len(known), bool),
    )
    proportional = series.scale == "proportional"
    return {
        "kind": name,
        "title": f"{label.label} over the gain setting",
        "x_label": "gain setting",
        "y_label": f"{label.label} ({label.unit})" if label.unit else label.label,
        "logarithmic": [proportional, proportional and name != "dynamic_range_db"],
        "channels": {label.label: points},
    }


# Maps


_MAPS = (
    ("offset_dn", "Offset in the dark (DSNU)", "DN"),
    ("prnu", "Relative response (PRNU)", "%"),
    ("dark_rate_dn_per_s", "Dark current", "DN/s"),
    ("read_noise_dn", "Read noise", "DN"),
    ("pixel_gain_dn_per_e", "Gain of the pixels", "DN/e⁻"),
)


def _maps(chip: MeasuredChip) -> tuple[dict[str, Any], ...]:
    """Return the maps with at most `MOST_SHOWN` pixels, none averaged, and their limits for colors."""
    step = max(math.ceil((chip.shape[0] * chip.shape[1] / MOST_SHOWN) ** 0.5), 1)
    found = []
    for name, title, unit in _MAPS:
        values = getattr(chip, name)
        if values is None:
            continue
        scale = 100.0 if unit == "%" else 1.0
        low, middle, high = (scale * float(q) for q in np.quantile(values, (0.005, 0.5, 0.995)))
        shown = np.ascontiguousarray(values[::step, ::step], "<f4") * np.float32(scale)
        found.append(
            {
                "name": name,
                "title": title,
                "unit": unit,
                "rows": shown.shape[0],
                "cols": shown.shape[1],
                "step": step,
                "range": [low, high],
                "median": middle,
                "standard_deviation": scale * float(values.std()),
                "values": base64.b64encode(shown.tobytes()).decode(),
            }
        )
    return tuple(found)


def _defects(chip: MeasuredChip) -> dict[str, Any]:
    """Return the defective pixels: the number of each kind, and the places of the farthest from the median."""
    found = chip.defects
    order = np.argsort(-np.abs(found.deviation))[:MOST_DEFECTS]
    return {
        "rows": chip.shape[0],
        "cols": chip.shape[1],
        "counts": {name: count for name, count in found.counts().items() if count},
        "listed": [
            [int(found.row[k]), int(found.col[k]), DefectKind(int(found.kind[k])).name.lower(), float(found.value[k])]
            for k in order
        ],
    }


# Files


def _profile_writers(steps: Sequence[Step]) -> dict[str, Callable[[Path], object]]:
    """Return the writers of noise profiles: for darktable, which names a gain setting, and for libcamera."""

    def darktable(path: Path) -> None:
        write_darktable([calibration_noise_profile(*step) for step in steps], path)

    def libcamera(path: Path) -> None:
        write_libcamera(calibration_noise_profile(*steps[0]), path)

    writers: dict[str, Callable[[Path], object]] = {"noise-profile.libcamera.json": libcamera}
    if all(setting is not None for _, setting in steps):
        writers["noise-profiles.darktable.json"] = darktable
    return writers


_KEPT = ".calibration.pickle"
"""The result itself, in the folder of its files: no request can write there or read it."""


def _written(
    found: object, places: Places, writers: Mapping[str, Callable[[Path], object]]
) -> tuple[str, tuple[dict[str, str], ...], list[str]]:
    """Keep a result and write files into a new folder.

    Returns the name of the folder, names and addresses of the files, and why some are missing, with warnings.
    """
    if places.results is None:
        return "", (), []
    folder = places.results / secrets.token_hex(8)
    folder.mkdir(parents=True)
    problems = []
    for name, write in writers.items():
        try:
            with recorded_warnings() as texts:
                write(folder / name)
        except PhotositeError as error:
            problems.append(f"{name} was not written: {error}")
        problems += [text.replace(f"{folder}{os.sep}", "") for text in texts]
    names = sorted(path.name for path in folder.iterdir() if path.is_file())
    (folder / _KEPT).write_bytes(pickle.dumps(found))
    return folder.name, tuple(_file(folder, name) for name in names), problems


def _file(folder: Path, name: str) -> dict[str, str]:
    return {"name": name, "address": f"/api/results/{folder.name}/{name}"}


class ReportRequest(Part):
    """The report of a calibration."""

    result: str = Field(pattern="^[0-9a-f]{16}$", description="The id in the result of a calibration.")


def write_report(request: ReportRequest, places: Places, progress: Progress | None = None) -> dict[str, str]:
    """Write the report of a calibration that is kept and return its name and address.

    Raises
    ------
    InputError
        If the result is not kept.
    """
    folder = None if places.results is None else places.results / request.result
    if folder is None or not (folder / _KEPT).is_file():
        raise InputError("result", value=request.result, expected="one that is kept", hint="Calibrate again")
    report = folder / "report.html"
    if not report.exists():
        if progress is not None:
            progress(0, 0, "drawing")
        pickle.loads((folder / _KEPT).read_bytes()).report(report)
    return _file(folder, report.name)
