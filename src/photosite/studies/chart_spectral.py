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
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PlainValidator, model_validator

from photosite.calibration.spectral.chart import ChartViews
from photosite.calibration.spectral.protocol import FrameEntry, SpectralProtocol, read_spectral_protocol
from photosite.camera.camera import Camera
from photosite.color.spectrum import Spectrum, load_spectrum
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.yaml import line_at, line_of, read_yaml
from photosite.frames.io.formats import read_raw
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens import Optics
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.quantity import NotNegative, Positive, is_number
from photosite.values.uncertain import Measured
from photosite.values.validated import Section

_MOST_WAVELENGTHS = 200
_LARGEST_F_NUMBER = 128.0
"""Working f-number at which diffraction, 0.1 mm wide, blurs the patches."""


@dataclass(frozen=True, eq=False)
class ChartShot:
    """Frames of a chart under a light of some name: the chart in absolute radiance, and one frame or more of one
    exposure time."""

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
    sensor, optics
        Gain, pixel and array; the lens, with blur and relative illumination.
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
    units, electrons, errors, usable, hashes = [], [], [], [], []
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
    quantum efficiency is 1 at that wavelength and falls to 0 at the neighboring ones.

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
    """Return whether a spectral protocol lists lights on a chart instead of wavelength bands."""
    data = read_yaml(Path(path), "a spectral protocol")
    return isinstance(data, Mapping) and "lights" in data


def _illuminant(raw: Any) -> str | float:
    if isinstance(raw, str) or (isinstance(raw, int | float) and not isinstance(raw, bool)):
        return raw
    raise InputError("illuminant", value=raw, expected="a CIE name or a temperature such as 3200K")


def _grid(raw: Any) -> NDArray[np.float64]:
    numbers = isinstance(raw, Sequence) and all(is_number(n) and 0 < n < 1e6 for n in raw)
    if not numbers or len(raw) != 3 or not raw[0] < raw[1]:
        raise InputError("wavelength_nm", value=raw, expected="[first, last, step] in nm")
    first, last, step = map(float, raw)
    if (last - first) / step > _MOST_WAVELENGTHS:
        raise InputError("wavelength_nm", value=raw, expected=f"{_MOST_WAVELENGTHS} steps or fewer")
    return np.arange(first, last + step / 2, step)


class _Lens(Section):
    f_number: Positive
    focal_length_mm: Positive
    distance_m: Positive

    def optics(self) -> DiffractionLimited:
        optics = DiffractionLimited(f_number=self.f_number.value, focal_length_mm=self.focal_length_mm.value)
        distance_m = self.distance_m.value
        if (working := optics.working_f_number(distance_m)) > _LARGEST_F_NUMBER:
            what, expected = f"working f-number at {distance_m:g} m", f"at most {_LARGEST_F_NUMBER:g}"
            raise InputError(what, value=float(f"{working:.3g}"), expected=expected)
        return optics


class _Light(FrameEntry):
    illuminant: Annotated[str | float, PlainValidator(_illuminant)] | None = None
    spectrum: str | None = None
    mean_luminance_cd_m2: Positive

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.illuminant is None) == (self.spectrum is None):
            raise InputError("a light needs either 'illuminant' or 'spectrum' (a CSV file)")
        return self


class _ChartProtocol(SpectralProtocol):
    chart: Literal["macbeth"] | None = None
    lens: _Lens
    wavelength_nm: Annotated[NDArray[np.float64], PlainValidator(_grid)] = Field(
        default_factory=lambda: _grid([380, 780, 10]), validate_default=False
    )
    light_uncertainty_percent: NotNegative = Measured(0.0)
    lights: tuple[_Light, ...] = Field(min_length=1)


def read_chart(path: str | PathLike[str], sensor: Sensor | None = None) -> tuple[ChartViews, Sensor]:
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

    Examples
    --------
    >>> import tempfile
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=66, cols=98, black_level_dn=64)
    >>> camera = ps.Camera(DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     camera.capture(charts.macbeth("A", 40), 1 / 4).save(f"{folder}/a.dng")
    ...     _ = Path(folder, "chart.yaml").write_text(
    ...         "photosite_spectral: 1\\n"
    ...         "lens: {f_number: 8, focal_length_mm: 50, distance_m: 1.2}\\n"
    ...         "wavelength_nm: [400, 700, 50]\\n"
    ...         "lights: [{illuminant: A, mean_luminance_cd_m2: 40, exposure: 1/4, files: a.dng}]\\n"
    ...     )
    ...     views, _ = read_chart(f"{folder}/chart.yaml", sensor)
    >>> views.unit_electrons.shape, views.electrons.shape
    ((24, 7), (24, 3))
    """
    file = Path(path)
    protocol, data = read_spectral_protocol(file, _ChartProtocol)
    if sensor is None and protocol.sensor is None:
        raise FileError(
            file,
            "there is no 'sensor', whose gain and pixel size are needed",
            hint="Name one in the protocol, or pass {sensor}",
            arguments={"sensor": "mine.sensor.yaml"},
        )
    used = sensor or load_sensor(file.parent / str(protocol.sensor))
    try:
        optics = protocol.lens.optics()
    except InputError as error:
        raise error.within("lens").in_file(file, line_of(data, "lens")) from None
    shots = [
        _shot(file, protocol, light, line_at(data, ("lights", number))) for number, light in enumerate(protocol.lights)
    ]
    percent = protocol.light_uncertainty_percent.value
    try:
        return chart_views(shots, used, optics, light_uncertainty_percent=percent, source=str(file)), used
    except InputError as error:
        raise error.in_file(file) from None


def _shot(file: Path, protocol: _ChartProtocol, entry: _Light, line: int | None) -> ChartShot:
    light: str | float | Spectrum | None = entry.illuminant
    if entry.spectrum is not None:
        light = load_spectrum(file.parent / entry.spectrum).spectrum
    assert light is not None  # the model requires one of the two
    try:
        scene = charts.macbeth(
            light,
            entry.mean_luminance_cd_m2.value,
            wavelength_nm=protocol.wavelength_nm,
            distance_m=protocol.lens.distance_m.value,
        )
    except InputError as error:
        raise error.in_file(file, line) from None
    frames = tuple(read_raw(path, bits=protocol.bits, cfa=protocol.cfa) for path in entry.paths(file, line))
    return ChartShot(scene, frames, entry.exposure, str(entry.illuminant if entry.spectrum is None else entry.spectrum))
