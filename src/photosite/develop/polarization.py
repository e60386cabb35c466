"""Stokes parameters, degree and angle of linear polarization from a raw frame of pixels with polarizers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.develop.demosaic import demosaic_bilinear
from photosite.errors import InputError
from photosite.files.hdf5 import create_hdf5
from photosite.files.writing import atomic_path
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.model import Sensor
from photosite.values.cfa import plane_names
from photosite.values.choice import check_choice
from photosite.values.shown import Shown

Map = NDArray[np.float32]

_NAME = re.compile(r"(\D+)(\d+)")
"""A channel behind a polarizer: P90, R45; the number is the angle in degrees."""


@dataclass(frozen=True, eq=False)
class Stokes(Shown):
    """Linear Stokes parameters of each pixel, (rows, cols): S0 = I0 + I90, S1 = I0 - I90, S2 = I45 - I135.

    The unit is digital numbers above black, as an ideal polarizer passes them.

    Examples
    --------
    >>> seen = Stokes(np.array([[200.0]]), np.array([[60.0]]), np.array([[-80.0]]))
    >>> seen.dolp, seen.aolp_deg.round(2)
    (array([[0.5]]), array([[153.43]]))
    """

    s0: Map
    s1: Map
    s2: Map

    @property
    def dolp(self) -> Map:
        """Degree of linear polarization; NaN where there is no light. Noise raises it where it is near 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(self.s0 > 0, np.hypot(self.s1, self.s2) / self.s0, np.nan), self.s0.dtype)

    @property
    def aolp_deg(self) -> Map:
        """Angle of the electric field in degrees, 0 to below 180, counterclockwise from the rows."""
        return np.asarray(np.degrees(0.5 * np.arctan2(self.s2, self.s1)) % 180.0, self.s1.dtype)


def stokes_matrix(angles_deg: ArrayLike, extinction_ratio: ArrayLike = np.inf) -> NDArray[np.float64]:
    """Return (n, 3): what pixels behind polarizers read of S0, S1 and S2.

    Unpolarized light of S0 gives S0 / 2 in each, whatever the extinction ratio, because a sensor file states the
    efficiency for it.

    Examples
    --------
    >>> stokes_matrix([0, 45]).round(3) + 0.0
    array([[0.5, 0.5, 0. ],
           [0.5, 0. , 0.5]])
    """
    twice = np.radians(2.0 * np.atleast_1d(np.asarray(angles_deg, dtype=np.float64)))
    ratio = np.broadcast_to(np.asarray(extinction_ratio, dtype=np.float64), twice.shape)
    diattenuation = 1.0 - 2.0 / (ratio + 1.0)
    return 0.5 * np.stack([np.ones_like(twice), diattenuation * np.cos(twice), diattenuation * np.sin(twice)], axis=1)


def stokes(raw: RawFrame, color: str | None = None, sensor: Sensor | None = None) -> Stokes:
    """Return the Stokes parameters of the light in every pixel, by least squares over the polarizers.

    The channels are interpolated linearly to every pixel first. Pixels near a saturated one are NaN.

    Parameters
    ----------
    raw
        A frame whose channels are named by a color and the angle of a polarizer, such as P90, P45, P135 and P0.
    color
        The color of the channels, such as "G" of G0, G45, G90 and G135. Default: the only one.
    sensor
        Sensor whose file states the angles and extinction ratios. Default: the angles of the names, ideal polarizers.

    Raises
    ------
    InputError
        If the frame has no polarizers, fewer than three angles of the color, or several colors and none is chosen; or
        if the sensor has not all channels of the color.

    References
    ----------
    J. S. Tyo et al., "Review of passive imaging polarimetry for remote sensing applications", Applied Optics 45(22),
    2006.

    Examples
    --------
    >>> dn = np.tile(np.array([[400, 300], [300, 200]], np.uint16) + 100, (8, 8))
    >>> seen = stokes(RawFrame(dn, bits=12, cfa=(("P90", "P45"), ("P135", "P0")), black_level_dn=100))
    >>> round(float(seen.dolp[4, 4]), 4), float(seen.aolp_deg[4, 4])
    (0.3333, 90.0)
    """
    from scipy.ndimage import maximum_filter

    names = plane_names(raw.cfa)
    parts = {name: (found[1], float(found[2])) for name in names if (found := _NAME.fullmatch(name))}
    colors = sorted({letter for letter, _ in parts.values()})
    chosen = colors[0] if color is None and len(colors) == 1 else color
    angles = {name: angle for name, (letter, angle) in parts.items() if letter == chosen}
    if not colors:
        expected = "channels with the angle of a polarizer in their names, such as P90, P45, P135 and P0"
        raise InputError("cfa", where="stokes", value=", ".join(names), expected=expected)
    if chosen not in colors:
        raise InputError("color", value=color, expected=f"one of {', '.join(colors)}")
    matrix = stokes_matrix(*_polarizers(angles, sensor))
    if np.linalg.matrix_rank(matrix) < 3:
        raise InputError("cfa", where="stokes", value=", ".join(angles), expected="three different angles or more")
    planes = demosaic_bilinear(raw.dn.astype(np.float32) - np.float32(raw.black_level_dn), raw.cfa)
    planes = planes[..., [names.index(name) for name in angles]]
    seen = planes @ np.linalg.pinv(matrix).T.astype(np.float32)
    reach = max(len(raw.cfa), len(raw.cfa[0])) - 1
    seen[maximum_filter(raw.dn >= raw.white_level_dn, 2 * reach + 1)] = np.nan
    return Stokes(*np.moveaxis(seen, 2, 0))


def _polarizers(named: Mapping[str, float], sensor: Sensor | None) -> tuple[list[float], list[float]]:
    """Return angles and extinction ratios, those of the sensor's channels where it states them."""
    if sensor is not None and (missing := named.keys() - sensor.channels.keys()):
        expected = f"with the channels {', '.join(named)} of the frame; {', '.join(sorted(missing))} are missing"
        raise InputError("sensor", value=sensor.name, expected=expected)
    angles, ratios = [], []
    for name, angle in named.items():
        channel = None if sensor is None else sensor.channels[name]
        stated = None if channel is None else channel.polarization_angle_deg
        ratio = None if channel is None else channel.extinction_ratio
        angles.append(angle if stated is None else stated)
        ratios.append(np.inf if ratio is None else ratio)
    return angles, ratios


PolarizationPicture = Literal["degree", "angle"]


def polarization_picture(seen: Stokes, kind: PolarizationPicture = "degree") -> Map:
    """Return a picture (rows, cols, 3) of the polarization, 0 to 1, black where it is not known.

    Parameters
    ----------
    seen
        The Stokes parameters.
    kind
        "degree" in gray, or "angle" as hue, red for 0 degrees, with the degree as saturation.

    Examples
    --------
    >>> seen = Stokes(np.array([[200.0]]), np.array([[200.0]]), np.array([[0.0]]))
    >>> polarization_picture(seen, "angle").tolist(), polarization_picture(seen).tolist()
    ([[[1.0, 0.0, 0.0]]], [[[1.0, 1.0, 1.0]]])
    """
    from matplotlib.colors import hsv_to_rgb

    check_choice("kind", kind, PolarizationPicture)
    degree = np.clip(seen.dolp, 0.0, 1.0)
    known = np.isfinite(degree)
    degree = np.where(known, degree, 0.0)
    if kind == "degree":
        return np.repeat(degree[..., None], 3, axis=2).astype(np.float32)
    hue = np.where(known, seen.aolp_deg / 180.0, 0.0)
    return np.asarray(hsv_to_rgb(np.stack([hue, degree, known.astype(np.float64)], axis=2)), np.float32)


def save_stokes(seen: Stokes, path: str | PathLike[str]) -> None:
    """Write the maps s0, s1, s2 (DN), dolp and aolp_deg as HDF5 datasets (rows, cols) of 32-bit floats.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    with atomic_path(path) as temporary, create_hdf5(temporary) as file:
        for name in ("s0", "s1", "s2", "dolp", "aolp_deg"):
            file.create_dataset(name, data=np.asarray(getattr(seen, name), np.float32), compression="gzip")
