"""A chart's patches as a camera of known lens sees them: what joins frames, scene and lens for `calibrate_chart`."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.chart import ChartViews
from photosite.camera.camera import Camera
from photosite.errors import InputError, PhotositeWarning
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.optics.protocols import Optics
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor


@dataclass(frozen=True, eq=False)
class ChartShot:
    """Frames of a chart under one light.

    Parameters
    ----------
    scene
        The chart, in absolute radiance.
    frames
        One or more, of one exposure.
    exposure_s
        Exposure time.
    name
        What to call the light.
    """

    scene: Scene
    frames: tuple[RawFrame, ...]
    exposure_s: float
    name: str


def chart_views(
    shots: Sequence[ChartShot],
    sensor: Sensor,
    optics: Optics,
    *,
    light_uncertainty_percent: float = 0.0,
    source: str = "memory",
) -> ChartViews:
    """What the patches read, and what they would read for a quantum efficiency of 1 at each wavelength.

    Parameters
    ----------
    shots
        One per light, all of the same wavelengths and patches.
    sensor
        For gain, pixel and array.
    optics
        The lens; its blur and fall-off are in the light that a patch gets.
    light_uncertainty_percent
        Relative standard uncertainty of each light's level.
    source
        What was opened.

    Raises
    ------
    InputError
        If there are no shots, or they differ in wavelengths or patches.
    """
    if not shots:
        raise InputError("a chart needs frames under a light or more")
    grid, names = shots[0].scene.wavelength_nm, [region.name for region in shots[0].scene.regions]
    units, electrons, errors, usable = [], [], [], []
    hashes = []
    for shot in shots:
        if not np.array_equal(shot.scene.wavelength_nm, grid) or [r.name for r in shot.scene.regions] != names:
            raise InputError(f"light {shot.name}: has other wavelengths or patches than {shots[0].name}")
        found = patch_statistics(shot.frames, Camera(optics, sensor).image_regions(shot.scene), sensor)
        gain = sensor.system_gain_dn_per_e
        electrons.append(found.mean_dn / gain)
        errors.append(found.standard_error_dn / gain)
        usable.append(~found.saturated)
        units.append(unit_electrons(shot.scene, sensor, optics, shot.exposure_s))
        hashes += [hashlib.sha256(np.ascontiguousarray(f.dn, dtype="<u2").data).hexdigest() for f in shot.frames]
    patches = len(names)
    return ChartViews(
        wavelength_nm=grid,
        unit_electrons=np.concatenate(units),
        electrons=np.concatenate(electrons),
        standard_uncertainty=np.concatenate(errors),
        usable=np.concatenate(usable),
        patch=np.tile(np.arange(patches), len(shots)),
        light=np.repeat(np.arange(len(shots)), patches),
        light_names=tuple(shot.name for shot in shots),
        light_uncertainty_percent=light_uncertainty_percent,
        source=source,
        frame_count=len(hashes),
        frames_sha256=tuple(sorted(hashes)),
    )


def unit_electrons(scene: Scene, sensor: Sensor, optics: Optics, exposure_s: float) -> NDArray[np.float64]:
    """(patches, wavelengths): patch means of a monochrome sensor that responds at one of the scene's wavelengths alone.

    Each column is a capture without noise, blur and fall-off included, by a sensor of the same pixels whose quantum
    efficiency is 1 at that wavelength and falls to 0 at the neighbouring ones.

    Raises
    ------
    InputError
        If the sensor's optical stack does something to each channel that is not taken off.
    """
    _check_door(sensor)
    grid = scene.wavelength_nm
    columns = []
    for number, nm in enumerate(grid):
        around = grid[max(number - 1, 0) : number + 2]
        efficiency = (around == nm).astype(np.float64)
        hat = {"wavelength_nm": tuple(around.tolist()), "quantum_efficiency": tuple(efficiency.tolist())}
        single = Sensor.model_validate(
            sensor.model_dump() | {"array": sensor.array.model_dump() | {"cfa": "mono"}, "channels": {"M": hat}}
        )
        camera = Camera(optics, single)
        with warnings.catch_warnings():
            # A hat at the end of the scene's wavelengths is meant to end there.
            warnings.simplefilter("ignore", PhotositeWarning)
            mean = camera.mean_electrons(scene, exposure_s)
        columns.append([float(mean[r.r0 : r.r1, r.c0 : r.c1].mean()) for r in camera.image_regions(scene)])
    return np.array(columns).T


def _check_door(sensor: Sensor) -> None:
    """Refuse what a sensor says of its channels' neighbours and angles: what a chart's patches read holds it."""
    stack = sensor.optical_stack
    if stack is None:
        return
    fall = stack.angular_response
    by_channel = fall is not None and isinstance(fall.relative_response, dict)
    for name, there in (("crosstalk", stack.crosstalk is not None), ("angular_response of each channel", by_channel)):
        if there:
            raise InputError(
                f"what a chart's patches read holds the sensor's optical_stack.{name}, which is not taken off: leave "
                "it out of the sensor, and the quantum efficiency is that of the channels with it"
            )
