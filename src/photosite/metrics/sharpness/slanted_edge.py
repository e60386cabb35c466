"""Sharpness of a raw frame: the modulation transfer function (MTF) from a slanted edge, without demosaicing.

It is the edge-based spatial frequency response (e-SFR) of ISO 12233, on the sites of one channel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import MONOCHROME, Cfa, channel_mask, channel_names, shifted
from photosite.values.choice import check_choice
from photosite.values.region import Region
from photosite.values.shown import Shown
from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]
Window = Literal["tukey", "hamming"]

_FREQUENCIES = 101
_SATURATED_FRACTION = 1e-3
"""Largest fraction of pixels at the white level, to allow for defects."""


@dataclass(frozen=True, eq=False)
class SlantedEdge(Shown):
    """The sharpness of an edge.

    Parameters
    ----------
    frequency_cycles_per_pixel
        (n,) frequencies from 0 to 1 perpendicular to the edge; 0.5 is the Nyquist frequency of the pixels.
    mtf, standard_uncertainty
        (n,) modulation transfer, 1 at 0; the uncertainty is from the scatter of pixels about the profile: noise and
        unevenness of the edge.
    channel
        Channel that was measured.
    angle_deg, direction
        Angle to the "vertical" or the "horizontal", whichever is closer; positive clockwise.
    line, edge_position
        Rows (columns, for a horizontal edge) of the frame, and the column (row) coordinate where the fitted edge
        crosses the center of each. Pixel i covers the coordinates i to i + 1.
    distance, profile
        Distance from the edge in pixels, negative on the dark side, and the profile there: 0 dark, 1 bright.
    profile_standard_uncertainty
        (bins,) of `profile`, from the scatter of the pixels in each bin.
    pitch_um
        Pixel pitch; None if it was not given.
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
    profile_standard_uncertainty: Array
    pitch_um: float | None = None

    @property
    def frequency_cycles_per_mm(self) -> Array:
        """Frequencies on the sensor.

        Raises
        ------
        InputError
            If the pixel pitch was not given.
        """
        if self.pitch_um is None:
            raise InputError("pitch_um", expected="given to slanted_edge_mtf, for frequencies in cycles per mm")
        return self.frequency_cycles_per_pixel * (1e3 / self.pitch_um)

    @property
    def mtf50(self) -> float | None:
        """Frequency in cycles/pixel at which the MTF first falls to 0.5; None if it stays above up to 1."""
        return None if (found := self.crossing(0.5)) is None else found.value

    @property
    def mtf50_standard_uncertainty(self) -> float | None:
        """Standard uncertainty of `mtf50` in cycles/pixel; None where there is no `mtf50`."""
        return None if (found := self.crossing(0.5)) is None else found.standard_uncertainty

    def crossing(self, level: float) -> Uncertain | None:
        """Return the frequency in cycles/pixel at which the MTF first falls below a level; None if it does not.

        The uncertainty is that of the MTF over its slope, which is that of a line over many frequencies: noise changes
        that between neighbors by its own amount.
        """
        below = np.flatnonzero(self.mtf < level)
        if not below.size:
            return None
        high = int(below[0])
        upper, lower = self.mtf[high - 1], self.mtf[high]
        step = self.frequency_cycles_per_pixel[1]
        value = float(self.frequency_cycles_per_pixel[high - 1] + step * (upper - level) / (upper - lower))
        reach = min(max(round(0.4 * high), 2), _SLOPE_POINTS)
        near = slice(max(high - reach, 0), high + reach)
        slope = float(np.polyfit(self.frequency_cycles_per_pixel[near], self.mtf[near], 1)[0])
        spread = float(self.standard_uncertainty[high])
        return Uncertain.of(value, spread / abs(slope) if slope else math.inf)

    def rise_distance(self, low: float = 0.1, high: float = 0.9) -> Uncertain:
        """Return the distance in pixels over which the profile rises from a level to another.

        It is from the last place below the low level to the first above the high one.

        Raises
        ------
        InputError
            If noise lets the profile cross the levels away from the edge.
        """
        start = int(np.flatnonzero(self.profile < low)[-1])
        end = int(np.flatnonzero(self.profile > high)[0])
        if end <= start:
            raise InputError("profile of the edge", expected="rising once", hint="Average frames, or use a longer edge")
        return self._place(end - 1, high) - self._place(start, low)

    def _place(self, before: int, level: float) -> Uncertain:
        """Return where the profile has a level after a bin, on the cubic through four bins.

        A bin holds the mean over its width: the value in its middle is a 24th of the second difference less.
        """
        first = min(max(before - 2, 0), self.profile.size - 6)
        near = slice(first, first + 6)
        point = np.zeros((4, 6))
        point[range(4), range(1, 5)] = 1.0 + 2.0 / 24.0
        point[range(4), range(4)] = point[range(4), range(2, 6)] = -1.0 / 24.0
        cubic = np.linalg.inv(np.vander(np.arange(4.0), increasing=True)) @ point  # coefficients, by bin
        fit = np.polynomial.Polynomial(cubic @ self.profile[near])
        start, slope = fit - level, fit.deriv()
        at: Any = float(before - first - 1) + 0.5
        for _ in range(8):  # Newton's method, inside the bins around
            at = np.clip(at - start(at) / slope(at), 0.0, 3.0)
        spread = np.linalg.norm(at ** np.arange(4) @ cubic * self.profile_standard_uncertainty[near])
        width = float(self.distance[1] - self.distance[0])
        return Uncertain.of(float(self.distance[first + 1] + width * at), float(width * spread / abs(slope(at))))

    @property
    def overshoot(self) -> Uncertain:
        """Largest profile value above 1, of the difference of bright and dark; of sharpened pictures."""
        near = np.abs(self.distance) < _OVERSHOOT_PX
        smooth = np.convolve(np.pad(self.profile, 2, mode="edge"), _SMOOTHING, "valid")
        place = int(np.flatnonzero(near)[np.argmax(smooth[near])])
        spread = float(self.profile_standard_uncertainty[place]) * math.sqrt(float((_SMOOTHING**2).sum()))
        return Uncertain.of(float(smooth[place]) - 1.0, spread)

    def at(self, frequency_cycles_per_pixel: ArrayLike) -> Array:
        """Return the MTF at frequencies from 0 to 1 cycle/pixel, by linear interpolation."""
        wanted = np.asarray(frequency_cycles_per_pixel, dtype=np.float64)
        if not ((wanted >= 0) & (wanted <= 1)).all():
            raise InputError("frequency_cycles_per_pixel", value=wanted.tolist(), expected="from 0 to 1")
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
    order: int = 1,
    reach_px: float = math.inf,
) -> SlantedEdge:
    """Measure the modulation transfer function on a slanted edge in a raw frame.

    Parameters
    ----------
    frame
        A raw frame, or (rows, cols) values proportional to light: mean electrons, or a mean of frames less black level.
    region
        (r0, r1, c0, c1), rows r0 to r1 and columns c0 to c1, ends excluded, divided by one edge from side to side.
        None: the whole frame. Wider regions give better low frequencies.
    channel, cfa
        Channel to measure; optional for a monochrome frame. Tile of the color filter array, if the frame is an array.
    pitch_um, oversampling
        Pixel pitch, for frequencies in cycles/mm; bins of the profile per pixel, 1 to 16.
    window
        Window on the line spread function: "tukey" is flat over the middle half and falls to 0 as a cosine on both
        sides; "hamming" is that of ISO 12233:2014 and 2017, which smooths the curve more.
    order
        Order of the polynomial of the edge, 1 to 5: 1 is a straight line. ISO 12233:2023 uses 5, for edges that
        distortion bends.
    reach_px
        Largest distance from the edge that is used, 8 pixels or more. A short one leaves out noise and uneven light, a
        long one includes the lens's wide blur.

    Raises
    ------
    InputError
        If the channel or region is not in the frame, pixels are saturated, or there is no straight slanted edge of
        sufficient contrast.

    Notes
    -----
    The method follows ISO 12233:2017 and 2023, annex on the edge-based response (e-SFR). A straight line is fitted to
    the centroids of the lines' derivatives. Pixels are binned by their perpendicular distance from it, in bins of
    1 / oversampling pixel. The windowed differences of the bins are transformed. It differs from the standard in four
    points. The line is refined by least squares of the pixels about the profile, which is less sensitive to noise. The
    mean of a bin is interpolated to its center. The losses by differences and by bins, sinc(f / oversampling) each, are
    divided out. Only the sites of one channel are used, without demosaicing.

    Examples
    --------
    >>> y, x = np.mgrid[:64, :64] + 0.5
    >>> edge = slanted_edge_mtf(1 + 1 / (1 + np.exp(-(x - 32 + 0.1 * (y - 32)) / 0.8)))
    >>> round(edge.angle_deg, 2), edge.direction, round(edge.mtf50, 2)
    (5.71, 'vertical', 0.14)
    """
    _check_options(oversampling, window, pitch_um, order)
    if not reach_px >= LEAST_HALF_WIDTH:
        raise InputError("reach_px", value=reach_px, expected=f"{LEAST_HALF_WIDTH:g} or more")
    values, tile, name, origin = _channel_of(frame, region, channel, cfa)
    mask = channel_mask(tile, name, values.shape)
    direction: Literal["vertical", "horizontal"] = "vertical"
    if _is_horizontal(values, mask):
        direction = "horizontal"
        values, mask, origin = values.T, mask.T, (origin[1], origin[0])
        tile = tuple(zip(*tile, strict=True))
    edge = first_edge(values, mask, order, len(tile[0]))
    near = mask & edge.within(reach_px + _LARGEST_MOVE_PX, values.shape)
    line, x = np.nonzero(near)
    pixels = Pixels(line, _centers(x), values[near], values.shape, len(tile[0]), reach_px)
    edge, profile = refined(whole_cycles(pixels, edge), edge, oversampling)
    frequency = np.linspace(0.0, 1.0, _FREQUENCIES)
    mtf, sensitivity = _transfer(profile, frequency, window)
    lines = np.arange(values.shape[0], dtype=np.int64)
    left, right = profile.ends()
    from_dark = slice(None) if right > left else slice(None, None, -1)
    return SlantedEdge(
        frequency,
        mtf,
        np.sqrt(sensitivity**2 @ profile.variance),
        name,
        math.degrees(math.atan(edge.slope)) * (-1.0 if direction == "vertical" else 1.0),
        direction,
        lines + origin[0],
        edge.at(_centers(lines)) + origin[1],
        profile.distance,
        ((profile.mean - min(left, right)) / abs(right - left))[from_dark],
        (np.sqrt(profile.variance) / abs(right - left))[from_dark],
        pitch_um,
    )


_OVERSHOOT_PX = 8.0
"""Distance from the edge within which sharpening raises the profile."""
_SLOPE_POINTS = 8
"""Most frequencies on either side of a crossing through which the slope of the MTF is fitted."""


def _check_options(oversampling: int, window: str, pitch_um: float | None, order: int) -> None:
    if not 1 <= oversampling <= 16:
        raise InputError("oversampling", value=oversampling, expected="from 1 to 16 bins per pixel")
    check_choice("window", window, Window)
    if not 1 <= order <= 5:
        raise InputError("order", value=order, expected="from 1 to 5")
    if pitch_um is not None and not (math.isfinite(pitch_um) and pitch_um > 0):
        raise InputError("pitch_um", value=pitch_um, expected="above 0")


def _channel_of(
    frame: RawFrame | ArrayLike, region: Region | tuple[int, int, int, int] | None, channel: str | None, cfa: Cfa
) -> tuple[Array, Cfa, str, tuple[int, int]]:
    """Return the values of the region above black level, its tile, the channel, and its first row and column."""
    white = math.inf
    if isinstance(frame, RawFrame):
        frame.check_mosaic()
        whole, cfa = frame.dn.astype(np.float64) - frame.black_level_dn, frame.cfa
        white = frame.white_level_dn - frame.black_level_dn
    else:
        whole = np.asarray(frame, dtype=np.float64)
        if whole.ndim != 2:
            raise InputError("frame", value=whole.shape, expected="one frame of shape (rows, cols)")
    names = channel_names(cfa)
    if channel is None and len(names) > 1:
        raise InputError("channel", value=channel, expected=f"one of {', '.join(names)}")
    name = names[0] if channel is None else channel
    if name not in names:
        raise InputError("channel", value=name, expected=f"one of {', '.join(names)}")
    corners = (0, whole.shape[0], 0, whole.shape[1]) if region is None else region
    r0, r1, c0, c1 = (corners.r0, corners.r1, corners.c0, corners.c1) if isinstance(corners, Region) else corners
    if not (0 <= r0 < r1 <= whole.shape[0] and 0 <= c0 < c1 <= whole.shape[1]):
        expected = f"within the frame of {whole.shape[0]} x {whole.shape[1]} pixels"
        raise InputError("region", value=(r0, r1, c0, c1), expected=expected)
    values, tile = whole[r0:r1, c0:c1], shifted(cfa, r0, c0)
    own = values[channel_mask(tile, name, values.shape)]
    if not np.isfinite(own).all():
        raise InputError("frame", expected="finite in the region")
    if (full := float((own >= white).mean())) > _SATURATED_FRACTION:
        expected = f"at most {_SATURATED_FRACTION:g}"
        raise InputError(f"fraction of saturated {name} pixels", value=full, expected=expected, hint="Expose less")
    return values, tile, name, (r0, c0)


def _is_horizontal(values: Array, mask: NDArray[np.bool_]) -> bool:
    """Return whether the edge is closer to the horizontal: rows differ more than columns."""
    spread = []
    for axis in (1, 0):
        count = mask.sum(axis=axis)
        means = np.where(mask, values, 0.0).sum(axis=axis)[count > 0] / count[count > 0]
        spread.append(float(np.ptp(means)))
    return spread[0] > spread[1]


def _transfer(profile: Profile, frequency: Array, window: Window) -> tuple[Array, Array]:
    """Return the MTF at frequencies in cycles/pixel, and (frequencies, bins) its derivatives by the bins' means."""
    bins = _bin_waves(profile.mean.size, profile.width, frequency.size, window)
    spectrum = bins @ profile.mean
    lost = np.sinc(frequency * profile.width) ** 2
    whole = float(spectrum[0].real)
    mtf = np.abs(spectrum) / abs(whole)
    # Derivative of |spectrum| / whole by the mean of each bin.
    turned = (bins * np.exp(-1j * np.angle(spectrum))[:, None]).real / abs(whole)
    sensitivity = turned - mtf[:, None] * bins[0].real / whole
    return mtf / lost, sensitivity / lost[:, None]


@lru_cache(maxsize=8)
def _bin_waves(count: int, width: float, frequencies: int, window: Window) -> NDArray[np.complex128]:
    """Return (frequencies, bins) factors of the means of bins in the transform of their windowed differences."""
    distance = (np.arange(1, count) - count / 2) * width  # of the differences, symmetric about 0
    weight = _window(np.abs(distance) / (count / 2 * width), window)
    # The transform is linear in the means of the bins: each enters two differences.
    waves = np.exp(-2j * math.pi * np.linspace(0.0, 1.0, frequencies)[:, None] * distance) * weight
    found: NDArray[np.complex128] = np.pad(waves, ((0, 0), (1, 0))) - np.pad(waves, ((0, 0), (0, 1)))
    found.flags.writeable = False
    return found


def _window(part: Array, window: Window) -> Array:
    """Return the window at distances from the edge relative to the end of the profile."""
    if window == "hamming":
        return np.asarray(0.54 + 0.46 * np.cos(math.pi * part))
    return np.where(part < 0.5, 1.0, 0.5 - 0.5 * np.cos(2.0 * math.pi * np.clip(part, 0.5, 1.0)))


# A slanted edge in the pixels of one channel: its line, and its profile across that line.
#
# Lines of pixels run across the edge: rows for a nearly vertical edge. Pixel i covers the coordinates i to i + 1.


LEAST_HALF_WIDTH = 8.0
"""Pixels required on each side of the edge, in every line."""
_LEAST_LINES = 16
_LEAST_CONTRAST = 0.05
"""Smallest (bright - dark) / (bright + dark)."""
_STRAIGHT_PX = 2.0
"""Largest RMS distance of the edge in each line from the straight line."""
_NO_EDGE = -1e6
_PHASES_PER_ORDER = 1.0
"""Highest order of an edge over the number of periods by which it moves."""
_ENDS = 33
"""Lines along a bent edge where its distance from the sides is looked at."""
_LARGEST_MOVE_PX = 8.0
"""Of the edge from the centroids to least squares."""
_FIT_STEPS = 8
_FIT_ENOUGH_PX = 1e-5
_SMOOTHING = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0


def _centers(numbers: NDArray[np.integer[Any]]) -> Array:
    """Return the coordinates of the centers of lines or pixels."""
    return numbers.astype(np.float64) + 0.5


@dataclass(frozen=True, eq=False)
class Pixels(Shown):
    """The pixels of one channel."""

    # (n,) numbers of the lines, centers along them and values
    line: NDArray[np.intp]
    x: Array
    value: Array
    shape: tuple[int, int]  # (lines, columns) of their rectangle
    period: int  # columns after which the sites of the channel repeat
    reach: float = math.inf  # largest distance from the edge that is used

    @property
    def y(self) -> Array:
        """Centers of the lines, whether or not they have pixels."""
        return _centers(np.arange(self.shape[0]))


@dataclass(frozen=True)
class Edge(Shown):
    """An edge x = position + slope (y - middle) + sum_k bend[k] t^(k + 2), t = (y - middle) / middle.

    Bright is on the right (sign 1) or on the left (sign -1). A straight edge has no `bend`.
    """

    position: float
    slope: float
    middle: float
    sign: float
    bend: tuple[float, ...] = ()

    def at(self, y: Array) -> Array:
        """Return the column coordinate where the edge crosses a line."""
        straight = np.asarray(self.position + self.slope * (y - self.middle))
        return straight + self._powers(y) @ np.array(self.bend) if self.bend else straight

    def _powers(self, y: Array) -> Array:
        """Return (n, bends) powers of t."""
        return np.vander((y - self.middle) / self.middle, len(self.bend) + 2, increasing=True)[:, 2:]

    def directions(self, y: Array) -> Array:
        """Return (n, 1 + bends) derivatives of `at` by the slope and by the bends."""
        return np.column_stack([y - self.middle, self._powers(y)])

    def fitted(self, y: Array, x: Array, order: int) -> Edge:
        """Return the polynomial of an order through points, by least squares."""
        bent = replace(self, bend=(0.0,) * (order - 1))
        if order == 1:
            slope, position = np.polyfit(y - self.middle, x, 1)
            return replace(bent, position=float(position), slope=float(slope))
        position, slope, *bend = np.linalg.lstsq(np.column_stack([np.ones_like(y), bent.directions(y)]), x)[0]
        return replace(bent, position=float(position), slope=float(slope), bend=tuple(map(float, bend)))

    def distance(self, pixels: Pixels) -> Array:
        """Return (n,) distances perpendicular to the edge, positive to the right."""
        return (pixels.x - self.at(pixels.y)[pixels.line]) / math.hypot(1.0, self.slope)

    def within(self, reach: float, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return which pixels of a rectangle are within a distance perpendicular to the edge."""
        away = np.abs(np.arange(shape[1]) + 0.5 - self.at(_centers(np.arange(shape[0])))[:, None])
        return np.asarray(away <= reach * math.hypot(1.0, self.slope))


@dataclass(frozen=True, eq=False)
class Profile(Shown):
    """Mean values over the distance from the edge."""

    distance: Array  # (bins,) centers of the bins, symmetric about the edge
    mean: Array  # (bins,) mean of the pixels in each bin, interpolated to its center
    slope: Array  # (bins,) with which it is interpolated
    # (n,) bins of the pixels, their distances from the centers of these, and their values
    index: NDArray[np.intp]
    away: Array
    value: Array

    @cached_property
    def variance(self) -> Array:
        """(bins,) variance of the means, from the scatter of the pixels in neighboring bins, which hold few each."""
        size = self.mean.size
        count = np.bincount(self.index, minlength=size)
        residual = self.value - (self.mean[self.index] + self.slope[self.index] * self.away)
        degrees = np.convolve(np.maximum(count - 1, 0), np.ones(9), "same")
        scatter = np.convolve(np.bincount(self.index, residual**2, size), np.ones(9), "same")
        return np.asarray(scatter / np.maximum(degrees, 1) / count)

    @property
    def width(self) -> float:
        """Width of a bin in pixels."""
        return float(self.distance[1] - self.distance[0])

    def ends(self) -> tuple[float, float]:
        """Return the means of the outer eighths of the profile, left and right."""
        outer = self.mean.size // 8
        return float(self.mean[:outer].mean()), float(self.mean[-outer:].mean())


def first_edge(values: Array, mask: NDArray[np.bool_], order: int = 1, period: int = 1) -> Edge:
    """Return the edge, a polynomial of an order, from the centroids of the derivative of each line.

    An edge that moves by few periods of the channel's sites has a lower order: a polynomial that follows the phases of
    the sites cannot be told from another profile.

    Raises `InputError` if the contrast is too low, or the edge is not smooth.
    """
    outer = max(values.shape[1] // 8, 2)
    ends = [float(values[:, part][mask[:, part]].mean()) for part in (slice(0, outer), slice(-outer, None))]
    contrast = abs(ends[1] - ends[0]) / max(abs(ends[1] + ends[0]), 1e-300)
    if not contrast >= _LEAST_CONTRAST:
        hint = "Choose a region that one edge of a chart divides"
        raise InputError("contrast of the edge", value=contrast, expected=f"{_LEAST_CONTRAST} or more", hint=hint)
    sign = math.copysign(1.0, ends[1] - ends[0])
    lines = np.flatnonzero(mask.sum(axis=1) > 1)
    if len(lines) < _LEAST_LINES:
        raise InputError("lines of pixels across the edge", value=len(lines), expected=f"{_LEAST_LINES} or more")
    y = _centers(lines)
    edge, half = Edge(values.shape[1] / 2, 0.0, values.shape[0] / 2, sign), math.inf
    # Use whole lines first, then windows around the edge that become narrower.
    for next_half in (values.shape[1] / 4, 2 * LEAST_HALF_WIDTH, None):
        centroids = _centroids(values, mask, lines, edge.at(y), half)
        most = max(int(_PHASES_PER_ORDER * len(values) * abs(edge.slope) / period), 1)
        edge = edge.fitted(y, centroids, 1 if next_half is not None else min(order, most))
        if next_half is not None:
            half = max(next_half, 2 * LEAST_HALF_WIDTH)
    scatter = float(np.sqrt(np.mean((centroids - edge.at(y)) ** 2)))
    if not scatter < _STRAIGHT_PX:
        hint = "Choose a region that one straight edge divides from side to side, or average noisy frames"
        expected = f"below {_STRAIGHT_PX:g} pixels RMS"
        raise InputError("deviation of the edge from a straight line", value=scatter, expected=expected, hint=hint)
    return edge


def _centroids(values: Array, mask: NDArray[np.bool_], lines: NDArray[np.intp], middle: Array, half: float) -> Array:
    """Return the centroid of the derivative of each line, under a Hamming window around its middle."""
    found = np.empty(lines.size)
    of_sites: dict[bytes, list[int]] = {}
    for number, line in enumerate(lines):
        of_sites.setdefault(mask[line].tobytes(), []).append(number)
    for alike in of_sites.values():  # lines of the same sites
        places = np.flatnonzero(mask[lines[alike[0]]])
        steps = np.diff(values[np.ix_(lines[alike], places)], axis=1)
        x = (places[:-1] + places[1:] + 1) / 2
        if math.isfinite(half):
            near = np.abs(x - middle[alike][:, None]) / half
            steps = steps * np.where(near < 1, 0.54 + 0.46 * np.cos(math.pi * np.minimum(near, 1.0)), 0.0)
        total = steps.sum(axis=1)
        # A line without an edge gets a position that makes the straight-line fit fail.
        found[alike] = np.where(total != 0, (steps @ x) / np.where(total != 0, total, 1.0), _NO_EDGE)
    return found


def whole_cycles(pixels: Pixels, edge: Edge) -> Pixels:
    """Return the lines over which the edge moves by whole periods, so that all phases are sampled equally.

    Raises `InputError` if the edge moves by less than one period, so that some phases are not sampled.
    """
    lines = pixels.shape[0]
    cycles = math.floor(lines * abs(edge.slope) / pixels.period)
    if cycles < 1:
        hint = "Take a longer region, or turn the chart by about 5 degrees"
        what, moved = f"displacement of the edge over {lines} lines", lines * abs(edge.slope)
        raise InputError(what, value=moved, expected=f"{pixels.period} columns or more", hint=hint)
    used = round(cycles * pixels.period / abs(edge.slope))
    first = (lines - used) // 2
    keep = (pixels.line >= first) & (pixels.line < first + used)
    return replace(pixels, line=pixels.line[keep], x=pixels.x[keep], value=pixels.value[keep])


def profile_across(pixels: Pixels, edge: Edge, distance: Array, oversampling: int) -> Profile:
    """Return the profile in bins of 1 / oversampling pixel, over the distances that every line covers.

    `distance` holds those of the pixels from the edge.

    Raises `InputError` if the edge is too close to the sides of the region, or a bin has no pixel.
    """
    first, last = (float(end(pixels.line)) + 0.5 for end in (np.min, np.max))
    ends = edge.at(np.linspace(first, last, 2 if not edge.bend else _ENDS))
    margin = min(float(ends.min()), pixels.shape[1] - float(ends.max())) - pixels.period
    half = math.floor(oversampling * margin / math.hypot(1.0, edge.slope))
    if half < oversampling * LEAST_HALF_WIDTH:
        what, hint = "distance of the edge from the sides of the region", "Choose a wider region around the edge"
        raise InputError(what, value=max(margin, 0.0), expected=f"{LEAST_HALF_WIDTH:g} pixels or more", hint=hint)
    if math.isfinite(pixels.reach):
        half = min(half, math.floor(oversampling * pixels.reach))
    index = np.floor(distance * oversampling).astype(np.intp) + half
    inside = (index >= 0) & (index < 2 * half)
    index, value = index[inside], pixels.value[inside]
    count = np.bincount(index, minlength=2 * half)
    if count.min() < 1:
        angle_deg = math.degrees(math.atan(abs(edge.slope)))
        hint = "Turn the chart by a few degrees, take a longer region, or reduce {oversampling}"
        expected = "one that samples all phases of a pixel"
        arguments = {"oversampling": 2}
        raise InputError("angle of the edge", value=angle_deg, expected=expected, hint=hint, arguments=arguments)
    middle = (np.arange(2 * half) + 0.5 - half) / oversampling
    away = distance[inside] - middle[index]
    mean = np.bincount(index, value, 2 * half) / count
    # The pixels of a bin are not spread evenly in it: the mean becomes that of even pixels, along a local parabola.
    off, square = (np.bincount(index, moment, 2 * half) / count for moment in (away, away**2))
    slope = np.gradient(mean, middle + off)
    centered = mean - slope * off
    bend = np.diff(np.pad(centered, 1, mode="edge"), 2) * oversampling**2
    centered -= 0.5 * bend * (square - 1.0 / (12.0 * oversampling**2))
    return Profile(middle, centered, slope, index, away, value)


def refined(pixels: Pixels, edge: Edge, oversampling: int) -> tuple[Edge, Profile]:
    """Return the edge whose slope and bends minimize the residuals of the pixels about their profile, and that profile.

    They are found by Gauss-Newton steps. A shift of the line only shifts the profile; the line is put, by
    convention, where the profile is half way from dark to bright.
    """
    distance = edge.distance(pixels)
    profile = profile_across(pixels, edge, distance, oversampling)
    for _ in range(_FIT_STEPS):
        smooth = np.convolve(np.pad(profile.mean, 2, mode="edge"), _SMOOTHING, "valid")
        near = np.abs(distance) < profile.distance[-1]
        line = pixels.line[near]
        # Linear interpolation between the centers of the bins.
        place = (distance[near] - profile.distance[0]) / profile.width
        low = place.astype(np.intp)
        part = place - low
        gradient = np.gradient(smooth, profile.distance)
        steepness, expected = (each[low] + part * (np.append(np.diff(each), 0.0)[low]) for each in (gradient, smooth))
        residual = pixels.value[near] - expected
        # As the edge moves to the right, a pixel moves to the left relative to it.
        moved = steepness / -math.hypot(1.0, edge.slope)
        square, product = (np.bincount(line, moved * each, pixels.shape[0]) for each in (moved, residual))
        along = edge.directions(pixels.y)
        turn, *bends = np.linalg.solve(along.T @ (square[:, None] * along), along.T @ product)
        shift = _half_way(profile.distance, smooth, profile.ends()) * math.hypot(1.0, edge.slope)
        bend = tuple(float(one + more) for one, more in zip(edge.bend, bends, strict=True))
        edge = replace(edge, position=edge.position + shift, slope=edge.slope + float(turn), bend=bend)
        distance = edge.distance(pixels)
        profile = profile_across(pixels, edge, distance, oversampling)
        if abs(shift) + abs(turn) * pixels.shape[0] + sum(map(abs, bends)) < _FIT_ENOUGH_PX:
            break
    return edge, profile


def _half_way(distance: Array, profile: Array, ends: tuple[float, float]) -> float:
    """Return where a profile crosses the middle between its ends; the mean of several crossings."""
    above = (profile > (ends[0] + ends[1]) / 2).astype(np.int8)
    places = np.flatnonzero(np.diff(above))
    fraction = ((ends[0] + ends[1]) / 2 - profile[places]) / (profile[places + 1] - profile[places])
    return float(np.mean(distance[places] + fraction * (distance[1] - distance[0])))
