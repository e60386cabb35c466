"""Sharpness of a raw frame: its modulation transfer function, from a slanted edge, before any demosaicing.

The edge-based spatial frequency response of ISO 12233, on the sites of one channel at their true places.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError, did_you_mean
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.edge_profile import Pixels, Profile, first_edge, refined, whole_cycles
from photosite.values.cfa import MONOCHROME, Cfa, channel_mask, channel_names, shifted
from photosite.values.region import Region

Array = NDArray[np.float64]
Window = Literal["tukey", "hamming"]

_FREQUENCIES = 101
_SATURATED_SHARE = 1e-3
"""More pixels than this at the white level are light, not defects."""


@dataclass(frozen=True, eq=False)
class SlantedEdge:
    """What an edge tells of sharpness.

    Parameters
    ----------
    frequency_cycles_per_pixel
        (n,) 0 to 1 across the edge, at a right angle to it; 0.5 is the Nyquist frequency of a row of pixels.
    mtf
        (n,) modulation transfer, 1 at 0.
    standard_uncertainty
        (n,) of `mtf`, from the scatter of pixels about the edge's profile: noise, and whatever makes the edge uneven.
    channel
        Whose pixels.
    angle_deg
        From the nearest of the vertical and the horizontal; clockwise is positive.
    direction
        "vertical" or "horizontal": which of them that is.
    line, edge_position
        Rows (columns, of a horizontal edge) of the frame, and where the fitted edge crosses the middle of each: column
        (row) coordinate over borders, pixel i covers i to i + 1.
    distance, profile
        Distance across the edge in pixels, dark side negative, and the edge's profile there: 0 dark, 1 bright.
    pitch_um
        Of the pixels; None where it was not given.
    """

    frequency_cycles_per_pixel: Array
    mtf: Array
    standard_uncertainty: Array
    channel: str
    angle_deg: float
    direction: Literal["vertical", "horizontal"]
    line: NDArray[np.int64]
    edge_position: Array
    distance: Array
    profile: Array
    pitch_um: float | None = None

    @property
    def frequency_cycles_per_mm(self) -> Array:
        """Frequencies on the sensor.

        Raises
        ------
        InputError
            If the pixels' pitch was not given.
        """
        if self.pitch_um is None:
            raise InputError("cycles per mm need the pixels' pitch; give pitch_um to slanted_edge_mtf")
        return self.frequency_cycles_per_pixel * (1e3 / self.pitch_um)

    @property
    def mtf50(self) -> float | None:
        """Frequency in cycles/pixel at which the transfer first falls to 0.5; None where it does not up to 1."""
        below = np.flatnonzero(self.mtf < 0.5)
        if below.size == 0:
            return None
        high = int(below[0])
        upper, lower = self.mtf[high - 1], self.mtf[high]
        step = self.frequency_cycles_per_pixel[1]
        return float(self.frequency_cycles_per_pixel[high - 1] + step * (upper - 0.5) / (upper - lower))

    def at(self, frequency_cycles_per_pixel: ArrayLike) -> Array:
        """Modulation transfer at frequencies from 0 to 1 cycle/pixel, linear between those measured."""
        wanted = np.asarray(frequency_cycles_per_pixel, dtype=np.float64)
        if not ((wanted >= 0) & (wanted <= 1)).all():
            raise InputError("an edge tells the transfer from 0 to 1 cycle/pixel, not outside")
        return np.interp(wanted, self.frequency_cycles_per_pixel, self.mtf)


def slanted_edge_mtf(
    frame: RawFrame | ArrayLike,
    region: Region | tuple[int, int, int, int] | None = None,
    channel: str | None = None,
    *,
    cfa: Cfa = MONOCHROME,
    pitch_um: float | None = None,
    oversampling: int = 4,
    window: Window = "tukey",
) -> SlantedEdge:
    """Modulation transfer function from a slanted edge in a raw frame.

    Parameters
    ----------
    frame
        A raw frame, or (rows, cols) values in proportion to light: mean electrons, or a mean of frames less black.
    region
        (r0, r1, c0, c1), rows r0 to r1 and columns c0 to c1, the second of each excluded, with one edge through it from
        side to side. None: all of it. The wider, the better low frequencies are known.
    channel
        Whose pixels to take; may be left out of a monochrome frame.
    cfa
        The colour filter array's tile, where the frame is an array.
    pitch_um
        Of the pixels, for frequencies in cycles/mm.
    oversampling
        Bins of the profile per pixel.
    window
        Of the line spread: "tukey" is flat over the middle half and falls to 0 as a cosine on either side; "hamming"
        is that of ISO 12233:2014 and 2017, which smooths the curve more.

    Returns
    -------
    SlantedEdge

    Raises
    ------
    InputError
        If the channel or region is not of this frame, pixels are saturated, or there is no straight, slanted edge
        with contrast enough.

    Notes
    -----
    After ISO 12233:2017 and 2023, annex on the edge-based response (e-SFR). Lines give the edge by their centroids, a
    straight line through these is fitted, pixels are gathered in bins of 1 / oversampling pixel by their distance from
    it at a right angle, and the bins' differences, windowed, are transformed. It differs in this: the line is refined
    by least squares of the pixels about the profile, which noise disturbs less; a bin's mean is brought from its
    pixels' mean distance to its middle; the loss by differences and by bins, sinc(f / oversampling) each, is divided
    out; pixels are one channel's own, where they are.

    Examples
    --------
    >>> y, x = np.mgrid[:64, :64] + 0.5
    >>> edge = slanted_edge_mtf(1 + 1 / (1 + np.exp(-(x - 32 + 0.1 * (y - 32)) / 0.8)))
    >>> round(edge.angle_deg, 2), edge.direction, round(edge.mtf50, 2)
    (5.71, 'vertical', 0.14)
    """
    _check_options(oversampling, window, pitch_um)
    values, tile, name, origin = _channel_of(frame, region, channel, cfa)
    mask = channel_mask(tile, name, values.shape)
    direction: Literal["vertical", "horizontal"] = "vertical"
    if _lies(values, mask):
        direction = "horizontal"
        values, mask, origin = values.T, mask.T, (origin[1], origin[0])
        tile = tuple(zip(*tile, strict=True))
    lines, columns = np.nonzero(mask)
    pixels = Pixels(
        lines.astype(np.float64) + 0.5, columns.astype(np.float64) + 0.5, values[mask], values.shape, len(tile[0])
    )
    edge = first_edge(values, mask)
    edge, profile = refined(whole_cycles(pixels, edge), edge, oversampling)
    frequency = np.linspace(0.0, 1.0, _FREQUENCIES)
    mtf, uncertainty = _transfer(profile, frequency, window)
    line = np.arange(values.shape[0], dtype=np.int64)
    left, right = profile.ends()
    from_dark = slice(None) if right > left else slice(None, None, -1)
    return SlantedEdge(
        frequency,
        mtf,
        uncertainty,
        name,
        math.degrees(math.atan(edge.slope)) * (-1.0 if direction == "vertical" else 1.0),
        direction,
        line + origin[0],
        edge.at(line.astype(np.float64) + 0.5) + origin[1],
        profile.distance,
        ((profile.mean - min(left, right)) / abs(right - left))[from_dark],
        pitch_um,
    )


def _check_options(oversampling: int, window: str, pitch_um: float | None) -> None:
    if not 1 <= oversampling <= 16:
        raise InputError(f"oversampling is from 1 to 16 bins per pixel, not {oversampling}")
    if window not in ("tukey", "hamming"):
        raise InputError(f"the window is 'tukey' or 'hamming', not '{window}'")
    if pitch_um is not None and not (math.isfinite(pitch_um) and pitch_um > 0):
        raise InputError(f"the pixels' pitch must be above 0 um, not {pitch_um}")


def _channel_of(
    frame: RawFrame | ArrayLike, region: Region | tuple[int, int, int, int] | None, channel: str | None, cfa: Cfa
) -> tuple[Array, Cfa, str, tuple[int, int]]:
    """The region's values above black, its tile, the channel's name, and where the region begins."""
    white = math.inf
    if isinstance(frame, RawFrame):
        whole, cfa = frame.dn.astype(np.float64) - frame.black_level_dn, frame.cfa
        white = frame.white_level_dn - frame.black_level_dn
    else:
        whole = np.asarray(frame, dtype=np.float64)
        if whole.ndim != 2:
            raise InputError(f"an edge is measured in (rows, cols) of one frame, not in an array of {whole.shape}")
    names = channel_names(cfa)
    if channel is None and len(names) > 1:
        raise InputError(f"an edge in a mosaic is measured in one channel; choose it from {', '.join(names)}")
    name = names[0] if channel is None else channel
    if name not in names:
        raise InputError(f"the frame has no channel '{name}'; {did_you_mean(name, names)}")
    corners = (0, whole.shape[0], 0, whole.shape[1]) if region is None else region
    r0, r1, c0, c1 = (corners.r0, corners.r1, corners.c0, corners.c1) if isinstance(corners, Region) else corners
    if not (0 <= r0 < r1 <= whole.shape[0] and 0 <= c0 < c1 <= whole.shape[1]):
        raise InputError(
            f"the region is rows {r0} to {r1}, columns {c0} to {c1}, which is not within the frame's "
            f"{whole.shape[0]} x {whole.shape[1]} pixels"
        )
    values, tile = whole[r0:r1, c0:c1], shifted(cfa, r0, c0)
    own = values[channel_mask(tile, name, values.shape)]
    if not np.isfinite(own).all():
        raise InputError("some of the edge's pixels are NaN or infinite; give values in proportion to light")
    if (full := float((own >= white).mean())) > _SATURATED_SHARE:
        raise InputError(
            f"{full:.1%} of the edge's {name} pixels are at the white level, where signal is not in proportion to "
            "light; expose less"
        )
    return values, tile, name, (r0, c0)


def _lies(values: Array, mask: NDArray[np.bool_]) -> bool:
    """Whether the edge is nearer to the horizontal: rows differ more than columns."""
    spread = []
    for axis in (1, 0):
        count = mask.sum(axis=axis)
        means = np.where(mask, values, 0.0).sum(axis=axis)[count > 0] / count[count > 0]
        spread.append(float(np.ptp(means)))
    return spread[0] > spread[1]


def _transfer(profile: Profile, frequency: Array, window: Window) -> tuple[Array, Array]:
    """Modulation transfer at frequencies in cycles/pixel, and its standard uncertainty."""
    place = profile.distance[1:] - profile.width / 2  # of the differences: 0 in the middle
    weight = _window(np.abs(place) / (profile.distance[-1] + profile.width / 2), window)
    # The transform is linear in the bins' means: each enters two differences.
    waves = np.exp(-2j * math.pi * frequency[:, None] * place) * weight
    bins = np.pad(waves, ((0, 0), (1, 0))) - np.pad(waves, ((0, 0), (0, 1)))
    spectrum = bins @ profile.mean
    lost = np.sinc(frequency * profile.width) ** 2
    whole = float(spectrum[0].real)
    mtf = np.abs(spectrum) / abs(whole)
    # How |spectrum| / whole moves with each bin.
    turned = (bins * np.exp(-1j * np.angle(spectrum))[:, None]).real / abs(whole)
    share = turned - mtf[:, None] * bins[0].real / whole
    uncertainty = np.sqrt(share**2 @ profile.variance)
    return mtf / lost, uncertainty / lost


def _window(part: Array, window: Window) -> Array:
    """By distance from the edge, 1 at the profile's end."""
    if window == "hamming":
        return np.asarray(0.54 + 0.46 * np.cos(math.pi * part))
    return np.where(part < 0.5, 1.0, 0.5 - 0.5 * np.cos(2.0 * math.pi * np.clip(part, 0.5, 1.0)))
