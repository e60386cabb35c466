"""The pupil of a lens: circle, central obscuration, iris blades, spider vanes or an array; and its autocorrelation.

Lengths are in radii of the full circle, to which the f-number refers; y is up for an upright image. The autocorrelation
of the pupil is the OTF of the lens without aberrations. It is exact along rays of frequencies: the pupil is cut into
chords along the ray, and the overlap of shifted chords has a closed form.

With any wavefront, the OTF is the autocorrelation of the pupil function, by Fourier transforms. Frequencies are
relative to the cutoff 1 / (lambda N), y up; wavefronts are in waves. Rotationally symmetric cases use the quadrature in
`annular`; the tests compare the two.

Sampling errors come from the edge of the pupil, at small shifts, and are the same with and without a wavefront. So only
the change that the wavefront makes is taken from the samples, and added to the exact OTF of the aberration-free pupil
(`Pupil.transfer`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, compiled, read_only
from photosite.errors import InputError
from photosite.optics.annular import Waves, aberration_free_otf
from photosite.optics.checks import check_number, check_whole
from photosite.optics.zernike import Term, zernike_values
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_ROWS = 768
"""Chords across the pupil."""
_RADII = 1025
"""Frequencies from 0 to the cutoff along one ray."""
_ANGLE_STEP_DEG, _VANES_ANGLE_STEP_DEG = 0.125, 0.5
_SUBROWS = 16
"""Chords per row of cells."""
_COARSE = 96
_BEYOND_RIM = 9.0
"""Coordinate of both ends of an obstruction that a chord misses: anything well outside the pupil."""


@dataclass(frozen=True, eq=False)
class Pupil(Shown):
    """The pupil of a lens.

    Parameters
    ----------
    obscuration
        Diameter of the central obscuration relative to the pupil's; 0 to below 1.
    blades
        Number of iris blades: 3 or more, with corners on the full circle. 0: a circular pupil.
    rotation_deg
        Angle of the first corner, from right towards up.
    roundness
        Curvature of the blades: 0 straight edges, 1 arcs of the full circle; in between, arcs of radius 1 / roundness.
    vanes
        Number of spider vanes, evenly spaced, from the center to the rim.
    vane_width
        Width of a vane relative to the pupil's diameter.
    vane_rotation_deg
        Angle of the first vane, from right towards up.
    amplitude
        (n, n) amplitude transmission, 0 to 1, in place of all the above: the square root of the light's transmission,
        of n x n equal cells over the square around the circle, first row on top, 0 outside the circle.

    Raises
    ------
    InputError
        If a value is out of range, or an array is combined with shapes.

    Examples
    --------
    >>> Pupil().area, round(Pupil(obscuration=0.5).area, 6)
    (1.0, 0.75)
    >>> round(Pupil(blades=6).area * np.pi, 5)   # 3 sqrt(3) / 2
    2.59808
    """

    obscuration: float = 0.0
    blades: int = 0
    rotation_deg: float = 0.0
    roundness: float = 0.0
    vanes: int = 0
    vane_width: float = 0.0
    vane_rotation_deg: float = 0.0
    amplitude: Array | None = None

    def __post_init__(self) -> None:
        fraction = "a fraction of the pupil's diameter, 0 to below 1"
        check_number("obscuration", self.obscuration, fraction, at_least=0, below=1)
        many = "a whole number from 3 to 360, or 0 for a circle"
        check_whole("blades", self.blades, many, 0, 360)
        if 0 < self.blades < 3:
            raise InputError("blades", value=self.blades, expected=many)
        check_number("rotation_deg", self.rotation_deg)
        check_number("roundness", self.roundness, "from 0 (straight) to 1 (round)", at_least=0, at_most=1)
        check_whole("vanes", self.vanes, "a whole number from 0 to 12", 0, 12)
        width = "above 0 and below 0.5 with vanes, and 0 without"
        check_number("vane_width", self.vane_width, width, at_least=0, below=0.5)
        if (self.vanes > 0) != (self.vane_width > 0):
            raise InputError("vane_width", value=self.vane_width, expected=width)
        check_number("vane_rotation_deg", self.vane_rotation_deg)
        if self.amplitude is not None:
            if self.obscuration or self.blades or self.vanes:
                hint = "Give the array, or blades, obscuration and vanes"
                raise InputError("a pupil cannot be an array and have shapes", hint=hint)
            object.__setattr__(self, "amplitude", _checked_amplitude(self.amplitude))
        elif not self.area > 1e-3:
            raise InputError("the pupil transmits less than 0.1 % of the light of its circle")

    @property
    def rotationally_symmetric(self) -> bool:
        """Whether the pupil is a circle or an annulus."""
        return self.amplitude is None and self.vanes == 0 and (self.blades == 0 or self.roundness == 1)

    @cached_property
    def area(self) -> float:
        """Transmitted light relative to the full circle."""
        if self.amplitude is not None:
            return float((self.amplitude**2).sum()) * 4 / (math.pi * self.amplitude.size)
        if self.rotationally_symmetric:
            return 1 - self.obscuration**2
        offset, weights = self._rows(0.0)
        low, high = self._chords(0.0, offset)
        return float((high - low).sum(axis=1) @ weights) / math.pi

    @cached_property
    def edge_ratio(self) -> float:
        """Length of the edges over the area, relative to a circle: how much wider the diffraction pattern is."""
        ring = np.linspace(0, math.pi, 720, endpoint=False)
        step = 4.0 / _RADII
        slope = (1 - self.transfer(step * np.sin(ring), step * np.cos(ring)).mean()) / step
        return float(slope * math.pi / 4)

    def transfer(self, sy: Array, sx: Array) -> Array:
        """Return the OTF without aberrations at frequencies relative to the cutoff, y up; 1 at 0.

        It is exact for circles and annuli, and for arrays as uniform cells. For blades and vanes the error is at most
        3e-4, where straight edges coincide, and 1e-5 on average.
        """
        if self.amplitude is not None:
            return self._array_transfer(sy, sx)
        if self.rotationally_symmetric:
            return aberration_free_otf(np.hypot(sy, sx), self.obscuration)
        # Here, because NumPy's functions use vector instructions.
        radius, angle = np.hypot(sy, sx), np.arctan2(sy, sx)
        result = np.empty(radius.shape)
        _between_rays(read_only(np.ravel(radius)), read_only(np.ravel(angle)), *self._table, result.reshape(-1))
        return result

    def cells(self, count: int) -> tuple[Array, Array, Array]:
        """Return (count, count) amplitude, y and x of cells over the square around the circle, y and x increasing.

        The amplitude is the mean over a cell; y and x are the centroid of its open part. So edges are not staircases.
        """
        if self.amplitude is not None:
            return _resampled(self.amplitude[::-1], count)
        t = np.asarray((np.arange(count * _SUBROWS) + 0.5) * (2 / (count * _SUBROWS)) - 1, np.float64)
        edges = np.linspace(-1.0, 1.0, count + 1)
        low, high = (read_only(ends) for ends in self._chords(0.0, t))
        area, x_sum, y_sum = sums = np.zeros((3, count, count))
        _sum_chords(low, high, t, edges, sums)
        open_ = area > 1e-9 / count
        middle = (edges[1:] + edges[:-1]) / 2
        y = np.where(open_, y_sum / np.where(open_, area, 1.0), middle[:, None])
        x = np.where(open_, x_sum / np.where(open_, area, 1.0), middle)
        return np.where(open_, area, 0.0) * (count / (2 * _SUBROWS)), y, x

    @cached_property
    def coarsely_open(self) -> NDArray[np.bool_]:
        """(96, 96) mask of the cells that are at least partly open, y and x increasing."""
        return self.cells(_COARSE)[0] > 0

    def _rows(self, angle_rad: float) -> tuple[Array, Array]:
        """Return offsets and weights of chords along an angle, split at corners, where the length has a kink."""
        corners = [(self.obscuration, math.pi / 2 + angle_rad), (-self.obscuration, math.pi / 2 + angle_rad)]
        start = math.radians(self.rotation_deg)
        corners += [(1.0, start + 2 * math.pi * k / self.blades) for k in range(self.blades)]
        for k in range(self.vanes):
            axis = math.radians(self.vane_rotation_deg) + 2 * math.pi * k / self.vanes
            for radius in {1.0, max(self.obscuration, self.vane_width), self.vane_width}:
                aside = math.asin(self.vane_width / radius)
                corners += [(radius, axis + aside), (radius, axis - aside)]
        edges = [-1.0, 1.0, *(radius * math.sin(at - angle_rad) for radius, at in corners)]
        borders = np.unique(np.round(edges, 12))
        low, width = borders[:-1], np.diff(borders)
        # Dense at both ends, where chords of round edges grow as a square root.
        counts = np.maximum(8, np.ceil(_ROWS * width / 2)).astype(np.int64)
        part = np.repeat(np.arange(counts.size), counts)
        phase = (np.arange(part.size) - (np.cumsum(counts) - counts)[part] + 0.5) * (math.pi / counts)[part]
        offset = (low + width / 2)[part] - (width / 2)[part] * np.cos(phase)
        return offset, (width * np.sin(math.pi / (2 * counts)))[part] * np.sin(phase)

    def _chords(self, angle_rad: float, offset: Array) -> tuple[Array, Array]:
        """Return (rows, intervals) begin and end of the open parts of chords; unused intervals have length 0."""
        ux, uy = math.cos(angle_rad), math.sin(angle_rad)
        outer_low, outer_high = self._outline(ux, uy, offset)
        holes = self._obstructions(ux, uy, offset)
        if not holes:
            return outer_low[:, None], outer_high[:, None]
        begin = np.stack([h[0] for h in holes], axis=1)
        end = np.stack([h[1] for h in holes], axis=1)
        order = np.argsort(begin, axis=1)
        begin, end = np.take_along_axis(begin, order, 1), np.take_along_axis(end, order, 1)
        covered = np.maximum.accumulate(end, axis=1)
        low = np.concatenate([outer_low[:, None], np.maximum(covered, outer_low[:, None])], axis=1)
        high = np.concatenate([np.minimum(begin, outer_high[:, None]), outer_high[:, None]], axis=1)
        open_ = high > low
        most = max(int(open_.sum(axis=1).max()), 1)
        order = np.argsort(~open_, axis=1, kind="stable")[
            :, :most
        ]  # few chords meet every obstruction: drop unused columns
        low, high = np.take_along_axis(low, order, 1), np.take_along_axis(high, order, 1)
        return low, np.maximum(low, high)

    def _outline(self, ux: float, uy: float, offset: Array) -> tuple[Array, Array]:
        half = np.sqrt(np.maximum(1 - offset**2, 0.0))
        low, high = -half, half
        if self.blades == 0 or self.roundness == 1:
            return low, high
        half_angle = math.pi / self.blades
        for k in range(self.blades):
            normal = math.radians(self.rotation_deg) + (2 * k + 1) * half_angle
            nx, ny = math.cos(normal), math.sin(normal)
            along, across = nx * ux + ny * uy, ny * ux - nx * uy
            if self.roundness == 0:
                clearance = math.cos(half_angle) - offset * across
                if abs(along) < 1e-12:
                    high = np.where(clearance < 0, low, high)
                elif along > 0:
                    high = np.minimum(high, clearance / along)
                else:
                    low = np.maximum(low, clearance / along)
            else:
                radius = 1 / self.roundness
                center = math.cos(half_angle) - math.sqrt(radius**2 - math.sin(half_angle) ** 2)
                half = np.sqrt(np.maximum(radius**2 - (offset - center * across) ** 2, 0.0))
                low, high = np.maximum(low, center * along - half), np.minimum(high, center * along + half)
        return low, np.maximum(low, high)

    def _obstructions(self, ux: float, uy: float, offset: Array) -> list[tuple[Array, Array]]:
        """Return begin and end of each obstruction on each chord; both `_BEYOND_RIM` where the chord misses it."""
        found = []
        if self.obscuration:
            hit = np.abs(offset) < self.obscuration
            half = np.sqrt(np.maximum(self.obscuration**2 - offset**2, 0.0))
            found.append((np.where(hit, -half, _BEYOND_RIM), np.where(hit, half, _BEYOND_RIM)))
        for k in range(self.vanes):
            angle = math.radians(self.vane_rotation_deg) + 2 * math.pi * k / self.vanes
            vx, vy = math.cos(angle), math.sin(angle)
            along, across = vx * ux + vy * uy, vy * ux - vx * uy
            # A point q u + p n is at q along + p across on the axis of the vane, and at -q across + p along beside it.
            sides = [(along, offset * across, 0.0, 2.0), (-across, offset * along, -self.vane_width, self.vane_width)]
            low, high = np.full_like(offset, -_BEYOND_RIM), np.full_like(offset, _BEYOND_RIM)
            for slope, start, least, most in sides:
                if abs(slope) < 1e-12:
                    miss = (start < least) | (start > most)
                    low, high = np.where(miss, _BEYOND_RIM, low), np.where(miss, -_BEYOND_RIM, high)
                else:
                    ends = np.sort(np.stack([(least - start) / slope, (most - start) / slope]), axis=0)
                    low, high = np.maximum(low, ends[0]), np.minimum(high, ends[1])
            miss = high <= low
            found.append((np.where(miss, _BEYOND_RIM, low), np.where(miss, _BEYOND_RIM, high)))
        return found

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        """Return angles and the (angles, radii) table of the OTF, for linear interpolation."""
        start = math.radians(self.rotation_deg if self.blades else self.vane_rotation_deg)
        even = np.radians(np.arange(0.0, 180.0, _VANES_ANGLE_STEP_DEG if self.vanes else _ANGLE_STEP_DEG))
        # Along straight edges the OTF has a crease: put a node on each.
        creases = [
            math.radians(self.vane_rotation_deg) + 2 * math.pi * k / self.vanes - start for k in range(self.vanes)
        ]
        if self.blades:
            creases += [math.pi / 2 + (2 * k + 1) * math.pi / self.blades for k in range(self.blades)]
        angles = start + np.unique(np.round(np.concatenate([even, np.mod(creases, math.pi)]), 12))
        # Without vanes, the pupil and its overlap repeat within half a turn: only the rays of one part are computed.
        parts = 1 if self.vanes else self.blades // 2 if self.blades % 2 == 0 else self.blades
        own = angles.size // parts
        if own * parts != angles.size or not np.allclose(angles[own:], angles[:-own] + math.pi / parts, atol=1e-9):
            own, parts = angles.size, 1
        rays = [(angle, *self._rows(angle)) for angle in angles[:own]]
        table = np.stack([_along_ray(*self._chords(angle, rows), weights) for angle, rows, weights in rays])
        table = np.tile(table / table[:, :1], (parts, 1))
        return read_only(np.append(angles, angles[0] + math.pi)), read_only(np.concatenate([table, table[:1]]))

    @cached_property
    def _correlation(self) -> Array:
        """Return the autocorrelation of the cells at whole lags from -n to n, with a border of zeros."""
        assert self.amplitude is not None
        a = self.amplitude[::-1]
        n = len(a)
        power = np.abs(np.fft.rfft2(a, (2 * n, 2 * n))) ** 2
        result: Array = np.fft.fftshift(np.fft.irfft2(power, (2 * n, 2 * n))) / (a**2).sum()
        return np.pad(result, ((0, 2), (0, 2)))

    def _array_transfer(self, sy: Array, sx: Array) -> Array:
        """Return the OTF of an array: between whole lags, the overlap of uniform cells is bilinear."""
        table = self._correlation
        n = (len(table) - 2) // 2
        y, x = np.broadcast_arrays(np.clip(sy, -1, 1) * n + n, np.clip(sx, -1, 1) * n + n)
        i, j = np.floor(y).astype(np.intp), np.floor(x).astype(np.intp)
        v, u = y - i, x - j
        result: Array = (1 - v) * ((1 - u) * table[i, j] + u * table[i, j + 1])
        result += v * ((1 - u) * table[i + 1, j] + u * table[i + 1, j + 1])
        return result


@compiled()
def _sum_chords(low: F64, high: F64, offset: F64, edges: F64, sums: F64) -> None:
    """Add length, moment along x and moment along y of chords, cut at the edges of cells, to (3, cells, cells).

    - `low`, `high`: (chords, intervals) begin and end of the open parts; each row of cells has equally many chords.
    - `offset`: (chords,) y of each.
    """
    count = sums.shape[1]
    chords = low.shape[0] // count
    for row in range(count):
        length, along_x, along_y = sums[0, row], sums[1, row], sums[2, row]
        for chord in range(row * chords, (row + 1) * chords):
            y = offset[chord]
            for interval in range(low.shape[1]):
                begin, end = low[chord, interval], high[chord, interval]
                for cell in range(length.size):
                    left, right = max(begin, edges[cell]), min(end, edges[cell + 1])
                    inside = max(right - left, 0.0)
                    length[cell] += inside
                    along_x[cell] += inside * (left + right) / 2
                    along_y[cell] += inside * y


@compiled()
def _between_rays(radius: F64, direction: F64, angles: F64, table: F64, out: F64) -> None:
    """Interpolate a table of (angles, radii) linearly at points; the angles cover half a turn, nearly evenly."""
    rays, radii = table.shape
    per_angle = (rays - 1) / (angles[-1] - angles[0])
    for k in range(out.size):
        place = min(radius[k], 1.0) * (radii - 1)
        low = max(min(int(place), radii - 2), 0)  # 0 also for NaN
        part = place - low
        angle = direction[k] - math.pi * math.floor((direction[k] - angles[0]) / math.pi)
        i = min(max(int((angle - angles[0]) * per_angle), 0), rays - 2)
        while i > 0 and angle < angles[i]:
            i -= 1
        while i < rays - 2 and angle >= angles[i + 1]:
            i += 1
        fraction = (angle - angles[i]) / (angles[i + 1] - angles[i])
        first = table[i, low] * (1 - part) + table[i, low + 1] * part
        second = table[i + 1, low] * (1 - part) + table[i + 1, low + 1] * part
        out[k] = first * (1 - fraction) + second * fraction


def _along_ray(low: Array, high: Array, weights: Array) -> Array:
    """Return the (radii,) overlap of the pupil with itself, shifted along its chords by 0 to 2.

    Each pair of chord ends at a distance d puts a kink into the overlap at the shift d. The kinks, which are the second
    derivative, are shared linearly among the nodes, which keeps the values at the nodes exact, and summed twice.
    """
    ends = np.concatenate([low, high], axis=1)
    sign = np.concatenate([np.ones(low.shape[1]), -np.ones(high.shape[1])])
    scale = (_RADII - 1) / 2
    i, j = np.triu_indices(sign.size, 1)
    shift = np.abs(ends[:, i] - ends[:, j]) * scale
    node = np.minimum(shift.astype(np.intp), _RADII - 1)
    part = shift - node
    weight = -sign[i] * sign[j] * weights[:, None]
    kinks = np.bincount(node.ravel(), (weight * (1 - part)).ravel(), _RADII + 1)
    kinks += np.bincount(node.ravel() + 1, (weight * part).ravel(), _RADII + 1)
    slope = np.cumsum(kinks[::-1])[::-1]
    overlap = np.cumsum(slope[::-1])[::-1]
    return overlap[1:] / scale  # at node k: sum over j > k of (j - k) kinks[j]


def _checked_amplitude(amplitude: Array) -> Array:
    values = np.array(amplitude, dtype=np.float64)
    if values.ndim != 2 or values.shape[0] != values.shape[1] or len(values) < 8:
        raise InputError("amplitude", value=values.shape, expected="a square array of 8 x 8 cells or more")
    if not np.isfinite(values).all() or values.min() < 0 or values.max() > 1:
        extreme = values.min() if values.min() < 0 else values.max()
        raise InputError("amplitude", value=extreme, expected="from 0 to 1 in every cell")
    n = len(values)
    near = np.maximum(np.abs(np.arange(n) + 0.5 - n / 2) - 0.5, 0.0) / (n / 2)
    if values[np.hypot(near[:, None], near) >= 1].any():
        raise InputError("amplitude", expected="0 outside the circle that touches the sides of the array")
    if not values.any():
        raise InputError("amplitude", expected="above 0 in some cell")
    values.flags.writeable = False
    return values


def _resampled(amplitude: Array, count: int) -> tuple[Array, Array, Array]:
    """Return means of an array over coarser or finer cells, and the centroids of their open parts."""
    n = len(amplitude)
    fine = np.linspace(-1.0, 1.0, n + 1)
    edges = np.linspace(-1.0, 1.0, count + 1)
    # overlap[i, k]: length of cell k of the array within cell i; first: its first moment.
    low = np.maximum(edges[:-1, None], fine[None, :-1])
    high = np.maximum(np.minimum(edges[1:, None], fine[None, 1:]), low)
    overlap, first = high - low, (high**2 - low**2) / 2
    area = overlap @ amplitude @ overlap.T
    open_ = area > 0
    safe = np.where(open_, area, 1.0)
    middle = (edges[1:] + edges[:-1]) / 2
    y = np.where(open_, (first @ amplitude @ overlap.T) / safe, middle[:, None])
    x = np.where(open_, (overlap @ amplitude @ first.T) / safe, middle)
    return area * (count / 2) ** 2, y, x


Complex = NDArray[np.complex128]

LARGEST_SLOPE = 64.0
"""Slope, waves per pupil radius, up to which the finest grid samples a wavefront well enough."""
_CELLS_BY_SLOPE = ((2.0, 256), (6.0, 384), (12.0, 512), (24.0, 768), (math.inf, 1024))
"""Cells across the pupil by largest slope; the OTF is then right within 2e-4 (tests/optics/test_wavefront.py)."""
_MARGIN = 1
"""Columns of negative frequencies that the spline interpolation needs."""
_TAPS = 4
_GAP = 16
"""Values between rows of a field in memory: rows whose distance is a power of two compete for the same cache lines."""


@dataclass(frozen=True, eq=False)
class PupilAutocorrelation:
    """OTFs of one pupil under wavefronts of the same few Zernike terms, with `count` cells across the pupil."""

    pupil: Pupil
    terms: tuple[Term, ...]
    count: int

    @cached_property
    def _cells(self) -> tuple[NDArray[np.float32], NDArray[np.intp], Array]:
        """Return the amplitude of open cells, their numbers in memory (`_image`), and (terms, open cells) values."""
        amplitude, y, x = self.pupil.cells(self.count)
        open_ = amplitude > 0
        row, col = np.nonzero(open_)
        place = row * (2 * self.count + _GAP) + col
        return amplitude[open_].astype(np.float32), place, zernike_values(self.terms, x[open_], y[open_])

    @cached_property
    def _aberration_free(self) -> NDArray[np.float32]:
        size = 2 * self.count
        one = np.ones(size, np.float32)
        return self._image(self._cells[0], np.zeros((size, size), np.float32), one, one)

    def otf(self, waves: Waves) -> SampledOtf:
        """Return the OTF under a wavefront.

        Transforms are in single precision, whose rounding is a thousandth of the error of the sampling.
        """
        from scipy.fft import rfft2

        amplitude, _, values = self._cells
        turns = np.array([waves[t] for t in self.terms]) @ values
        phase = (2 * math.pi * (turns - np.rint(turns))).astype(np.float32)
        # Dividing by the transform of a cubic B-spline gives the coefficients of the spline through the samples.
        size = 2 * self.count
        spline = (2 + np.cos((2 * math.pi / size) * np.arange(size))) / 3
        scale = size * size * (self.pupil.area * math.pi / 4 * self.count**2)
        down, across = (1 / (scale * spline)).astype(np.float32), (1 / spline).astype(np.float32)
        field = amplitude * (np.cos(phase) + np.complex64(1j) * np.sin(phase))
        image = self._image(field, self._aberration_free, down, across)
        return SampledOtf(self.pupil, self.count, _centered(rfft2(image, overwrite_x=True)))

    def _image(self, field: NDArray[Any], less: F32, down: F32, across: F32) -> NDArray[np.float32]:
        """Return the squared transform of the field in the open cells, less an array, times factors on each axis."""
        size = 2 * self.count
        padded = np.zeros((size, size + _GAP), np.complex64)
        padded.reshape(-1)[self._cells[1]] = field
        _transform(padded[:, : self.count], axis=0)  # columns of padding are 0
        _transform(padded[:, :size], axis=1)
        image = np.empty((size, size), np.float32)
        _weigh_power(padded.view(np.float32), less, down, across, image)
        return image


@compiled()
def _weigh_power(field: F32, less: F32, down: F32, across: F32, out: F32) -> None:
    """Compute (|field|^2 - less) * down * across; real and imaginary parts of the field alternate."""
    for r in range(out.shape[0]):
        parts, base, line, factor = field[r], less[r], out[r], down[r]
        for c in range(line.size):
            power = parts[2 * c] * parts[2 * c] + parts[2 * c + 1] * parts[2 * c + 1]
            line[c] = ((power - base[c]) * factor) * across[c]


@dataclass(frozen=True, eq=False)
class SampledOtf:
    """The OTF of a pupil with a wavefront: (sy, sx) relative frequencies -> complex values.

    `count` is the number of steps from 0 to the cutoff. `change` are the spline coefficients of the change that the
    wavefront makes, see `_centered`. A column and a row of frequencies are fastest.
    """

    pupil: Pupil
    count: int
    change: NDArray[np.complex64]

    def __call__(self, sy: Array, sx: Array) -> Complex:
        sy, sx = np.asarray(sy, np.float64), np.asarray(sx, np.float64)
        is_grid = sy.ndim == sx.ndim == 2 and sy.shape[1] == sx.shape[0] == 1
        grid = self._on_grid(sy[:, 0], sx[0]) if is_grid else None
        sy, sx = np.broadcast_arrays(sy, sx)
        inside = np.hypot(sy, sx) < 1
        result = np.zeros(sy.shape, np.complex128)
        sy, sx = sy[inside], sx[inside]
        change = self._at(sy, sx) if grid is None else grid[inside]
        change[(sy == 0) & (sx == 0)] = 0  # a wavefront keeps the energy; rounding does not
        result[inside] = self.pupil.transfer(sy, sx) + change
        return result

    def _at(self, sy: Array, sx: Array) -> Complex:
        """Return the change at (n,) points inside the cutoff."""
        from scipy.ndimage import map_coordinates

        flip = np.where(sx < 0, -1.0, 1.0)
        where = np.stack([(flip * sy + 1) * self.count, flip * sx * self.count + _MARGIN])
        values: Complex = map_coordinates(self.change, where, order=3, prefilter=False)
        return np.where(flip < 0, values.conj(), values)

    def _on_grid(self, sy: Array, sx: Array) -> Complex:
        """Return the (rows, cols) change on a grid of frequencies; points outside the cutoff have any value."""
        change = np.empty((sy.size, sx.size), np.complex128)
        for side, flip in ((sx >= 0, 1.0), (sx < 0, -1.0)):
            if side.any():
                down, rows = _spline_taps((flip * sy + 1) * self.count, len(self.change))
                across, cols = _spline_taps(flip * sx[side] * self.count + _MARGIN, self.change.shape[1])
                part = np.empty((sy.size, cols.shape[1]), np.complex128)
                values = read_only(self.change).view(np.float32)
                _sum_taps(values, rows, down, cols, across, flip, part.view(np.float64))
                change[:, side] = part
        return change


@compiled()
def _sum_taps(values: F32, rows: I64, down: F32, cols: I64, across: F32, flip: float, out: F64) -> None:
    """Compute sums of four rows and four columns of complex values, times weights; the conjugate if `flip` is -1.

    Real and imaginary parts alternate.
    """
    first, last = cols.min(), cols.max()
    begin, end = 2 * first, 2 * last + 2
    for r in range(rows.shape[1]):
        a, b = values[rows[0, r], begin:end], values[rows[1, r], begin:end]
        c, d = values[rows[2, r], begin:end], values[rows[3, r], begin:end]
        wa, wb, wc, wd = down[0, r], down[1, r], down[2, r], down[3, r]
        line = np.empty(end - begin, np.float32)
        for i in range(line.size):
            line[i] = ((wa * a[i] + wb * b[i]) + wc * c[i]) + wd * d[i]
        for k in range(cols.shape[1]):
            real = imag = np.float32(0.0)
            for tap in range(cols.shape[0]):
                place = 2 * (cols[tap, k] - first)
                real += across[tap, k] * line[place]
                imag += across[tap, k] * line[place + 1]
            out[r, 2 * k], out[r, 2 * k + 1] = real, flip * imag


def _spline_taps(position: Array, size: int) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Return (4, n) weights and indices of the cubic B-splines that reach positions; the ends repeat."""
    first = np.floor(position)
    t = position - first
    weights = np.stack([(1 - t) ** 3, 4 + t * t * (3 * t - 6), 1 + 3 * t * (1 + t - t * t), t**3]) / 6
    index = first.astype(np.intp) - 1 + np.arange(_TAPS)[:, None]
    return weights.astype(np.float32), np.clip(index, 0, size - 1)


def _transform(values: NDArray[np.complex64], axis: int) -> None:
    from scipy.fft import fft

    result = fft(values, axis=axis, overwrite_x=True)
    if not np.may_share_memory(result, values):  # SciPy need not use the memory that it may overwrite
        values[:] = result


def _centered(change: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Return (rows, cols) of a half-plane transform: rows in rising frequency, columns from a margin below 0.

    The margin is the conjugate of the mirror image.
    """
    rows, cols = change.shape
    whole = np.empty((rows, _MARGIN + cols), np.complex64)
    whole[: rows // 2, _MARGIN:] = change[rows // 2 :]
    whole[rows // 2 :, _MARGIN:] = change[: rows // 2]
    opposite = (rows // 2 - np.arange(rows)) % rows
    whole[:, :_MARGIN] = np.conj(change[opposite, _MARGIN:0:-1])
    return whole


def largest_slope(pupil: Pupil, waves: Waves) -> float:
    """Return the largest slope of a wavefront over the pupil, in waves per pupil radius.

    A ray lands 2 slopes times lambda N from the ideal image point.
    """
    if not waves:
        return 0.0
    open_ = pupil.coarsely_open
    middle = (np.arange(len(open_)) + 0.5) * (2 / len(open_)) - 1
    y, x = np.broadcast_arrays(middle[:, None], middle)
    values = np.tensordot(np.array(list(waves.values())), zernike_values(tuple(waves), x, y), 1)
    slope = np.hypot(*np.gradient(values, 2 / len(open_)))
    return float(slope[open_].max())


def cells_for(slope: float) -> int:
    """Return the cells across the pupil that a wavefront of a largest slope needs."""
    return next(count for most, count in _CELLS_BY_SLOPE if slope <= most)
