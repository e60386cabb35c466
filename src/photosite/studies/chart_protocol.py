"""Protocols of a chart under known lights: a YAML file that says which frames show it, and how bright it was.

photosite_spectral: 1
sensor: mine.sensor.yaml               # gain and pixel size; relative to the protocol
chart: macbeth                         # fills the frame
lens: {f_number: 8, focal_length_mm: 50, distance_m: 1.2}
wavelength_nm: [380, 780, 10]          # first, last, step of what is wanted; this is the default
light_uncertainty_percent: 1           # of each light's level
bits: 12                               # where the files do not say; likewise cfa
lights:
  - {illuminant: A, mean_luminance_cd_m2: 40, exposure: 1/3, files: a/*.dng}
  - {spectrum: lamp.csv, mean_luminance_cd_m2: 55, exposure: 1/5, files: lamp/*.dng}

An illuminant is CIE's name or a blackbody's temperature (3200K); a spectrum's CSV holds wavelength (nm) and relative
spectral energy. The luminance is the mean of the 24 patches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.chart import ChartViews
from photosite.calibration.spectral.protocol import VERSION_KEY, ProtocolEntry, protocol_entries
from photosite.color.spectrum import Spectrum
from photosite.color.spectrum_file import read_spectrum
from photosite.errors import FileError, InputError
from photosite.files.yaml import check_keys, line_of, optional_text, read_yaml
from photosite.frames.io.protocol import stated_bits, stated_cfa
from photosite.frames.io.read import read_raw
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene import charts
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.studies.chart_spectral import ChartShot, chart_views

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
"""At the chart's distance. Diffraction is then 0.1 mm wide, and the lens sees no patches."""


def is_chart_protocol(path: str | PathLike[str]) -> bool:
    """Whether a spectral protocol lists lights on a chart, and not bands.

    Raises
    ------
    FileError
        If it cannot be read or is not YAML.
    """
    data = read_yaml(Path(path), "a spectral protocol")
    return isinstance(data, Mapping) and "lights" in data


@dataclass(frozen=True)
class _Chart:
    """What the protocol says of chart and lens."""

    optics: DiffractionLimited
    distance_m: float
    wavelength_nm: NDArray[np.float64]


def open_chart(path: str | PathLike[str], sensor: Sensor | None = None) -> tuple[ChartViews, Sensor]:
    """What the patches of a chart read, from the protocol of its frames.

    Parameters
    ----------
    path
        The protocol; what it may say stands at the top of this module.
    sensor
        In place of the one that the protocol names.

    Returns
    -------
    tuple
        The views, and the sensor whose gain and pixel made electrons of their numbers.

    Raises
    ------
    FileError
        If the protocol or a frame cannot be read or says what cannot be; with the line.
    """
    file = Path(path)
    data = read_yaml(file, "a spectral protocol")
    if not isinstance(data, Mapping) or data.get(VERSION_KEY) != 1:
        raise FileError(file, f"expected '{VERSION_KEY}: 1' (the file format's version)", line_of(data, VERSION_KEY))
    check_keys(file, data, _KEYS, "a spectral protocol of a chart")
    top = ProtocolEntry(file, data, None)
    if (name := optional_text(file, data, "chart")) not in (None, "macbeth"):
        raise top.error(f"'chart' is macbeth, not '{name}'", "chart")
    used = sensor or _sensor(top)
    chart = _chart(top)
    percent = top.percent("light_uncertainty_percent")
    shots = [_shot(entry, chart, data) for entry in protocol_entries(top, "lights", _LIGHT_KEYS)]
    try:
        views = chart_views(shots, used, chart.optics, light_uncertainty_percent=percent, source=str(file))
    except InputError as error:
        raise FileError(file, str(error)) from None
    return views, used


def _sensor(top: ProtocolEntry) -> Sensor:
    name = optional_text(top.file, top.data, "sensor")
    if name is None:
        raise top.error("names no 'sensor': electrons need a gain, and photons a pixel; name one, or give --sensor")
    return load_sensor(top.file.parent / name)


def _chart(top: ProtocolEntry) -> _Chart:
    lens = top.data.get("lens")
    if not isinstance(lens, Mapping):
        raise top.error(f"'lens' is {{{', '.join(_LENS_KEYS)}}}", "lens")
    check_keys(top.file, lens, _LENS_KEYS, "'lens'")
    entry = ProtocolEntry(top.file, lens, line_of(top.data, "lens"))
    f_number, focal_mm, distance_m = (entry.positive(key).value for key in _LENS_KEYS)
    wanted = top.data.get("wavelength_nm", [380, 780, 10])
    numbers = isinstance(wanted, Sequence) and all(
        isinstance(n, int | float) and not isinstance(n, bool) and 0 < n < 1e6 for n in wanted
    )
    if not numbers or len(wanted) != 3 or not wanted[0] < wanted[1]:
        raise top.error(f"'wavelength_nm' is [first, last, step] in nm, not {wanted!r:.80}", "wavelength_nm")
    first, last, step = map(float, wanted)
    if (last - first) / step > _MOST_WAVELENGTHS:
        raise top.error(f"'wavelength_nm' is {_MOST_WAVELENGTHS} steps or fewer", "wavelength_nm")
    try:
        optics = DiffractionLimited(f_number=f_number, focal_length_mm=focal_mm)
        if (working := optics.working_f_number(distance_m)) > _LARGEST_F_NUMBER:
            raise InputError(
                f"the lens has f/{working:.3g} at {distance_m:g} m, which leaves nothing of a chart; "
                f"f/{_LARGEST_F_NUMBER:g} is the most"
            )
        return _Chart(optics, distance_m, np.arange(first, last + step / 2, step))
    except InputError as error:
        raise entry.error(str(error)) from None


def _shot(entry: ProtocolEntry, chart: _Chart, data: Mapping[Any, Any]) -> ChartShot:
    named, measured = entry.data.get("illuminant"), entry.data.get("spectrum")
    if (named is None) == (measured is None):
        raise entry.error("a light has an 'illuminant' or a 'spectrum' (a CSV file)")
    light: str | float | Spectrum
    if measured is not None:
        light = read_spectrum(entry.file.parent / (optional_text(entry.file, entry.data, "spectrum") or "")).spectrum
    elif isinstance(named, bool) or not isinstance(named, str | int | float):
        raise entry.error(f"'illuminant' is a CIE name or a temperature such as 3200K, not {named!r:.80}", "illuminant")
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
        raise entry.error(str(error)) from None
    bits, cfa = stated_bits(entry.file, data), stated_cfa(entry.file, data)
    frames = tuple(read_raw(path, bits=bits, cfa=cfa) for path in entry.files())
    return ChartShot(scene, frames, exposure_s, str(named) if named is not None else str(measured))
