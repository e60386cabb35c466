"""Frames of a chart under known lights, for `photosite.calibrate_chart`, and the protocol file that lists them.

photosite_spectral: 1
sensor: mine.sensor.yaml               # gain and pixel size; path relative to the protocol
chart: macbeth                         # fills the frame
lens: {f_number: 8, focal_length_mm: 50, distance_m: 1.2}
wavelength_nm: [380, 780, 10]          # first, last, step of the result; this is the default
light_uncertainty_percent: 1           # relative standard uncertainty of each luminance
bits: 12                               # if missing in the files; likewise cfa
lights:
  - {illuminant: A, mean_luminance_cd_m2: 40, exposure: 1/3, files: a/*.dng}
  - {spectrum: lamp.csv, mean_luminance_cd_m2: 55, exposure: 1/5, files: lamp/*.dng}

An illuminant is a CIE name or a blackbody temperature (3200K). The CSV file of a spectrum has columns of wavelength
(nm) and relative spectral energy. The luminance is the mean over the 24 patches.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.chart import ChartViews
from photosite.calibration.spectral.protocol import VERSION_KEY, ProtocolEntry, protocol_entries
from photosite.camera.camera import Camera
from photosite.color.spectrum import Spectrum
from photosite.color.spectrum_file import read_spectrum
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.yaml import check_keys, line_of, optional_text, read_yaml
from photosite.frames.io.protocol import stated_bits, stated_cfa
from photosite.frames.io.read import read_raw
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.protocols import Optics
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor

_KEYS = (
    VERSION_KEY,
    "name",
    "sensor",
    "chart",
    "lens",
    "wavelength_nm",
    "light_uncertainty_percent",
    "bits",
    "cfa",
    "lights",
)
_LENS_KEYS = ("f_number", "focal_length_mm", "distance_m")
_LIGHT_KEYS = ("illuminant", "spectrum", "mean_luminance_cd_m2", "exposure", "files")
_MOST_WAVELENGTHS = 200
_LARGEST_F_NUMBER = 128.0
"""Working f-number at which diffraction, 0.1 mm wide, blurs the patches."""


@dataclass(frozen=True, eq=False)
class ChartShot:
    """Frames of a chart under one light.

    Parameters
    ----------
    scene
        The chart, in absolute radiance.
    frames
        One frame or more, of one exposure time.
    exposure_s
        Exposure time.
    name
        Name of the light.
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
    """Return the patch means, and those expected for a quantum efficiency of 1 at each wavelength.

    Parameters
    ----------
    shots
        One per light, all with the same wavelengths and patches.
    sensor
        Gain, pixel and array.
    optics
        The lens, with blur and relative illumination.
    light_uncertainty_percent
        Relative standard uncertainty of each luminance.
    source
        Name of the data in the result.

    Raises
    ------
    InputError
        If there are no shots, or they differ in wavelengths or patches.
    """
    if not shots:
        raise InputError("shots", value=shots, expected="frames under one light or more")
    grid, names = shots[0].scene.wavelength_nm, [region.name for region in shots[0].scene.regions]
    units, electrons, errors, usable = [], [], [], []
    hashes = []
    for shot in shots:
        if not np.array_equal(shot.scene.wavelength_nm, grid) or [r.name for r in shot.scene.regions] != names:
            raise InputError(f"wavelengths or patches differ from those of {shots[0].name}", where=f"light {shot.name}")
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
    """Return (patches, wavelengths) patch means of a monochrome sensor that responds at one wavelength of the scene.

    Each column is a capture without noise, with blur and relative illumination, by a sensor of the same pixels. Its
    quantum efficiency is 1 at that wavelength and falls to 0 at the neighbouring ones.

    Raises
    ------
    InputError
        If the sensor's optical stack has an effect on single channels that cannot be corrected.
    """
    _check_optical_stack(sensor)
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
            # The response ends at the first or last wavelength of the scene on purpose.
            warnings.simplefilter("ignore", PhotositeWarning)
            mean = camera.mean_electrons(scene, exposure_s)
        columns.append([float(mean[r.r0 : r.r1, r.c0 : r.c1].mean()) for r in camera.image_regions(scene)])
    return np.array(columns).T


def _check_optical_stack(sensor: Sensor) -> None:
    """Reject crosstalk and angular response of single channels: the patch means include both."""
    stack = sensor.optical_stack
    if stack is None:
        return
    fall = stack.angular_response
    by_channel = fall is not None and isinstance(fall.relative_response, dict)
    for name, there in (("crosstalk", stack.crosstalk is not None), ("angular_response of each channel", by_channel)):
        if there:
            raise InputError(
                f"patch means include the sensor's optical_stack.{name}, which cannot be corrected",
                hint="Remove it from the sensor; the quantum efficiency then includes its effect",
            )


def is_chart_protocol(path: str | PathLike[str]) -> bool:
    """Return whether a spectral protocol lists lights on a chart instead of wavelength bands.

    Raises
    ------
    FileError
        If the file cannot be read or is not YAML.
    """
    data = read_yaml(Path(path), "a spectral protocol")
    return isinstance(data, Mapping) and "lights" in data


@dataclass(frozen=True)
class _Chart:
    """Lens, distance and wavelengths in a protocol."""

    optics: DiffractionLimited
    distance_m: float
    wavelength_nm: NDArray[np.float64]


def open_chart(path: str | PathLike[str], sensor: Sensor | None = None) -> tuple[ChartViews, Sensor]:
    """Read the patch means of a chart from the protocol of its frames.

    Parameters
    ----------
    path
        Protocol file; the docstring of this module shows one.
    sensor
        Sensor to use instead of the one in the protocol.

    Returns
    -------
    tuple
        The patch means, and the sensor whose gain converted them to electrons.

    Raises
    ------
    FileError
        If the protocol or a frame cannot be read or has invalid content.
    """
    file = Path(path)
    data = read_yaml(file, "a spectral protocol")
    if not isinstance(data, Mapping) or data.get(VERSION_KEY) != 1:
        version = data.get(VERSION_KEY) if isinstance(data, Mapping) else None
        raise FileError(file, VERSION_KEY, line_of(data, VERSION_KEY), value=version, expected="1")
    check_keys(file, data, _KEYS, "a spectral protocol of a chart")
    top = ProtocolEntry(file, data, None)
    if (name := optional_text(file, data, "chart")) not in (None, "macbeth"):
        raise _error(top, "chart", name, "'macbeth'")
    used = sensor or _sensor(top)
    chart = _chart(top)
    percent = top.percent("light_uncertainty_percent")
    shots = [_shot(entry, chart, data) for entry in protocol_entries(top, "lights", _LIGHT_KEYS)]
    try:
        views = chart_views(shots, used, chart.optics, light_uncertainty_percent=percent, source=str(file))
    except InputError as error:
        raise error.in_file(file) from None
    return views, used


def _error(entry: ProtocolEntry, key: str, value: object, expected: str) -> FileError:
    return FileError(entry.file, key, line_of(entry.data, key) or entry.line, value=value, expected=expected)


def _sensor(top: ProtocolEntry) -> Sensor:
    name = optional_text(top.file, top.data, "sensor")
    if name is None:
        raise FileError(
            top.file,
            "there is no 'sensor', whose gain and pixel size are needed",
            top.line,
            hint="Name one in the protocol, or pass {sensor}",
            arguments={"sensor": "mine.sensor.yaml"},
        )
    return load_sensor(top.file.parent / name)


def _chart(top: ProtocolEntry) -> _Chart:
    lens = top.data.get("lens")
    if not isinstance(lens, Mapping):
        raise _error(top, "lens", lens, f"{{{', '.join(_LENS_KEYS)}}}")
    check_keys(top.file, lens, _LENS_KEYS, "'lens'")
    entry = ProtocolEntry(top.file, lens, line_of(top.data, "lens"))
    f_number, focal_mm, distance_m = (entry.positive(key).value for key in _LENS_KEYS)
    wanted = top.data.get("wavelength_nm", [380, 780, 10])
    numbers = isinstance(wanted, Sequence) and all(
        isinstance(n, int | float) and not isinstance(n, bool) and 0 < n < 1e6 for n in wanted
    )
    if not numbers or len(wanted) != 3 or not wanted[0] < wanted[1]:
        raise _error(top, "wavelength_nm", wanted, "[first, last, step] in nm")
    first, last, step = map(float, wanted)
    if (last - first) / step > _MOST_WAVELENGTHS:
        raise _error(top, "wavelength_nm", wanted, f"{_MOST_WAVELENGTHS} steps or fewer")
    try:
        optics = DiffractionLimited(f_number=f_number, focal_length_mm=focal_mm)
        if (working := optics.working_f_number(distance_m)) > _LARGEST_F_NUMBER:
            raise InputError(
                f"working f-number at {distance_m:g} m",
                value=float(f"{working:.3g}"),
                expected=f"at most {_LARGEST_F_NUMBER:g}",
            )
        return _Chart(optics, distance_m, np.arange(first, last + step / 2, step))
    except InputError as error:
        raise error.within("lens").in_file(top.file, entry.line) from None


def _shot(entry: ProtocolEntry, chart: _Chart, data: Mapping[Any, Any]) -> ChartShot:
    named, measured = entry.data.get("illuminant"), entry.data.get("spectrum")
    if (named is None) == (measured is None):
        raise FileError(entry.file, "a light needs either 'illuminant' or 'spectrum' (a CSV file)", entry.line)
    light: str | float | Spectrum
    if measured is not None:
        light = read_spectrum(entry.file.parent / (optional_text(entry.file, entry.data, "spectrum") or "")).spectrum
    elif isinstance(named, bool) or not isinstance(named, str | int | float):
        raise _error(entry, "illuminant", named, "a CIE name or a temperature such as 3200K")
    else:
        light = named if isinstance(named, str) else float(named)
    exposure_s = entry.exposure_s()
    try:
        scene = charts.macbeth(
            light,
            entry.positive("mean_luminance_cd_m2").value,
            wavelength_nm=chart.wavelength_nm,
            distance_m=chart.distance_m,
        )
    except InputError as error:
        raise error.in_file(entry.file, entry.line) from None
    bits, cfa = stated_bits(entry.file, data), stated_cfa(entry.file, data)
    frames = tuple(read_raw(path, bits=bits, cfa=cfa) for path in entry.files())
    return ChartShot(scene, frames, exposure_s, str(named) if named is not None else str(measured))
