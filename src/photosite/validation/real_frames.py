"""Raw frames of a chart against what the simulator makes of the camera, the lamp and the exposure one believes in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photosite.camera.camera import Camera
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import PatchStatistics, patch_statistics
from photosite.scene.charts import macbeth
from photosite.scene.perspective import check_corners, in_perspective, seen_patches
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.validation.charts import chart_xyz_d65
from photosite.validation.diagnosis import corner_orders, diagnose
from photosite.validation.fill_factor import FillFactorFit, fit_fill_factor
from photosite.validation.frames_result import FITTED, Fitted, FrameValidation, Told
from photosite.validation.repeats import check_repeats
from photosite.validation.validate import compare_patches
from photosite.values.cfa import MONOCHROME, NAMED, tile_text
from photosite.values.exposure import check_exposure
from photosite.values.region import Corners, Quadrilateral

INNER = 0.6
"""Part of a patch's side that is compared, about its middle: the rest forgives blur, and corners set by hand."""

MOST_SIMULATED = 10
"""Frames are simulated as many as were measured, up to this."""

_START_CD_M2 = 40.0
"""Mean luminance of the first simulation where the level is fitted; the fit is a ratio to it."""


def validate_frames(
    measured: Sequence[RawFrame],
    told: Told,
    corners: Corners,
    *,
    fit: Fitted | None = None,
    level: float = 0.05,
    tolerance_percent: float = 0.0,
    seed: int = 0,
) -> FrameValidation:
    """Compare raw frames of a ColorChecker with a simulation of the camera, on the raw mosaic.

    The chart is simulated where it stands in the frames, as it is seen there, and as many frames of it as were
    measured. Several frames are a stack of one scene and setting: their means are averaged, and their differences tell
    the noise from frame to frame. The frames are read by the sensor's colour filter array, whatever their files say.

    Parameters
    ----------
    measured
        One frame or more.
    told
        What the simulation is told.
    corners
        Of the chart's field of patches, (row, col) in pixels: the outer corner of the dark skin, of the bluish green,
        of the black and of the white patch, in this order.
    fit
        One parameter that the frames determine, by the patch means: "fill_factor", or "light" for the level of the
        light. Either takes up whatever scales all patches alike.
    level, tolerance_percent
        As for `photosite.validation.validate.validate`.
    seed
        Of the simulation's noise, and of its fixed pattern: a chip of its own for each seed, unless the sensor file has
        maps.

    Returns
    -------
    FrameValidation

    Raises
    ------
    InputError
        If frames differ in setting or two are identical, the corners cannot be, exposure or luminance are not
        known, or as `photosite.validation.validate.compare_patches`.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 3. The sensor file's own uncertainties are not part of the verdict: it
    asks whether the camera is the one described, and `tolerance_percent` is where to put what the description may
    be off by. Nor are uneven light and stray light, which a real chart has.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.validation.lamp import Lamp
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=132, cols=196, black_level_dn=64)
    >>> lens = ps.DiffractionLimited(f_number=8, focal_length_mm=50)
    >>> told = Told(sensor, lens, Lamp.named("A"), luminance_cd_m2=40)
    >>> shot = ps.Camera(lens, sensor).capture(ps.charts.macbeth("A", 40), exposure_s=1 / 3, seed=1)
    >>> validate_frames([shot], told, ((4, 4), (4, 192), (128, 192), (128, 4))).agrees
    True
    """
    if not measured:
        raise InputError("there is no measured frame; give one or more")
    if fit is not None and fit not in FITTED:
        raise InputError(f"one of {', '.join(FITTED)} can be fitted, not '{fit}'")
    check_repeats(measured)
    first = measured[0]
    check_corners(corners, first.shape)
    told = _completed(told, first, fit)
    sensor, notes = _chip(told.sensor, first, seed)
    stack = [replace(frame, cfa=sensor.array.cfa) for frame in measured]
    chart = _chart(told)
    patches = seen_patches(chart, corners, INNER)
    seen = patch_statistics(stack, patches)
    camera = Camera(told.optics, sensor)
    scene = _scene(chart, corners, camera)
    count = min(len(stack), MOST_SIMULATED)
    shots, made, found, told = _simulated(camera, scene, told, fit, seen, patches, count, seed)
    validation = compare_patches(
        seen,
        made,
        chart_xyz_d65("macbeth", seen.names),
        level=level,
        tolerance_percent=tolerance_percent,
        exposures_s=(first.exposure_s, told.exposure_s),
        fitted=0 if found is None else 1,
    )
    return FrameValidation(
        validation=validation,
        told=told,
        corners=corners,
        patches=patches,
        fitted=fit,
        fit=found,
        contradictions=_contradictions(first, sensor, found if fit == "fill_factor" else None),
        diagnosis=()
        if validation.agrees
        else diagnose(validation, _other_readings(stack, chart, corners, patches), fit),
        measured=stack[0],
        simulated=shots[0],
        frames=(len(stack), count),
        notes=tuple(notes),
    )


def _completed(told: Told, frame: RawFrame, fit: Fitted | None) -> Told:
    """What was told, with exposure and luminance from frames and lamp where it does not say."""
    exposure_s = told.exposure_s if told.exposure_s is not None else frame.exposure_s
    if exposure_s is None:
        raise InputError("the frames do not say their exposure time; give it (exposure_s, --exposure)")
    luminance = told.luminance_cd_m2 if told.luminance_cd_m2 is not None else told.lamp.chart_luminance_cd_m2
    if luminance is None and fit != "light":
        raise InputError(
            f"the level of light is not known: '{told.lamp.name}' names a spectrum only; give the mean luminance of "
            "the patches (--luminance), a lamp's file with absolute values, or have it fitted (--fit light)"
        )
    luminance = _START_CD_M2 if luminance is None else luminance
    return replace(told, exposure_s=check_exposure(exposure_s), luminance_cd_m2=luminance)


def _chip(sensor: Sensor, frame: RawFrame, seed: int) -> tuple[Sensor, list[str]]:
    """The sensor at the frames' size, as a chip of its own unless its maps are those of the measured one."""
    notes = []
    rows, cols = frame.shape
    if (rows, cols) != (sensor.array.rows, sensor.array.cols):
        notes.append(
            f"the frames have {rows} x {cols} pixels and the sensor file {sensor.array.rows} x {sensor.array.cols}; "
            "the frames' size is simulated"
        )
        if sensor.maps is not None:
            notes.append("the sensor file's maps have another size and are not used")
        sensor = sensor.with_(rows=rows, cols=cols, serial=sensor.serial)
    if sensor.maps is None:
        sensor = sensor.with_(serial=f"{sensor.serial}, simulated {seed}")
    if frame.cfa == MONOCHROME and sensor.array.cfa != MONOCHROME:
        notes.append(
            "the frames do not say their colour filter array; they are read by the sensor file's, "
            f"{tile_text(sensor.array.cfa)}"
        )
    black_dn = sensor.readout.black_level_dn.value
    if frame.black_level_dn != black_dn:
        notes.append(
            f"the frames' black level is {frame.black_level_dn:g} DN, the sensor file's {black_dn:g} DN; each is taken "
            "off its own"
        )
    return sensor, notes


def _chart(told: Told) -> Scene:
    lamp = told.lamp
    level = told.luminance_cd_m2
    if level is None:
        raise InputError("the level of light is not known; give luminance_cd_m2")
    return macbeth(lamp.light, level, wavelength_nm=lamp.wavelength_nm, distance_m=told.distance_m)


def _scene(chart: Scene, corners: Corners, camera: Camera) -> Scene:
    array, pixel = camera.sensor.array, camera.sensor.pixel
    aspect = pixel.height_um.value / pixel.width_um.value
    return in_perspective(chart, corners, (array.rows, array.cols), pixel_aspect=aspect)


def _simulated(
    camera: Camera,
    scene: Scene,
    told: Told,
    fit: Fitted | None,
    seen: PatchStatistics,
    patches: Sequence[Quadrilateral],
    count: int,
    seed: int,
) -> tuple[list[RawFrame], PatchStatistics, FillFactorFit | None, Told]:
    """Frames of the simulation and their patches, after the fit where there is one, and what was told then."""
    if told.exposure_s is None:
        raise InputError("the exposure is not known; give exposure_s")
    rate = camera.mean_electrons(scene, told.exposure_s)

    def shoot(scale: float) -> tuple[list[RawFrame], PatchStatistics]:
        mean = rate * np.float32(scale)
        shots = [camera.expose(mean, told.exposure_s or 0.0, seed=seed, frame=number) for number in range(count)]
        return shots, patch_statistics(shots, patches)

    shots, made = shoot(1.0)
    if fit is None:
        return shots, made, None, told
    fill_factor = camera.sensor.pixel.fill_factor.value
    found = fit_fill_factor(seen, made, fill_factor)
    scale = found.value / fill_factor
    # The same noise again at the fitted level: what the fit took from these frames is in them still.
    shots, made = shoot(scale)
    if fit == "light":
        told = replace(told, luminance_cd_m2=(told.luminance_cd_m2 or 0.0) * scale)
    return shots, made, found, told


def _contradictions(frame: RawFrame, sensor: Sensor, fill_factor: FillFactorFit | None) -> tuple[str, ...]:
    """What the files and the sensor file say of one thing and cannot both be."""
    found = []
    if frame.cfa not in (MONOCHROME, sensor.array.cfa):
        found.append(
            f"the colour filter arrays differ: the frames' files say {tile_text(frame.cfa)}, the sensor file "
            f"{tile_text(sensor.array.cfa)}, by which the frames are read"
        )
    if frame.bits != sensor.readout.bits:
        found.append(
            f"the converters differ: the frames have {frame.bits} bits, the sensor file {sensor.readout.bits}; digital "
            "numbers are compared as they are"
        )
    if fill_factor is not None and fill_factor.value > 1.0:
        found.append(
            f"the fitted fill factor {fill_factor.value:.4g} ± {fill_factor.standard_error:.2g} is above 1, which no "
            "pixel has: light, exposure, f-number or quantum efficiency are not those told"
        )
    return tuple(found)


def _other_readings(
    stack: Sequence[RawFrame], chart: Scene, corners: Corners, patches: Sequence[Quadrilateral]
) -> dict[str, PatchStatistics]:
    """The frames read as if the chart, or the colour filter array, were turned another way."""
    found = {}

    def read(what: str, frame: RawFrame, regions: Sequence[Quadrilateral]) -> None:
        try:
            found[what] = _in_order(patch_statistics(frame, regions), stack[0].channels)
        except InputError:  # patches too small to be read in that way, which then explains nothing
            return

    for what, order in corner_orders(corners).items():
        read(f"the chart is {what}", stack[0], seen_patches(chart, order, INNER))
    tiles = [tile for tile in NAMED.values() if tile != MONOCHROME]
    if stack[0].cfa in tiles:
        for tile in tiles:
            if tile != stack[0].cfa:
                what = f"the colour filter array is {tile_text(tile)}"
                read(what, replace(stack[0], cfa=tile), patches)
    return found


def _in_order(found: PatchStatistics, channels: tuple[str, ...]) -> PatchStatistics:
    """The channels of one frame's patches in the order of another tile's."""
    order = [found.channels.index(name) for name in channels]
    arrays = (
        "pixels",
        "mean_dn",
        "standard_error_dn",
        "spatial_noise_dn",
        "spatial_variance_error_dn2",
        "saturated_share",
    )
    return replace(found, channels=channels, **{name: getattr(found, name)[:, order] for name in arrays})
