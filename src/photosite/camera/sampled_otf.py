"""A lens as tables over spatial frequency: what of a spread is looked at once, for all maps and all channels.

Point spreads of any shape become kernels on the frame's cells. What makes a kernel large is diffraction's rings: their
light falls as slowly as 1 / radius^3, because the transfer function of any pupil with a sharp border begins as a cone
(`_cone`). So from each spread as much of a circular pupil's transfer function is taken as has that cone, and goes
through the engine as a function of |f|, without end; only the rest, which is smooth at 0, is a kernel. Where there is
no cone, nothing is taken.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.camera.kernel_size import check_reach, kernel_size
from photosite.engine.transfer import RadialTransfer, Sampling, Transfer
from photosite.optics.point_spread import FieldPsf, PlanePsf, PointSpread, RadialPsf

Array = NDArray[np.float64]
Blocks = Callable[[int], Iterator[Array]]
"""(every) -> (channels, modes, maps, n): what maps give to channels, piece after piece: of every n-th frequency."""

_NODES = 4097
_BETWEEN = 1e-5
"""Of the largest transfer: what straight lines between a table's nodes may err by."""
_FINEST = 32
_BLOCK = 8192
"""Frequencies whose transfers are held at a time."""
_DIRECTIONS = 16
_CONE_SAMPLES = 12
_CONE_RADIUS = 0.05
"""Of the cutoff: where the transfer function's start is looked at, less where it falls by more than `_CONE_FALL`."""
_CONE_FALL = 0.1
_LEAST_CONE = 1e-3
"""A cone below this holds a millionth of the light beyond the kernel: it is left there."""
_THREADS = 4
"""Wavelengths that are looked at side by side, at most: each needs some hundred megabytes behind a large pupil."""


@dataclass(frozen=True, eq=False)
class LensTables:
    """A spread at the wavelengths at which it is known.

    Parameters
    ----------
    hats
        (wavelengths, nodes): how light is shared between these.
    radial
        (R, nodes, frequencies) functions of |f|; None: nowhere needed.
    step_per_m
        Between these frequencies.
    spectra
        (R, nodes, Q, Q // 2 + 1) of kernels on the cells; None: the spread is a function of |f|.
    padding_m
        What a point may be spread over to either side, as far as it is kept.
    """

    hats: Array
    radial: Array | None
    step_per_m: float
    spectra: NDArray[np.complex128] | None
    padding_m: float

    @property
    def modes(self) -> int:
        """R: 1 of a spread that is the same everywhere."""
        return len(self._tables()[0])

    def _tables(self) -> tuple[Array, ...]:
        """(R, nodes, values) that add up to a transfer."""
        kernels = None
        if self.spectra is not None:
            kernels = self.spectra.view(np.float64).reshape(*self.spectra.shape[:2], -1)
        return tuple(table for table in (self.radial, kernels) if table is not None)

    @property
    def parts(self) -> int:
        """How many tables add up to a transfer."""
        return len(self._tables())

    def blocks(self, coupling: Array, modes: slice = slice(None)) -> Blocks:
        """What (channels, maps, nodes) make of the tables."""

        def of_tables(every: int) -> Iterator[Array]:
            for table in self._tables():
                for first in range(0, table.shape[2], _BLOCK * every):
                    some = table[modes, :, first : first + _BLOCK * every : every]
                    yield np.einsum("ckn,rnp->crkp", coupling, some, optimize=True)

        return of_tables

    def transfer(self, coupling: Array, mixing: Array) -> Transfer:
        """Of terms, (terms, R, maps), to channels, through (channels, maps, nodes)."""
        to_terms = np.einsum("trk,ckn->ctrn", mixing, coupling, optimize=True)
        radial = None
        if self.radial is not None:
            radial = RadialTransfer(np.tensordot(to_terms, self.radial, axes=((2, 3), (0, 1))), self.step_per_m)
        if self.spectra is None:
            assert radial is not None
            return Transfer(_refined(radial))
        size = self.spectra.shape[2]
        kernels = scipy.fft.irfft2(
            np.tensordot(to_terms, self.spectra, axes=((2, 3), (0, 1))), s=(size, size), workers=-1
        )
        return Transfer(radial, np.fft.fftshift(kernels, axes=(2, 3)))


def lens_tables(spread: PointSpread, wavelength_nm: Array, sampling: Sampling) -> LensTables:
    """The spread, looked at.

    Parameters
    ----------
    spread
        The lens's. Of a `FieldPsf` the modes, each for the weights' largest magnitude (`field_scale`).
    wavelength_nm
        (wavelengths,) of the light.
    sampling
        Pixels and cells.

    Raises
    ------
    InputError
        If a point would be spread over more cells than a mosaic can be made of.
    """
    if isinstance(spread, RadialPsf):
        return _of_radial(spread, wavelength_nm, sampling)
    if isinstance(spread, PlanePsf):
        return _of_modes((spread,), np.ones(1), wavelength_nm, sampling)
    return _of_modes(spread.modes, field_scale(spread), wavelength_nm, sampling)


def field_scale(spread: FieldPsf) -> Array:
    """(R,) the largest magnitude of each mode's weights; 1 where they are all 0."""
    largest: Array = np.abs(spread.weights).max(axis=(1, 2))
    largest[largest == 0] = 1.0
    return largest


def _of_radial(spread: RadialPsf, wavelength_nm: Array, sampling: Sampling) -> LensTables:
    middle = float(wavelength_nm[wavelength_nm.size // 2])
    check_reach(spread.reach_m(middle), sampling)
    frequencies = np.linspace(0.0, max(spread.cutoff_per_m(w) for w in wavelength_nm), _NODES)
    otfs = np.stack([spread.otf(frequencies, w) for w in wavelength_nm])
    padding_m = spread.reach_m(middle) + max(sampling.split_m) / 2
    return LensTables(np.eye(wavelength_nm.size), otfs[None], float(frequencies[1]), None, padding_m)


def _refined(radial: RadialTransfer) -> RadialTransfer:
    """More nodes, by cubic splines, for a lens so far out of focus that its transfer function swings between them."""
    from scipy.interpolate import CubicSpline

    table = radial.table
    largest = np.abs(table).max()
    bend = np.abs(np.diff(table, 2)).max() / 8
    if bend <= _BETWEEN * largest:
        return radial
    times = min(math.ceil(math.sqrt(bend / (_BETWEEN * largest))), _FINEST)
    nodes = np.arange(table.shape[2])
    fine = np.linspace(0.0, nodes[-1], (nodes.size - 1) * times + 1)
    return RadialTransfer(CubicSpline(nodes, table, axis=2)(fine), radial.step_per_m / times)


def _of_modes(modes: tuple[PlanePsf, ...], scale: Array, wavelength_nm: Array, sampling: Sampling) -> LensTables:
    hats, grid = _nodes_of(modes[0], wavelength_nm)
    size = kernel_size(max(mode.reach_m(w) for mode in modes for w in grid), sampling)
    step_per_m = max(mode.cutoff_per_m(w) for mode in modes for w in grid) / (_NODES - 1)
    frequencies = step_per_m * np.arange(_NODES, dtype=np.float64)
    cones = np.zeros((len(modes), grid.size, _NODES))
    spectra = np.empty((len(modes), grid.size, size, size // 2 + 1), np.complex128)

    def look(n: int) -> None:
        for r, mode in enumerate(modes):
            cone = _cone(mode, grid[n])
            if abs(cone) * scale[r] < _LEAST_CONE:
                cone = 0.0
            else:
                cones[r, n] = scale[r] * cone * circular_pupil(frequencies / mode.cutoff_per_m(grid[n]))
            spectra[r, n] = scale[r] * _folded_spectrum(mode, grid[n], cone, sampling, size)

    look(0)  # by itself: what is the same for all wavelengths is then made once
    with ThreadPoolExecutor(min(os.cpu_count() or 1, _THREADS)) as pool:
        list(pool.map(look, range(1, grid.size)))
    padding_m = (size // 2 + 1) * max(sampling.cell_m(axis) for axis in (0, 1))
    return LensTables(hats, cones if cones.any() else None, step_per_m, spectra, padding_m)


def _nodes_of(mode: PlanePsf, wavelength_nm: Array) -> tuple[Array, Array]:
    """How light is shared between the wavelengths at which the spread is known, and these.

    (wavelengths, nodes): linear between, constant beyond.
    """
    if mode.wavelength_nm is None:
        return np.eye(wavelength_nm.size), wavelength_nm
    grid = np.asarray(mode.wavelength_nm, np.float64)
    hats = np.stack([np.interp(wavelength_nm, grid, unit) for unit in np.eye(grid.size)], axis=1)
    used = hats.any(axis=0)
    return hats[:, used], grid[used]


def circular_pupil(r: Array) -> Array:
    """Transfer function of a circular pupil at r, frequency over cutoff (Goodman, Fourier Optics, eq. 6-32)."""
    r = np.minimum(r, 1.0)
    transfer: Array = (2 / math.pi) * (np.arccos(r) - r * np.sqrt(1 - r * r))
    return transfer


def _cone(mode: PlanePsf, wavelength_nm: float) -> float:
    """How much of a circular pupil's transfer function has this spread's cone at 0.

    The autocorrelation of a pupil with a sharp border begins with a loss in proportion to the border's length and |f|;
    aberrations add what is smooth. Where the fit of both errs, the kernel holds the difference.
    """
    cutoff = mode.cutoff_per_m(wavelength_nm)
    angle = (np.arange(_DIRECTIONS) + 0.5) * (math.pi / _DIRECTIONS)
    at_0 = complex(mode.otf(np.zeros(1), np.zeros(1), wavelength_nm)[0]).real
    radius = _CONE_RADIUS
    while True:
        r = radius * np.arange(1, _CONE_SAMPLES + 1) / _CONE_SAMPLES
        f = cutoff * r[:, None]
        mean = mode.otf(f * np.sin(angle), f * np.cos(angle), wavelength_nm).real.mean(axis=1)
        if np.abs(mean - at_0).max() <= _CONE_FALL * max(abs(at_0), np.abs(mean).max()) or radius < 1e-4:
            break
        radius /= 2
    u = r / radius
    shape = np.stack([(1 - circular_pupil(r)) / radius, u**2, u**3, u**4], axis=1)
    return float(np.linalg.lstsq(shape, (at_0 - mean) / radius, rcond=None)[0][0])


def _folded_spectrum(
    mode: PlanePsf, wavelength_nm: float, cone: float, sampling: Sampling, size: int
) -> NDArray[np.complex128]:
    """(Q, Q // 2 + 1): what the cone leaves of the transfer function, times photodetector and cell, folded at 1 / cell.

    Of the transfer function of a real point spread half is enough: columns whose folded place is in the first half.
    """
    cutoff = mode.cutoff_per_m(wavelength_nm)
    step = [np.float64(1.0 / (size * sampling.cell_m(axis))) for axis in (0, 1)]
    zones = [math.ceil(cutoff * sampling.cell_m(axis)) for axis in (0, 1)]
    row = np.arange(-zones[0] * size, (zones[0] + 1) * size)
    inside = np.abs(row) * step[0] <= cutoff
    fy: Array = (row[inside] * step[0])[:, None]
    aperture_y = sampling.aperture(0, fy)
    total = np.zeros((size, size // 2 + 1), np.complex128)
    for zone in range(-zones[1], zones[1] + 1):
        col = np.arange(size // 2 + 1) + zone * size
        near = np.abs(col) * step[1] <= cutoff
        if not near.any():
            continue
        fx: Array = (col[near] * step[1])[None, :]
        otf = np.zeros((row.size, near.size), np.complex128)
        values = mode.otf(fy, fx, wavelength_nm)
        if cone:
            values = values - cone * circular_pupil(np.hypot(fy, fx) / cutoff)
        otf[np.ix_(inside, near)] = values * (aperture_y * sampling.aperture(1, fx))
        total += otf.reshape(-1, size, near.size).sum(axis=0)
    return total
