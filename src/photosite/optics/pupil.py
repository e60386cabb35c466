"""The opening of a lens: circle, central obscuration, blades, spider vanes, or any array; and its autocorrelation.

Lengths are in radii of the circle that the f-number belongs to; y is up, the picture upright. The autocorrelation of
the bare opening is the transfer function of a lens without aberrations. It is taken exactly along rays: the opening is
cut into chords along the ray, and the overlap of intervals is known in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.optics.arguments import check_numbers
from photosite.optics.ring import bare_transfer

Array = NDArray[np.float64]

_ROWS = 768
_RADII = 1025
_ANGLE_STEP_DEG, _VANES_ANGLE_STEP_DEG = 0.125, 0.5
_SUBROWS = 16
_COARSE = 96


@dataclass(frozen=True, eq=False)
class Pupil:
    """The opening of a lens.

    Parameters
    ----------
    obscuration
        Diameter of the dark disc in the middle, relative to the pupil's; 0 to below 1.
    blades
        Of the diaphragm: 3 or more, corners on the circle of the f-number. 0: a round opening.
    rotation_deg
        Of the first corner, from right towards up.
    roundness
        Of the blades: 0 straight edges, 1 arcs of the circle itself; between, arcs of radius 1 / roundness.
    vanes
        Of the spider that holds the obscuration, evenly spaced, from the middle to the rim.
    vane_width
        Relative to the pupil's diameter.
    vane_rotation_deg
        Of the first vane, from right towards up.
    amplitude
        (n, n) instead of all these: amplitude transmission, 0 to 1, of n x n equal cells over the square around the
        circle, first row on top; nothing outside the circle. The square root of the transmission of light.

    Raises
    ------
    InputError
        If a value cannot be, or an array comes with shapes.

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
        check_numbers(self, "obscuration", "rotation_deg", "roundness", "vane_width", "vane_rotation_deg")
        check_numbers(self, "blades", "vanes", whole=True)
        for name in ("obscuration", "rotation_deg", "roundness", "vane_width", "vane_rotation_deg"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"{name} of a pupil must be a finite number, not {getattr(self, name)}")
        if not 0 <= self.obscuration < 1:
            raise InputError(f"obscuration is a diameter over the pupil's, 0 to below 1, not {self.obscuration}")
        if self.blades != 0 and not 3 <= self.blades <= 360:
            raise InputError(f"a diaphragm has 3 to 360 blades, or 0 for a round opening, not {self.blades}")
        if not 0 <= self.roundness <= 1:
            raise InputError(f"roundness of blades goes from 0, straight, to 1, round; not {self.roundness}")
        if not 0 <= self.vanes <= 12:
            raise InputError(f"a spider has 0 to 12 vanes, not {self.vanes}")
        if not 0 <= self.vane_width < 0.5 or (self.vanes > 0) != (self.vane_width > 0):
            raise InputError(
                f"vanes and vane_width, relative to the pupil's diameter and below 0.5, go together: got {self.vanes} "
                f"vanes of width {self.vane_width}"
            )
        if self.amplitude is not None:
            if self.obscuration or self.blades or self.vanes:
                raise InputError("a pupil is an array, or it has blades, an obscuration and vanes: give one of the two")
            object.__setattr__(self, "amplitude", _checked(self.amplitude))
        elif not self.area > 1e-3:
            raise InputError("this pupil lets no light through: less than 0.1 % of its circle is open")

    @property
    def rotationally_symmetric(self) -> bool:
        """Whether it is a circle or a ring."""
        return self.amplitude is None and self.vanes == 0 and (self.blades == 0 or self.roundness == 1)

    @cached_property
    def area(self) -> float:
        """Light it passes, relative to the open circle of its f-number."""
        if self.amplitude is not None:
            return float((self.amplitude**2).sum()) * 4 / (math.pi * self.amplitude.size)
        if self.rotationally_symmetric:
            return 1 - self.obscuration**2
        offset, weights = self._rows(0.0)
        low, high = self._chords(0.0, offset)
        return float((high - low).sum(axis=1) @ weights) / math.pi

    @cached_property
    def edge_ratio(self) -> float:
        """Length of its edges over its area, relative to that of a circle: how much farther diffraction spreads."""
        ring = np.linspace(0, math.pi, 720, endpoint=False)
        step = 4.0 / _RADII
        slope = (1 - self.transfer(step * np.sin(ring), step * np.cos(ring)).mean()) / step
        return float(slope * math.pi / 4)

    def transfer(self, sy: Array, sx: Array) -> Array:
        """Transfer function of the opening without aberrations at frequencies over the cutoff, y up; 1 at 0.

        Exact for circles and rings; for blades and vanes within 3e-4 at the worst place, where straight edges come to
        lie on each other, and 1e-5 in the mean. An array is taken as cells of even transmission, exactly.
        """
        if self.amplitude is not None:
            return self._array_transfer(sy, sx)
        radius = np.hypot(sy, sx)
        if self.rotationally_symmetric:
            return bare_transfer(radius, self.obscuration)
        angles, table = self._table
        where = np.minimum(radius, 1.0) * (_RADII - 1)
        low = np.minimum(where.astype(np.intp), _RADII - 2)
        part = where - low
        angle = np.mod(np.arctan2(sy, sx) - angles[0], math.pi) + angles[0]
        i = np.clip(np.searchsorted(angles, angle, side="right") - 1, 0, angles.size - 2)
        share = (angle - angles[i]) / (angles[i + 1] - angles[i])
        first = table[i, low] * (1 - part) + table[i, low + 1] * part
        second = table[i + 1, low] * (1 - part) + table[i + 1, low + 1] * part
        result: Array = first * (1 - share) + second * share
        return result

    def cells(self, count: int) -> tuple[Array, Array, Array]:
        """(count, count) amplitude, y and x of cells over the square around the circle, y and x increasing.

        Amplitude is the mean over a cell, and y and x are the middle of its open part: a hard edge is not a staircase.
        """
        if self.amplitude is not None:
            return _resampled(self.amplitude[::-1], count)
        t = np.asarray((np.arange(count * _SUBROWS) + 0.5) * (2 / (count * _SUBROWS)) - 1, np.float64)
        edges = np.linspace(-1.0, 1.0, count + 1)
        low, high = self._chords(0.0, t)
        length = np.zeros((t.size, count + 1))
        moment = np.zeros((t.size, count + 1))
        for j in range(low.shape[1]):
            a, b = low[:, j, None], high[:, j, None]
            x = np.clip(edges, a, b)
            length += x - a
            moment += (x * x - a * a) / 2
        inside = np.diff(length, axis=1)
        area = inside.reshape(count, _SUBROWS, count).sum(axis=1)
        x_sum = np.diff(moment, axis=1).reshape(count, _SUBROWS, count).sum(axis=1)
        y_sum = (inside * t[:, None]).reshape(count, _SUBROWS, count).sum(axis=1)
        open_ = area > 1e-9 / count
        middle = (edges[1:] + edges[:-1]) / 2
        y = np.where(open_, y_sum / np.where(open_, area, 1.0), middle[:, None])
        x = np.where(open_, x_sum / np.where(open_, area, 1.0), middle)
        return np.where(open_, area, 0.0) * (count / (2 * _SUBROWS)), y, x

    @cached_property
    def coarsely_open(self) -> NDArray[np.bool_]:
        """(96, 96) which cells of the square around the circle are not dark, y and x increasing."""
        open_: NDArray[np.bool_] = self.cells(_COARSE)[0] > 0
        return open_

    def _rows(self, angle_rad: float) -> tuple[Array, Array]:
        """Offsets of chords along an angle, and their weights: corners stand between rows, none within one."""
        corners = [(self.obscuration, math.pi / 2 + angle_rad), (-self.obscuration, math.pi / 2 + angle_rad)]
        start = math.radians(self.rotation_deg)
        corners += [(1.0, start + 2 * math.pi * k / self.blades) for k in range(self.blades)]
        for k in range(self.vanes):
            axis = math.radians(self.vane_rotation_deg) + 2 * math.pi * k / self.vanes
            for radius in {1.0, max(self.obscuration, self.vane_width), self.vane_width}:
                aside = math.asin(self.vane_width / radius)
                corners += [(radius, axis + aside), (radius, axis - aside)]
        edges = [-1.0, 1.0, *(radius * math.sin(at - angle_rad) for radius, at in corners)]
        offset, weights = [], []
        edges = np.unique(np.round(edges, 12)).tolist()
        for low, high in pairwise(edges):
            # Dense at both ends, where chords of round edges grow like square roots.
            count = max(8, math.ceil(_ROWS * (high - low) / 2))
            phase = (np.arange(count) + 0.5) * (math.pi / count)
            offset.append((low + high) / 2 - (high - low) / 2 * np.cos(phase))
            weights.append((high - low) * math.sin(math.pi / (2 * count)) * np.sin(phase))
        return np.concatenate(offset), np.concatenate(weights)

    def _chords(self, angle_rad: float, offset: Array) -> tuple[Array, Array]:
        """(rows, intervals) begin and end, along the angle, of lines at offsets to its left; length 0 where empty."""
        ux, uy = math.cos(angle_rad), math.sin(angle_rad)
        outer_low, outer_high = self._outline(ux, uy, offset)
        holes = self._holes(ux, uy, offset)
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
        order = np.argsort(~open_, axis=1, kind="stable")[:, :most]  # few lines meet every hole: drop empty columns
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
                room = math.cos(half_angle) - offset * across
                if abs(along) < 1e-12:
                    high = np.where(room < 0, low, high)
                elif along > 0:
                    high = np.minimum(high, room / along)
                else:
                    low = np.maximum(low, room / along)
            else:
                radius = 1 / self.roundness
                center = math.cos(half_angle) - math.sqrt(radius**2 - math.sin(half_angle) ** 2)
                reach = np.sqrt(np.maximum(radius**2 - (offset - center * across) ** 2, 0.0))
                low, high = np.maximum(low, center * along - reach), np.minimum(high, center * along + reach)
        return low, np.maximum(low, high)

    def _holes(self, ux: float, uy: float, offset: Array) -> list[tuple[Array, Array]]:
        """Begin and end, on each line, of what is dark; both are far outside where the line misses it."""
        found = []
        if self.obscuration:
            hit = np.abs(offset) < self.obscuration
            half = np.sqrt(np.maximum(self.obscuration**2 - offset**2, 0.0))
            found.append((np.where(hit, -half, 9.0), np.where(hit, half, 9.0)))
        for k in range(self.vanes):
            angle = math.radians(self.vane_rotation_deg) + 2 * math.pi * k / self.vanes
            vx, vy = math.cos(angle), math.sin(angle)
            along, across = vx * ux + vy * uy, vy * ux - vx * uy
            # A point q u + p n lies at q along + p across on the vane's axis, and at -q across + p along beside it.
            sides = [(along, offset * across, 0.0, 2.0), (-across, offset * along, -self.vane_width, self.vane_width)]
            low, high = np.full_like(offset, -9.0), np.full_like(offset, 9.0)
            for slope, start, least, most in sides:
                if abs(slope) < 1e-12:
                    miss = (start < least) | (start > most)
                    low, high = np.where(miss, 9.0, low), np.where(miss, -9.0, high)
                else:
                    ends = np.sort(np.stack([(least - start) / slope, (most - start) / slope]), axis=0)
                    low, high = np.maximum(low, ends[0]), np.minimum(high, ends[1])
            miss = high <= low
            found.append((np.where(miss, 9.0, low), np.where(miss, 9.0, high)))
        return found

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        """Angles, and (angles, radii) of the transfer function: linear between them."""
        start = math.radians(self.rotation_deg if self.blades else self.vane_rotation_deg)
        even = np.radians(np.arange(0.0, 180.0, _VANES_ANGLE_STEP_DEG if self.vanes else _ANGLE_STEP_DEG))
        # Along straight edges the function is creased: a node stands on each crease.
        creases = [
            math.radians(self.vane_rotation_deg) + 2 * math.pi * k / self.vanes - start for k in range(self.vanes)
        ]
        if self.blades:
            creases += [math.pi / 2 + (2 * k + 1) * math.pi / self.blades for k in range(self.blades)]
        angles = start + np.unique(np.round(np.concatenate([even, np.mod(creases, math.pi)]), 12))
        rays = [(angle, *self._rows(angle)) for angle in angles]
        table = np.stack([_along_ray(*self._chords(angle, rows), weights) for angle, rows, weights in rays])
        table /= table[:, :1]
        return np.append(angles, angles[0] + math.pi), np.concatenate([table, table[:1]])

    @cached_property
    def _correlation(self) -> Array:
        """(2 n + 2, 2 n + 2) autocorrelation of the array's cells at whole lags from -n to n, and a rim of zeros."""
        assert self.amplitude is not None
        a = self.amplitude[::-1]
        n = len(a)
        power = np.abs(np.fft.rfft2(a, (2 * n, 2 * n))) ** 2
        result: Array = np.fft.fftshift(np.fft.irfft2(power, (2 * n, 2 * n))) / (a**2).sum()
        return np.pad(result, ((0, 2), (0, 2)))

    def _array_transfer(self, sy: Array, sx: Array) -> Array:
        """Between whole lags the overlap of even cells is linear in each direction."""
        table = self._correlation
        n = (len(table) - 2) // 2
        y, x = np.broadcast_arrays(np.clip(sy, -1, 1) * n + n, np.clip(sx, -1, 1) * n + n)
        i, j = np.floor(y).astype(np.intp), np.floor(x).astype(np.intp)
        v, u = y - i, x - j
        result: Array = (1 - v) * ((1 - u) * table[i, j] + u * table[i, j + 1])
        result += v * ((1 - u) * table[i + 1, j] + u * table[i + 1, j + 1])
        return result


def _along_ray(low: Array, high: Array, weights: Array) -> Array:
    """(radii,) overlap of the opening with itself shifted along its chords by 0 to 2.

    Each pair of ends at a distance d bends the overlap at the shift d: its second derivative is collected there,
    linearly between nodes, which keeps the values at the nodes exact, and summed twice from the far end.
    """
    ends = np.concatenate([low, high], axis=1)
    sign = np.concatenate([np.ones(low.shape[1]), -np.ones(high.shape[1])])
    scale = (_RADII - 1) / 2
    i, j = np.triu_indices(sign.size, 1)
    shift = np.abs(ends[:, i] - ends[:, j]) * scale
    node = np.minimum(shift.astype(np.intp), _RADII - 1)
    part = shift - node
    weight = -sign[i] * sign[j] * weights[:, None]
    bends = np.bincount(node.ravel(), (weight * (1 - part)).ravel(), _RADII + 1)
    bends += np.bincount(node.ravel() + 1, (weight * part).ravel(), _RADII + 1)
    slope = np.cumsum(bends[::-1])[::-1]
    overlap = np.cumsum(slope[::-1])[::-1]
    return overlap[1:] / scale  # at node k: sum over j > k of (j - k) bends[j]


def _checked(amplitude: Array) -> Array:
    values = np.array(amplitude, dtype=np.float64)
    if values.ndim != 2 or values.shape[0] != values.shape[1] or len(values) < 8:
        raise InputError(f"a pupil's amplitude is a square array of 8 x 8 cells or more, not of shape {values.shape}")
    if not np.isfinite(values).all() or values.min() < 0 or values.max() > 1:
        raise InputError("a pupil's amplitude transmission lies between 0 and 1 everywhere; some values do not")
    n = len(values)
    near = np.maximum(np.abs(np.arange(n) + 0.5 - n / 2) - 0.5, 0.0) / (n / 2)
    if values[np.hypot(near[:, None], near) >= 1].any():
        raise InputError("a pupil's amplitude must be 0 outside the circle that touches the array's sides; some is not")
    if not values.any():
        raise InputError("this pupil lets no light through: its amplitude is 0 everywhere")
    values.flags.writeable = False
    return values


def _resampled(amplitude: Array, count: int) -> tuple[Array, Array, Array]:
    """Means of an array over coarser or finer cells, and the middles of their open parts."""
    n = len(amplitude)
    fine = np.linspace(-1.0, 1.0, n + 1)
    edges = np.linspace(-1.0, 1.0, count + 1)
    # share[i, k]: length of cell k of the array that lies in cell i; offset: its first moment.
    low = np.maximum(edges[:-1, None], fine[None, :-1])
    high = np.maximum(np.minimum(edges[1:, None], fine[None, 1:]), low)
    share, first = high - low, (high**2 - low**2) / 2
    area = share @ amplitude @ share.T
    open_ = area > 0
    safe = np.where(open_, area, 1.0)
    middle = (edges[1:] + edges[:-1]) / 2
    y = np.where(open_, (first @ amplitude @ share.T) / safe, middle[:, None])
    x = np.where(open_, (share @ amplitude @ first.T) / safe, middle)
    return area * (count / 2) ** 2, y, x
