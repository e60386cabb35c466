"""What a lens and a sensor do to a scene's weight maps, summed over wavelength: the engine's transfers.

A chart has 24 spectra and a cube may have more, but three channels behind a lens cannot tell them all apart, and the
parts of a lens that differs from place to place resemble each other: maps and parts are combined to the few terms that
matter, by singular values.

Point spreads of any shape become kernels on the frame's cells. What makes a kernel large is diffraction's rings: their
light falls as slowly as 1 / radius^3, because the transfer function of any pupil with a sharp border begins as a cone
(`_cone`). So from each spread as much of a circular pupil's transfer function is taken as has that cone, and goes
through the engine as a function of |f|, without end; only the rest, which is smooth at 0, is a kernel. Where there is
no cone, nothing is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from photosite.engine.transfer import RadialTransfer, Sampling, Transfer
from photosite.optics.spread import FieldSpread, PlaneSpread, RadialSpread, Spread
from photosite.reach import check_reach, kernel_size

Array = NDArray[np.float64]

MAP_TOLERANCE = 5e-6
"""Of the largest transfer: what combining maps may change at any frequency, for any of the scene's spectra."""
_OF_FIELD_ERROR = 0.01
"""The same, of what a lens's few modes leave out by themselves, where that is more."""
_NODES = 4097
_BETWEEN = 1e-5
"""Of the largest transfer: what straight lines between a table's nodes may err by."""
_FINEST = 32
_BLOCK = 8192
"""Frequencies whose transfers are held at a time."""
_STRIDE = 7
"""Every how manieth frequency is looked at first; odd, for real and imaginary parts lie in turn."""
_DIRECTIONS = 16
_CONE_SAMPLES = 12
_CONE_RADIUS = 0.05
"""Of the cutoff: where the transfer function's start is looked at, less where it falls by more than `_CONE_FALL`."""
_CONE_FALL = 0.1
_LEAST_CONE = 1e-3
"""A cone below this holds a millionth of the light beyond the kernel: it is left there."""
_LAYING = 0.2
"""A map times its weight over the field, against the transforms of a term: what they take."""
_MOST_KEPT = 4
_KEPT_BYTES = 1 << 28
"""Of the transfers that are kept with a spread."""


@dataclass(frozen=True, eq=False)
class Reduced:
    """Terms, and how maps become them.

    Parameters
    ----------
    transfer
        From each term to each channel.
    mixing
        (terms, R, K): term t is the sum over r of `mixing[t, r] @ weights`, in the r-th part of the field.
    padding_m
        What a point may be spread over to either side, as far as it is kept.
    """

    transfer: Transfer
    mixing: Array
    padding_m: float

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        radial, kernels = self.transfer.radial, self.transfer.kernels
        held = (self.mixing, None if radial is None else radial.table, kernels)
        return sum(part.nbytes for part in held if part is not None)


_kept: WeakKeyDictionary[Spread, dict[tuple[Any, ...], tuple[Reduced, ...]]] = WeakKeyDictionary()
"""What was asked for last, for as long as the spread lives: a series of frames asks for the same again and again."""
_keeping = Lock()


def reduced_transfers(
    spread: Spread, couplings: Sequence[Array], wavelength_nm: Array, sampling: Sampling
) -> tuple[Reduced, ...]:
    """The lens summed over wavelength, for as few terms as `MAP_TOLERANCE` asks.

    Parameters
    ----------
    spread
        The lens's. Of a `FieldSpread` the modes, each for the weights' largest magnitude (`field_scale`).
    couplings
        Each (channels, K, wavelengths) what a map of weight 1 gives to a channel at a wavelength. More than one where
        wavelengths' images lie apart: the lens is looked at once for all of them.
    wavelength_nm
        (wavelengths,).
    sampling
        Pixels and cells.

    Returns
    -------
    tuple of Reduced
        One for each coupling. Nobody may change them: they are kept with the spread.

    Raises
    ------
    InputError
        If a point would be spread over more cells than a mosaic can be made of.
    """
    with _keeping:
        kept = _kept.setdefault(spread, {})
    tolerance = MAP_TOLERANCE
    if isinstance(spread, FieldSpread):
        tolerance = max(tolerance, _OF_FIELD_ERROR * spread.relative_error)
    shapes = tuple((c.shape, c.tobytes()) for c in couplings)
    key = (*shapes, wavelength_nm.tobytes(), astuple(sampling), tolerance)
    found = kept.get(key) or _reduced(spread, couplings, wavelength_nm, sampling, tolerance)
    with _keeping:
        kept.pop(key, None)
        kept[key] = found  # the last asked for stands last
        while len(kept) > _MOST_KEPT or sum(one.nbytes for some in kept.values() for one in some) > _KEPT_BYTES:
            del kept[next(iter(kept))]
    return found


def _reduced(
    spread: Spread, couplings: Sequence[Array], wavelength_nm: Array, sampling: Sampling, tolerance: float
) -> tuple[Reduced, ...]:
    if isinstance(spread, RadialSpread):
        return _of_radial(spread, couplings, wavelength_nm, sampling, tolerance)
    if isinstance(spread, PlaneSpread):
        return _of_modes((spread,), np.ones(1), couplings, wavelength_nm, sampling, tolerance)
    return _of_modes(spread.modes, field_scale(spread), couplings, wavelength_nm, sampling, tolerance)


def field_scale(spread: FieldSpread) -> Array:
    """(R,) the largest magnitude of each mode's weights; 1 where they are all 0."""
    largest: Array = np.abs(spread.weights).max(axis=(1, 2))
    largest[largest == 0] = 1.0
    return largest


def _of_radial(
    spread: RadialSpread, couplings: Sequence[Array], wavelength_nm: Array, sampling: Sampling, tolerance: float
) -> tuple[Reduced, ...]:
    middle = float(wavelength_nm[wavelength_nm.size // 2])
    check_reach(spread.reach_m(middle), sampling)
    frequencies = np.linspace(0.0, max(spread.cutoff_per_m(w) for w in wavelength_nm), _NODES)
    otfs = np.stack([spread.otf(frequencies, w) for w in wavelength_nm])
    padding_m = spread.reach_m(middle) + max(sampling.split_m) / 2

    def reduced(coupling: Array) -> Reduced:
        table = coupling @ otfs  # (channels, K, nodes)
        limit = tolerance * float(np.abs(table).max())
        mixing = _mixing(lambda every: iter([table[:, :, ::every]]), limit)
        return Reduced(Transfer(_refined(mixing @ table, float(frequencies[1]))), mixing[:, None], padding_m)

    return tuple(reduced(coupling) for coupling in couplings)


def _refined(table: Array, step_per_m: float) -> RadialTransfer:
    """More nodes, by cubic splines, for a lens so far out of focus that its transfer function swings between them."""
    from scipy.interpolate import CubicSpline

    largest = np.abs(table).max()
    bend = np.abs(np.diff(table, 2)).max() / 8
    if bend <= _BETWEEN * largest:
        return RadialTransfer(table, step_per_m)
    times = min(math.ceil(math.sqrt(bend / (_BETWEEN * largest))), _FINEST)
    nodes = np.arange(table.shape[2])
    fine = np.linspace(0.0, nodes[-1], (nodes.size - 1) * times + 1)
    return RadialTransfer(CubicSpline(nodes, table, axis=2)(fine), step_per_m / times)


def _of_modes(
    modes: tuple[PlaneSpread, ...],
    scale: Array,
    couplings: Sequence[Array],
    wavelength_nm: Array,
    sampling: Sampling,
    tolerance: float,
) -> tuple[Reduced, ...]:
    hats, grid = _nodes_of(modes[0], wavelength_nm)
    size = kernel_size(max(mode.reach_m(w) for mode in modes for w in grid), sampling)
    step_per_m = max(mode.cutoff_per_m(w) for mode in modes for w in grid) / (_NODES - 1)
    frequencies = step_per_m * np.arange(_NODES, dtype=np.float64)
    cones = np.zeros((len(modes), grid.size, _NODES))
    spectra = np.empty((len(modes), grid.size, size, size // 2 + 1), np.complex128)
    for n, w in enumerate(grid):
        for r, mode in enumerate(modes):
            cone = _cone(mode, w)
            if abs(cone) * scale[r] < _LEAST_CONE:
                cone = 0.0
            else:
                cones[r, n] = scale[r] * cone * circular_pupil(frequencies / mode.cutoff_per_m(w))
            spectra[r, n] = scale[r] * _folded_spectrum(mode, w, cone, sampling, size)
    padding_m = (size // 2 + 1) * max(sampling.cell_m(axis) for axis in (0, 1))

    def reduced(coupling: Array) -> Reduced:
        used = coupling.any(axis=(0, 1))
        transfer, mixing = _combined(cones[:, used], spectra[:, used], coupling[:, :, used], tolerance, step_per_m)
        return Reduced(transfer, mixing, padding_m)

    return tuple(reduced(coupling @ hats) for coupling in couplings)


def _combined(
    cones: Array, spectra: NDArray[np.complex128], coupling: Array, tolerance: float, step_per_m: float
) -> tuple[Transfer, Array]:
    """Transfers of the fewest terms, and (terms, R, K): how maps become them.

    Parameters
    ----------
    cones, spectra
        (R, wavelengths, nodes) and (R, wavelengths, Q, Q // 2 + 1): of each mode.
    coupling
        (channels, K, wavelengths).
    tolerance
        Of the largest transfer.
    step_per_m
        Between the cones' nodes.
    """
    count, size = len(spectra), spectra.shape[2]
    has_cones = bool(cones.any())
    parts = spectra.view(np.float64).reshape(count, spectra.shape[1], -1)
    tables = (cones, parts) if has_cones else (parts,)

    def blocks(modes: slice) -> Callable[[int], Iterator[Array]]:
        def of_modes(every: int) -> Iterator[Array]:
            """(channels, R * K, some frequencies): what a map in a part of the field gives, a piece at a time."""
            for table in tables:
                for first in range(0, table.shape[2], _BLOCK * every):
                    some = table[modes, :, first : first + _BLOCK * every : every]
                    piece = np.einsum("ckn,rnp->crkp", coupling, some, optimize=True)
                    yield piece.reshape(len(coupling), -1, piece.shape[3])

        return of_modes

    every_mode = blocks(slice(None))
    limit = tolerance / len(tables) * max(float(np.abs(block).max()) for block in every_mode(_STRIDE))
    mixing = _one_by_one([_mixing(blocks(slice(r, r + 1)), limit) for r in range(count)])
    if count > 1 and len(mixing) > len(coupling) * count:
        together = _mixing(every_mode, limit).reshape(-1, count, coupling.shape[1])
        if _cost(together) < _cost(mixing):
            mixing = together
    to_terms = np.einsum("trk,ckn->ctrn", mixing, coupling, optimize=True)
    radial = np.tensordot(to_terms, cones, axes=((2, 3), (0, 1))) if has_cones else None
    kernels = scipy.fft.irfft2(np.tensordot(to_terms, spectra, axes=((2, 3), (0, 1))), s=(size, size), workers=-1)
    transfer = Transfer(
        None if radial is None else RadialTransfer(radial, step_per_m),
        np.fft.fftshift(kernels, axes=(2, 3)),
    )
    return transfer, mixing


def _one_by_one(mixings: Sequence[Array]) -> Array:
    """(terms, R, K): the terms of each mode, which are 0 in the others: few maps have to be laid for a term."""
    mixing = np.zeros((sum(map(len, mixings)), len(mixings), mixings[0].shape[1]))
    first = 0
    for r, of_mode in enumerate(mixings):
        mixing[first : first + len(of_mode), r] = of_mode
        first += len(of_mode)
    return mixing


def _cost(mixing: Array) -> float:
    """Of terms, in transforms of the frame."""
    return len(mixing) + _LAYING * int(mixing.any(axis=2).sum())


def _nodes_of(mode: PlaneSpread, wavelength_nm: Array) -> tuple[Array, Array]:
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


def _cone(mode: PlaneSpread, wavelength_nm: float) -> float:
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
    mode: PlaneSpread, wavelength_nm: float, cone: float, sampling: Sampling, size: int
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


def _mixing(blocks: Callable[[int], Iterator[Array]], limit: float) -> Array:
    """(terms, maps): the fewest combinations of maps that are enough.

    Of what they leave out no entry may pass the limit: no scene spectrum, in any channel, at any frequency.

    Parameters
    ----------
    blocks
        Gives (channels, maps, n) transfers, piece after piece: of every n-th frequency.
    limit
        The same for all of a lens's parts.
    """
    squares: Any = 0.0
    for block in blocks(_STRIDE):
        tall = block.transpose(1, 0, 2).reshape(block.shape[1], -1)
        squares = squares + tall @ tall.T
    # Singular values matter down to 1e-6 of the first only: their squares, which a double holds, are quick to find.
    directions = np.linalg.eigh(squares)[1][:, ::-1].T

    def enough(terms: int, every: int) -> bool:
        mixing = directions[:terms]
        return all(np.abs(block - mixing.T @ (mixing @ block)).max() <= limit for block in blocks(every))

    low, high = 1, len(directions)
    while low < high:  # some of the frequencies say about how many it takes
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle, _STRIDE) else (middle + 1, high)
    while low < len(directions) and not enough(low, 1):
        low += 1
    return directions[:low] if low < len(directions) else np.eye(len(directions))
