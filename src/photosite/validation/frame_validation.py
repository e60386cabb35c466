"""Raw frames of a real chart against a simulation of the camera, the light and the exposure time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.develop.develop import develop_pair
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.charts.color_checker import chart_xyz_d65
from photosite.metrics.patches import PatchStatistics, patch_statistics
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens import Optics
from photosite.scene.charts import macbeth
from photosite.scene.placement import check_corners, in_perspective, seen_patches
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.sensor.model import Sensor
from photosite.validation.agreement import dependence
from photosite.validation.diagnosis import corner_orders, diagnose
from photosite.validation.fill_factor import FillFactorFit, fit_fill_factor
from photosite.validation.lamp import Lamp
from photosite.validation.result import Validation
from photosite.validation.validate import check_repeats, compare_patches
from photosite.values.cfa import MONOCHROME, NAMED, channel_names, tile_text
from photosite.values.choice import check_choice
from photosite.values.exposure import check_exposure
from photosite.values.region import Corners, Quadrilateral
from photosite.values.shown import Reported, ResultTable, Shown, Tabular

Fitted = Literal["fill_factor", "light"]
"""Parameters that can be fitted, one at a time, because both scale all patches alike."""

INNER = 0.6
"""Fraction of a patch's side that is compared, about its center; the rest allows for blur and inexact corners."""

MOST_SIMULATED = 10
"""Largest number of frames that are simulated."""

_MARGIN = 0.06  # margin around the chart in pictures, as a fraction of its longer side
_START_CD_M2 = 40.0  # mean luminance of the first simulation where the light level is fitted; the fit is a ratio to it


@dataclass(frozen=True, eq=False)
class CaptureConditions(Shown):
    """The camera and the light that the simulation assumes.

    Parameters
    ----------
    sensor
        The sensor. The simulation uses the size of the frames. The frames are read with the sensor's CFA.
    optics, lamp
        The lens, and the light on the chart.
    exposure_s
        Exposure time; None uses that of the frames.
    luminance_cd_m2
        Mean luminance of the chart's patches; None uses that of the lamp.
    distance_m
        Distance from the lens to the chart.
    """

    sensor: Sensor
    optics: Optics
    lamp: Lamp
    exposure_s: float | None = None
    luminance_cd_m2: float | None = None
    distance_m: float = DEFAULT_DISTANCE_M

    @property
    def lens_text(self) -> str | None:
        """Description of a diffraction-limited lens; None for other lenses."""
        if not isinstance(self.optics, DiffractionLimited):
            return None
        return f"f/{self.optics.f_number:g}, {self.optics.focal_length_mm:g} mm, diffraction-limited"


@dataclass(frozen=True, eq=False)
class FrameValidation(Reported, Tabular):
    """Raw frames against their simulation.

    Parameters
    ----------
    validation
        The comparison of patches, after the fit if there was one.
    conditions
        The assumed conditions, with the exposure time and luminance that were used.
    corners, patches
        Corners of the chart's field of patches, and the compared parts of patches, in pixels.
    fitted, fit
        The fitted parameter and the fit, expressed as a fill factor; None without a fit.
    contradictions
        Contradictions between the files and the sensor file, and impossible fitted values.
    diagnosis, notes
        Likely causes of a difference; assumptions and omissions.
    measured, simulated, frames
        The first measured and the first simulated frame, and the number of each.
    """

    validation: Validation
    conditions: CaptureConditions
    corners: Corners
    patches: tuple[Quadrilateral, ...]
    fitted: Fitted | None
    fit: FillFactorFit | None
    contradictions: tuple[str, ...]
    diagnosis: tuple[str, ...]
    measured: RawFrame
    simulated: RawFrame
    frames: tuple[int, int]
    notes: tuple[str, ...]

    def _table(self) -> ResultTable:
        return self.validation._table()

    def _brief_table(self) -> ResultTable:
        return self.validation._brief_table()

    @property
    def agrees(self) -> bool:
        """Whether patches agree at the stated level and there are no contradictions."""
        return self.validation.agrees and not self.contradictions

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons for the verdict: contradictions, tests, differences and likely causes."""
        return (*self.contradictions, *self.validation.reasons, *self.diagnosis)

    @property
    def fit_summary(self) -> str | None:
        """The fitted value with its standard error and 95 % interval, as text; None without a fit."""
        if self.fit is None:
            return None
        what, unit, scale = "fill factor", "", 1.0
        if self.fitted == "light":
            what, unit = "mean luminance of the patches", " cd/m2"
            scale = (self.conditions.luminance_cd_m2 or 0.0) / self.fit.value
        low, high = (scale * end for end in self.fit.interval_95)
        error = scale * self.fit.standard_error
        places = max(0, 1 - math.floor(math.log10(error))) if error > 0 else 6  # the error to two digits
        value, known, low_end, high_end = (f"{x:.{places}f}" for x in (scale * self.fit.value, error, low, high))
        return f"fitted: {what} {value} ± {known}{unit} (95 % interval {low_end} to {high_end})"

    def pictures(self) -> tuple[NDArray[np.float32], NDArray[np.float32], tuple[int, int]]:
        """Return the chart as measured and as simulated, developed with the same color matrix and exposure.

        The pictures are (rows, cols, 3) in display sRGB. The third value is the (row, col) of their first pixel.
        """
        points = np.asarray(self.corners)
        low, high = points.min(axis=0), points.max(axis=0)
        margin = _MARGIN * float((high - low).max())
        tile = (len(self.measured.cfa), len(self.measured.cfa[0]))
        # The pictures start at a tile of the color filter array.
        top, left = (max(0, math.floor((low[axis] - margin) / tile[axis]) * tile[axis]) for axis in (0, 1))
        bottom, right = (min(self.measured.shape[axis], math.ceil(high[axis] + margin)) for axis in (0, 1))
        seen, made = (
            replace(frame, dn=frame.dn[top:bottom, left:right], captures={})
            for frame in (self.measured, self.simulated)
        )
        color = self.validation.color
        return *develop_pair(seen, made, None if color is None else color.matrix), (top, left)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and strings for JSON."""
        conditions = self.conditions
        return self.validation.to_dict() | {
            "agrees": self.agrees,
            "reasons": list(self.reasons),
            "notes": [*self.notes, *self.validation.notes],
            "contradictions": list(self.contradictions),
            "diagnosis": list(self.diagnosis),
            "sensor": conditions.sensor.name,
            "illuminant": conditions.lamp.name,
            "luminance_cd_m2": conditions.luminance_cd_m2,
            "exposure_s": conditions.exposure_s,
            "distance_m": conditions.distance_m,
            "corners": [list(corner) for corner in self.corners],
            "frames": list(self.frames),
            "fitted": self.fitted,
            "fit": None if self.fit is None else self.fit.to_dict(),
        }


def validate_frames(
    measured: Sequence[RawFrame],
    conditions: CaptureConditions,
    corners: Corners,
    *,
    fit: Fitted | None = None,
    level: float = 0.05,
    tolerance_percent: float = 0.0,
    seed: int = 0,
) -> FrameValidation:
    """Compare raw frames of a ColorChecker with a simulation of the camera, on the raw mosaic.

    The chart is simulated at its position in the frames, with as many frames as were measured (at most 10). Several
    frames are a stack of one scene and setting: means are averaged, and differences give the noise from frame to
    frame. The frames are read with the sensor's CFA, whatever their files contain.

    Parameters
    ----------
    measured
        One frame or more.
    conditions
        The assumed camera and light.
    corners
        Corners of the chart's field of patches, (row, col) in pixels: the outer corners of the dark skin, bluish green,
        black and white patches, in this order.
    fit
        Parameter to fit to the patch means: "fill_factor", or "light" for the light level. Either absorbs every common
        scale of the patches.
    level, tolerance_percent
        As for `photosite.validate`.
    seed
        Seed of the simulation's noise and, unless the sensor file has maps, of its fixed pattern.

    Raises
    ------
    InputError
        If frames differ in settings or two are identical, the corners are invalid, the exposure time or luminance is
        unknown, or as for `photosite.validation.validate.compare_patches`.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 3. The verdict does not include the uncertainties of the sensor file, or
    uneven and stray light on a real chart; use `tolerance_percent` to allow for them.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.validation.lamp import Lamp
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=132, cols=196, black_level_dn=64)
    >>> lens = ps.DiffractionLimited(f_number=8, focal_length_mm=50)
    >>> conditions = CaptureConditions(sensor, lens, Lamp.from_name("A"), luminance_cd_m2=40)
    >>> shot = ps.Camera(lens, sensor).capture(ps.charts.macbeth("A", 40), exposure_s=1 / 3, seed=1)
    >>> validate_frames([shot], conditions, ((4, 4), (4, 192), (128, 192), (128, 4))).agrees
    True
    """
    if not measured:
        raise InputError("measured", value=0, expected="one frame or more")
    if fit is not None:
        check_choice("fit", fit, Fitted)
    check_repeats(measured)
    first = measured[0]
    check_corners(corners, first.shape)
    exposure_s, luminance_cd_m2 = _level(conditions, first, fit)
    sensor, notes = _simulated_sensor(conditions.sensor, first, seed)
    stack = [replace(frame, cfa=sensor.array.cfa) for frame in measured]
    lamp, distance_m = conditions.lamp, conditions.distance_m
    chart = macbeth(lamp.light, luminance_cd_m2, wavelength_nm=lamp.wavelength_nm, distance_m=distance_m)
    patches = seen_patches(chart, corners, INNER)
    seen = patch_statistics(stack, patches)
    simulation = _simulated(conditions, sensor, chart, corners, exposure_s, seed, min(len(stack), MOST_SIMULATED))
    shots = simulation.frames()
    made = patch_statistics(shots, patches)
    found, fill_factor = None, sensor.pixel.fill_factor.value
    if fit is not None:
        found = fit_fill_factor(seen, made, fill_factor)
        # The same noise at the fitted level, so that the fit takes exactly one degree of freedom.
        shots = simulation.frames(found.value / fill_factor)
        made = patch_statistics(shots, patches)
        luminance_cd_m2 *= found.value / fill_factor if fit == "light" else 1.0
    shared, dependent = dependence(stack, shots, patches)
    validation = compare_patches(
        seen,
        made,
        chart_xyz_d65("macbeth", seen.names),
        level=level,
        tolerance_percent=tolerance_percent,
        fitted=int(found is not None),
        shared=shared,
        notes=dependent,
    )
    agrees = validation.agrees
    return FrameValidation(
        validation=replace(validation, exposures_s=(first.exposure_s, exposure_s)),
        conditions=replace(conditions, exposure_s=exposure_s, luminance_cd_m2=luminance_cd_m2),
        corners=corners,
        patches=patches,
        fitted=fit,
        fit=found,
        contradictions=_contradictions(first, sensor, found if fit == "fill_factor" else None),
        diagnosis=() if agrees else diagnose(validation, _other_assumptions(stack, chart, corners, patches), fit),
        measured=stack[0],
        simulated=shots[0],
        frames=(len(stack), len(shots)),
        notes=tuple(notes),
    )


@dataclass(frozen=True)
class _Simulation:
    """Frames of the chart at its place in the measured ones."""

    camera: Camera
    mean_e: NDArray[np.float32]
    exposure_s: float
    seed: int
    count: int

    def frames(self, scale: float = 1.0) -> list[RawFrame]:
        """Return frames whose light level is scaled."""
        mean_e = self.mean_e * np.float32(scale)
        return [self.camera.expose(mean_e, self.exposure_s, seed=self.seed, frame=n) for n in range(self.count)]


def _simulated(
    conditions: CaptureConditions,
    sensor: Sensor,
    chart: Scene,
    corners: Corners,
    exposure_s: float,
    seed: int,
    count: int,
) -> _Simulation:
    camera = Camera(conditions.optics, sensor)
    pixel_aspect = sensor.pixel.height_um.value / sensor.pixel.width_um.value
    scene = in_perspective(chart, corners, (sensor.array.rows, sensor.array.cols), pixel_aspect=pixel_aspect)
    return _Simulation(camera, camera.mean_electrons(scene, exposure_s), exposure_s, seed, count)


def _level(conditions: CaptureConditions, frame: RawFrame, fit: Fitted | None) -> tuple[float, float]:
    """Return exposure time and luminance, where missing those of the frame and of the lamp."""
    exposure_s = conditions.exposure_s if conditions.exposure_s is not None else frame.exposure_s
    if exposure_s is None:
        what = "the exposure time of the frames is unknown"
        raise InputError(what, hint="Pass {exposure_s}", arguments={"exposure_s": 0.01})
    lamp, luminance = conditions.lamp, conditions.luminance_cd_m2
    luminance = luminance if luminance is not None else lamp.chart_luminance_cd_m2
    if luminance is None and fit != "light":
        raise InputError(
            f"the light level is unknown: '{lamp.name}' has a spectrum only",
            hint="Pass {luminance_cd_m2} (mean of the patches) or {fit}, or use a lamp file with absolute values",
            arguments={"luminance_cd_m2": 40.0, "fit": "light"},
        )
    return check_exposure(exposure_s), _START_CD_M2 if luminance is None else luminance


def _simulated_sensor(sensor: Sensor, frame: RawFrame, seed: int) -> tuple[Sensor, list[str]]:
    """Return the sensor at the frames' size, with another serial unless it has maps, and notes."""
    notes = []
    rows, cols = frame.shape
    if (rows, cols) != (sensor.array.rows, sensor.array.cols):
        notes.append(
            f"the frames have {rows} x {cols} pixels and the sensor file {sensor.array.rows} x {sensor.array.cols}; "
            "the simulation uses the size of the frames"
        )
        if sensor.maps is not None:
            notes.append("the sensor file's maps have another size and are not used")
        sensor = sensor.with_(rows=rows, cols=cols, serial=sensor.serial)
    if sensor.maps is None:
        sensor = sensor.with_(serial=f"{sensor.serial}, simulated {seed}")
    if frame.cfa == MONOCHROME and sensor.array.cfa != MONOCHROME:
        notes.append(
            f"the frames have no color filter array; that of the sensor file, {tile_text(sensor.array.cfa)}, is used"
        )
    black_dn = sensor.readout.black_level_dn.value
    if frame.black_level_dn != black_dn:
        notes.append(
            f"the frames' black level is {frame.black_level_dn:g} DN, the sensor file's {black_dn:g} DN; each is "
            "subtracted from its own frames"
        )
    return sensor, notes


def _contradictions(frame: RawFrame, sensor: Sensor, fill_factor: FillFactorFit | None) -> tuple[str, ...]:
    """Return contradictions between the frames' files and the sensor file."""
    found = []
    if frame.cfa not in (MONOCHROME, sensor.array.cfa):
        found.append(
            f"the color filter arrays differ: {tile_text(frame.cfa)} in the frames' files, "
            f"{tile_text(sensor.array.cfa)} in the sensor file, which is used"
        )
    if frame.bits != sensor.readout.bits:
        found.append(
            f"the bit depths differ: {frame.bits} bits in the frames, {sensor.readout.bits} in the sensor file; "
            "digital numbers are compared without scaling"
        )
    if fill_factor is not None and fill_factor.value > 1.0:
        found.append(
            f"the fitted fill factor {fill_factor.value:.4g} ± {fill_factor.standard_error:.2g} is above 1, which is "
            "impossible: check light level, exposure time, f-number and quantum efficiency"
        )
    return tuple(found)


def _other_assumptions(
    stack: Sequence[RawFrame], chart: Scene, corners: Corners, patches: Sequence[Quadrilateral]
) -> dict[str, PatchStatistics]:
    """Return patch statistics for other orientations of the chart and of the color filter array."""
    found = {}

    def read(what: str, frame: RawFrame, regions: Sequence[Quadrilateral]) -> None:
        try:
            found[what] = _reordered(patch_statistics(frame, regions), stack[0].channels)
        except InputError:  # patches too small under this assumption
            return

    for what, order in corner_orders(corners).items():
        read(f"the chart is {what}", stack[0], seen_patches(chart, order, INNER))
    tiles = [tile for tile in NAMED.values() if tile != MONOCHROME]
    if stack[0].cfa in tiles:
        for tile in tiles:
            if tile != stack[0].cfa and set(channel_names(tile)) == set(stack[0].channels):
                what = f"the color filter array is {tile_text(tile)}"
                read(what, replace(stack[0], cfa=tile), patches)
    return found


def _reordered(found: PatchStatistics, channels: tuple[str, ...]) -> PatchStatistics:
    """Return the statistics of a single frame with channels in another order."""
    order = [found.channels.index(name) for name in channels]
    names = ("pixels", "mean_dn", "standard_error_dn", "spatial_noise_dn", "spatial_variance_error_dn2")
    arrays = {name: getattr(found, name)[:, order] for name in (*names, "saturated_fraction")}
    return replace(found, channels=channels, **arrays)
