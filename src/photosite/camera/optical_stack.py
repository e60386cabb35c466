"""The sensor's optical stack applied to a mosaic of mean electrons: angular response and crosstalk.

`photosite.sensor.optical_stack` is its description. Filters act on the spectrum, in `Sensor.response_at`; the low-pass
filter acts on the transfer function, in `photosite.engine.transfer.Sampling`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32, F64, I64, compiled
from photosite.engine.threads import parallel_for, threads_for
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.lens import Optics
from photosite.sensor.model import Sensor
from photosite.sensor.optical_stack import AngularResponse, Crosstalk, Kernel
from photosite.values.cfa import Cfa, channel_names

Array = NDArray[np.float64]

_NO_CROSSTALK: Kernel = ((1.0,),)
_WAVELENGTH_SAMPLES = 1001
_UNCOVERED_LIMIT = 0.01
"""Fraction of a channel's response outside the lens's transmittance table above which a warning is issued."""


def low_pass_split_m(sensor: Sensor) -> tuple[float, float]:
    """Return the (vertical, horizontal) distance of the low-pass filter's spots in m; 0 without a filter.

    Examples
    --------
    >>> import photosite as ps
    >>> low_pass_split_m(ps.load_sensor("nikon-d200"))
    (0.0, 0.0)
    """
    stack = sensor.optical_stack
    if stack is None or stack.low_pass_filter is None:
        return 0.0, 0.0
    return stack.low_pass_filter.split_y_um.value * 1e-6, stack.low_pass_filter.split_x_um.value * 1e-6


def warn_of_transmittance_range(optics: Optics, sensor: Sensor) -> None:
    """Warn if a channel responds to light outside the wavelengths of the lens's transmittance table.

    A table that ends at 0 needs no warning: the lens passes nothing beyond it.
    """
    table = getattr(getattr(optics, "base", optics), "transmittance", None)
    grid = getattr(table, "wavelength_nm", None)
    if table is None or grid is None:
        return
    first, last = float(grid[0]), float(grid[-1])
    for name in sensor.channel_names:
        known = sensor.response(name)[0]
        fine = np.union1d(np.linspace(known[0], known[-1], _WAVELENGTH_SAMPLES), [*known, first, last])
        response = sensor.response_at(name, fine)
        area = np.diff(fine) * (response[1:] + response[:-1]) / 2
        middle = (fine[1:] + fine[:-1]) / 2
        open_ends = (middle < first) & (table.values[0] > 0) | (middle > last) & (table.values[-1] > 0)
        beyond = float(area[open_ends].sum() / area.sum()) if area.sum() > 0 else 0.0
        if beyond > _UNCOVERED_LIMIT:
            what = (
                f"{beyond:.1%} of channel {name}'s response lies outside the lens's transmittance table, {first:g} to "
                f"{last:g} nm, where the transmittance is taken as 0"
            )
            hint = "Extend the table to the wavelengths at which the lens is opaque"
            warnings.warn(PhotositeWarning(what, hint=hint), stacklevel=4)
            return


def apply_optical_stack(
    mosaic: NDArray[np.float32], sensor: Sensor, optics: Optics, distance_m: float
) -> NDArray[np.float32]:
    """Return mean electrons after angular response and crosstalk; the same array if the sensor has neither.

    Random fractions of a Poisson count are independent Poisson counts, so noise is drawn afterwards.

    - `mosaic`: (rows, cols) electrons, or electrons per second, without the optical stack. It may be changed.
    - `sensor`: The sensor with its optical stack.
    - `optics`, `distance_m`: Lens and scene distance, for the angle of light if the stack gives no exit pupil.

    Raises `InputError` if the angle of light exceeds the table of angular response.
    """
    stack = sensor.optical_stack
    if stack is None:
        return mosaic
    with threads_for(mosaic.size):
        if stack.angular_response is not None:
            apply_angular_response(mosaic, stack.angular_response, sensor, optics, distance_m)
        if stack.crosstalk is None:
            return mosaic
        return gathered(mosaic, crosstalk_fractions(stack.crosstalk, sensor.array.cfa))


def apply_angular_response(
    mosaic: NDArray[np.float32], table: AngularResponse, sensor: Sensor, optics: Optics, distance_m: float
) -> None:
    """Multiply a mosaic by the response at the angle of each pixel's light, in place."""
    # By default the exit pupil is at a thin lens's image distance, f (1 + |m|).
    given = table.exit_pupil_mm
    pupil_m = optics.magnification(distance_m) * distance_m if given is None else given.value * 1e-3
    pixel, names = sensor.pixel, sensor.channel_names
    y, x = (
        (np.arange(size) + 0.5 - size / 2) * (pitch.value * 1e-6 / pupil_m)
        for size, pitch in zip(mosaic.shape, (pixel.height_um, pixel.width_um), strict=True)
    )
    steepest_deg = float(np.degrees(np.arctan(np.hypot(y[-1], x[-1]))))
    if steepest_deg > table.angle_deg[-1]:
        raise InputError(
            "angle_deg",
            where="optical_stack.angular_response",
            value=table.angle_deg[-1],
            expected=f"at least {steepest_deg:.4g} degrees, the angle at the frame's corner for an exit pupil "
            f"{pupil_m * 1e3:.4g} mm away",
            hint="Extend the table, or give exit_pupil_mm if the lens is telecentric on the sensor side",
        )
    channel_of = np.array([[names.index(name) for name in row] for row in sensor.array.cfa])
    response = np.array([table.of(name) for name in names], np.float64)
    scale_by_angle(mosaic, y, x, channel_of, np.radians(table.angle_deg), response)


def crosstalk_fractions(crosstalk: Crosstalk, cfa: Cfa) -> NDArray[np.float64]:
    """Return optical and electrical crosstalk as one gathering kernel per site of the color filter array's tile.

    Returns (tile rows, tile cols, size, size): the fraction that a pixel at that site receives of the electrons of the
    pixel (i - size // 2) rows below it and (j - size // 2) columns to its right. The fractions that one pixel gives to
    all others sum to 1.

    Examples
    --------
    >>> right = ((0, 0, 0), (0, 0.9, 0.1), (0, 0, 0))
    >>> crosstalk_fractions(Crosstalk(optical={"M": right}), (("M",),))[0, 0, 1]  # from the left neighbor
    array([0.1, 0.9, 0. ])
    """
    return combined_fractions(_kernels_by_site(crosstalk.optical, cfa), _kernels_by_site(crosstalk.electrical, cfa))


def combined_fractions(light: NDArray[np.float64], charge: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the gathering kernels of `crosstalk_fractions`, linear in the kernels of light and in those of charge.

    Both are (tile rows, tile cols, size, size), the kernel of each site.
    """
    rows, cols = light.shape[:2]
    h, g = light.shape[2] // 2, charge.shape[2] // 2
    size = 2 * (h + g) + 1
    fractions = np.zeros((rows, cols, size, size))
    for r, c in np.ndindex(rows, cols):
        # Electrons diffuse to (r, c) from (r + y, c + x), where light from the filter (v, u) away generated them.
        for y, x in np.ndindex(2 * g + 1, 2 * g + 1):
            via_r, via_c = r + y - g, c + x - g
            diffused = charge[via_r % rows, via_c % cols, 2 * g - y, 2 * g - x]
            for v, u in np.ndindex(2 * h + 1, 2 * h + 1):
                source = light[(via_r + v - h) % rows, (via_c + u - h) % cols]
                fractions[r, c, y + v, x + u] += diffused * source[2 * h - v, 2 * h - u]
    return fractions


def channel_mixing(sensor: Sensor) -> NDArray[np.float64]:
    """Return (channels, channels): the fraction of each channel's electrons that each channel reads in a uniform field.

    Examples
    --------
    >>> import photosite as ps
    >>> channel_mixing(ps.load_sensor("nikon-d200")).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    names, cfa = sensor.channel_names, sensor.array.cfa
    stack = sensor.optical_stack
    if stack is None or stack.crosstalk is None:
        return np.eye(len(names))
    fractions = crosstalk_fractions(stack.crosstalk, cfa)
    rows, cols, size, _ = fractions.shape
    mixing = np.zeros((len(names), len(names)))
    for r, c, i, j in np.ndindex(fractions.shape):
        source = cfa[(r + i - size // 2) % rows][(c + j - size // 2) % cols]
        mixing[names.index(cfa[r][c]), names.index(source)] += fractions[r, c, i, j]
    sites = [sum(row.count(name) for row in cfa) for name in names]
    return np.asarray(mixing / np.array(sites)[:, None])


def _kernels_by_site(kernels: dict[str, Kernel] | None, cfa: Cfa) -> NDArray[np.float64]:
    """Return (tile rows, tile cols, size, size): the kernel of each site, padded to the largest size."""
    names = channel_names(cfa)
    return kernels_of_channels(kernels, names)[[[names.index(name) for name in row] for row in cfa]]


def kernels_of_channels(kernels: dict[str, Kernel] | None, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return (channels, size, size): the kernel of each channel, padded to the largest size; 1 x 1 for no crosstalk."""
    found = [np.array(kernels[name] if kernels else _NO_CROSSTALK) for name in names]
    size = max(len(kernel) for kernel in found)
    return np.array([np.pad(kernel, (size - len(kernel)) // 2) for kernel in found], np.float64)


_BLOCK = 256
"""Columns that are summed at a time; their sums and weights fit the first-level cache."""


def gathered(mosaic: F32, fractions: F64) -> F32:
    """Return each pixel's sum of fractions of the pixels around it.

    Beyond its border the mosaic repeats the nearest pixels of the same site in the color filter array's tile.

    - `mosaic`: (rows, cols), one whole tile or more.
    - `fractions`: (tile rows, tile cols, size, size), size odd: the fraction that a pixel at that site receives of the
      pixel (i - size // 2) rows below it and (j - size // 2) columns to its right.
    """
    period_c, size = fractions.shape[1:3]
    taps = np.argwhere((fractions != 0).any(axis=(0, 1)))
    block = -(-_BLOCK // period_c) * period_c
    # weights[r, t, c]: fraction of tap t at site (r, c mod period), along a block of columns.
    by_site = fractions[:, :, taps[:, 0], taps[:, 1]].transpose(0, 2, 1).astype(np.float32)
    weights = np.ascontiguousarray(np.tile(by_site, block // period_c))
    offsets = np.ascontiguousarray(taps - size // 2)
    out = np.empty_like(mosaic)
    parallel_for(_gather, len(out), mosaic, weights, offsets, period_c, size // 2, out)
    return out


@compiled()
def _gather(
    start: int, stop: int, mosaic: F32, weights: F32, offsets: I64, period_c: int, reach: int, out: F32
) -> None:
    rows, cols = mosaic.shape
    period_r, taps, block = weights.shape
    for r in range(start, stop):
        weight = weights[r % period_r]
        for begin in range(0, cols, block):
            end = min(begin + block, cols)
            total = out[r, begin:end]
            total[:] = np.float32(0)
            # first to last: columns whose neighbors are all inside the frame.
            first, last = min(max(begin, reach), end), max(min(end, cols - reach), begin)
            last = max(first, last)
            for t in range(taps):
                source = mosaic[_inside(r + offsets[t, 0], rows, period_r)]
                shift = offsets[t, 1]
                for c in range(begin, first):
                    total[c - begin] += weight[t, c - begin] * source[_inside(c + shift, cols, period_c)]
                _add(total[first - begin : last - begin], weight[t, first - begin :], source[first + shift :])
                for c in range(last, end):
                    total[c - begin] += weight[t, c - begin] * source[_inside(c + shift, cols, period_c)]


@compiled()
def _add(total: F32, weight: F32, source: F32) -> None:
    for c in range(total.size):
        total[c] += weight[c] * source[c]


@compiled()
def _inside(index: int, size: int, period: int) -> int:
    """Return the nearest index inside the frame at the same site of the tile."""
    if index < 0:
        return index % period
    if index >= size:
        return size - period + (index - size) % period
    return index


class CrosstalkGather:
    """Each pixel's sum of fractions of the pixels around it, as `gathered`, in double precision and with its adjoint.

    - `shape`: (rows, cols) of the mosaic.
    - `fractions`: (tile rows, tile cols, size, size), see `crosstalk_fractions`.
    """

    def __init__(self, shape: tuple[int, ...], fractions: Array) -> None:
        self._shape, self._fractions, self._size = shape, fractions, fractions.shape[2]
        # Beyond its border the mosaic repeats the nearest pixels of the same site of the tile.
        self._rows, self._cols = (
            _with_border(count, self._size // 2, period)
            for count, period in zip(shape, fractions.shape[:2], strict=True)
        )

    def with_fractions(self, fractions: Array) -> CrosstalkGather:
        """Return the sum with other fractions of the same size."""
        return CrosstalkGather(self._shape, fractions)

    def apply(self, mosaic: Array) -> Array:
        """Return the sums."""
        wide, out = mosaic[self._rows[:, None], self._cols], np.zeros(self._shape)
        for site, i, j in self._taps():
            out[self._pixels(site)] += self._fractions[(*site, i, j)] * wide[i:, j:][self._pixels(site)]
        return out

    def adjoint(self, cotangent: Array) -> Array:
        """Return the adjoint of `apply`."""
        wide = np.zeros((self._rows.size, self._cols.size))
        for site, i, j in self._taps():
            wide[i:, j:][self._pixels(site)] += self._fractions[(*site, i, j)] * cotangent[self._pixels(site)]
        out = np.zeros(self._shape)
        np.add.at(out, (self._rows[:, None], self._cols), wide)
        return out

    def by_fractions(self, cotangent: Array, mosaic: Array) -> Array:
        """Return the gradient by the fractions of the sum of cotangent times `apply(mosaic)`."""
        wide, found = mosaic[self._rows[:, None], self._cols], np.zeros_like(self._fractions)
        for site in np.ndindex(self._fractions.shape[:2]):
            for i, j in np.ndindex(self._size, self._size):
                found[(*site, i, j)] = float((cotangent[self._pixels(site)] * wide[i:, j:][self._pixels(site)]).sum())
        return found

    def _taps(self) -> Iterable[tuple[tuple[int, ...], int, int]]:
        """Yield the site and the place in its kernel of each fraction that is not 0."""
        return (((r, c), i, j) for r, c, i, j in np.argwhere(self._fractions != 0).tolist())

    def _pixels(self, site: tuple[int, ...]) -> tuple[slice, slice]:
        """Return a site's pixels in the frame, or in a wider array shifted by a tap."""
        down, across = self._fractions.shape[:2]
        return slice(site[0], self._shape[0], down), slice(site[1], self._shape[1], across)


def _with_border(count: int, reach: int, period: int) -> NDArray[np.intp]:
    """Return the index of each line of a mosaic with a border, as `_inside`."""
    index = np.arange(-reach, count + reach)
    beyond = count - period + (index - count) % period
    return np.where(index < 0, index % period, np.where(index >= count, beyond, index))


def scale_by_angle(mosaic: F32, y: F64, x: F64, channel_of: I64, angle: F64, response: F64) -> None:
    """Multiply each pixel by its channel's response at the angle of its position, in place.

    - `mosaic`: (rows, cols).
    - `y`, `x`: (rows,), (cols,) positions; the angle is atan(hypot(y, x)).
    - `channel_of`: (tile rows, tile cols) channel of each site.
    - `angle`, `response`: (n,) radians, increasing from 0 to at least the largest angle; (channels, n), linear between.
    """
    parallel_for(_scale_by_angle, len(mosaic), mosaic, y, x, channel_of, angle, response)


@compiled()
def _scale_by_angle(
    start: int, stop: int, mosaic: F32, y: F64, x: F64, channel_of: I64, angle: F64, response: F64
) -> None:
    cols = mosaic.shape[1]
    period_r, period_c = channel_of.shape
    last = angle.size - 2
    for r in range(start, stop):
        k = 0
        for c in range(cols):
            theta = np.arctan(np.sqrt(y[r] * y[r] + x[c] * x[c]))
            # Neighbors have nearly the same angle: start from the previous interval.
            while k < last and theta > angle[k + 1]:
                k += 1
            while k > 0 and theta < angle[k]:
                k -= 1
            fraction = (theta - angle[k]) / (angle[k + 1] - angle[k])
            of = response[channel_of[r % period_r, c % period_c]]
            mosaic[r, c] *= np.float32(of[k] + fraction * (of[k + 1] - of[k]))
