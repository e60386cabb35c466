"""Channels of an assumed spectral response by their names, for sensors whose tables are unknown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.sections import Channel

_SILICON_NM = np.array([350, *range(400, 501, 50), 530, *range(550, 1101, 50)], dtype=np.float64)
_SILICON = (0.2, 0.55, 0.8, 0.96, 1.0, 0.99, 0.91, 0.78, 0.63, 0.48, 0.34, 0.22, 0.13, 0.07, 0.02, 0.005, 0.0)
"""A rounded curve of a monochrome sensor: reflection and surface recombination in the blue, absorption in the red."""

_GRID_NM = np.arange(380.0, 1001.0, 10.0)
_TRANSMITTANCE = 0.85
"""Largest transmittance of a red, green or blue filter, relative to no filter."""

_D200 = "that of the Nikon D200, with its infrared filter"
_CURVE = "a rounded curve of front-illuminated silicon and an ideal filter"

_EXTINCTION_RATIO = 300.0
"""Of on-chip polarizers in the green (Sony IMX250MZR)."""

_CLEAR, _INFRARED = ("W", "C"), "Ir"
KNOWN = ("R", "G", "B", "M", *_CLEAR, "Y", "Cy", _INFRARED, "P")


def _edge(at_nm: float, width_nm: float) -> NDArray[np.float64]:
    """Return a transmittance that rises from 0 to 1."""
    return 1.0 / (1.0 + np.exp((at_nm - _GRID_NM) / width_nm))


def assumed_channels(names: Sequence[str], peak: float) -> dict[str, Channel]:
    """Return channels, marked as assumed, the largest quantum efficiency of all equal to the peak.

    M and P have a rounded curve of front-illuminated silicon. A number after a name, as in P45 and R0, is the angle of
    a polarizer with an extinction ratio of 300. R, G and B have the
    shape of the Nikon D200, whose infrared filter ends at 700 nm; with such a filter, W and C are silicon, Y without
    the blue and Cy without the red. With a channel Ir, the filter passes 810 to 900 nm, too, where all dyes are clear.

    Raises
    ------
    InputError
        If a name is unknown.

    Examples
    --------
    >>> found = assumed_channels(["R", "C", "B"], 0.8)
    >>> {name: round(max(channel.quantum_efficiency), 2) for name, channel in found.items()}
    {'R': 0.49, 'C': 0.8, 'B': 0.66}
    """
    letters = [name.rstrip("0123456789") for name in names]
    if unknown := [name for name, letter in zip(names, letters, strict=True) if letter not in KNOWN]:
        raise InputError("channel", value=", ".join(unknown), expected=f"one of {', '.join(KNOWN)}")
    dyes = load_sensor("nikon-d200").channels
    scale = _TRANSMITTANCE / max(max(channel.quantum_efficiency) for channel in dyes.values())
    silicon = np.interp(_GRID_NM, _SILICON_NM, _SILICON)
    visible = silicon * (1.0 - _edge(655.0, 8.0))
    infrared = silicon * _edge(810.0, 5.0) * (1.0 - _edge(900.0, 5.0)) if _INFRARED in names else 0.0 * silicon
    shapes = {
        **{name: scale * dye.quantum_efficiency_at(_GRID_NM) for name, dye in dyes.items()},
        **dict.fromkeys(_CLEAR, visible),
        "Y": visible * _edge(505.0, 10.0),
        "Cy": visible * (1.0 - _edge(580.0, 12.0)),
        _INFRARED: 0.0 * silicon,
    }
    tables = {}
    for name, letter in zip(names, letters, strict=True):
        if letter in ("M", "P"):
            tables[name] = _SILICON_NM, np.array(_SILICON)
        elif letter in dyes and _INFRARED not in names:
            tables[name] = np.array(dyes[letter].wavelength_nm), scale * np.array(dyes[letter].quantum_efficiency)
        else:
            tables[name] = _GRID_NM, shapes[letter] + infrared
    factor = peak / max(float(values.max()) for _, values in tables.values())
    return {
        name: Channel(
            wavelength_nm=tuple(grid.tolist()),
            quantum_efficiency=tuple(float(f"{value:.4g}") for value in factor * values),
            source=f"assumed: the shape is {_D200 if letter in dyes else _CURVE}, scaled to a peak of {peak:g}",
            assumed=True,
            polarization_angle_deg=float(name.removeprefix(letter)) if name != letter else None,
            extinction_ratio=_EXTINCTION_RATIO if name != letter else None,
        )
        for (name, (grid, values)), letter in zip(tables.items(), letters, strict=True)
    }
