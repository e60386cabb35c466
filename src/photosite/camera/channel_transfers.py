"""What a lens and a sensor do to a scene's weight maps, summed over wavelength: the engine's transfers.

A chart has 24 spectra and a cube may have more, but three channels behind a lens cannot tell them all apart, and the
parts of a lens that differs from place to place resemble each other: maps and parts are combined to the few terms that
matter, by singular values.

Where the images of different wavelengths lie apart a few of these stand for all (`warps.color_nodes`), and each would
have all terms of its own. There maps become few pictures for each of these wavelengths, and sums of the pictures of all
of them terms: what a lens does to one wavelength it nearly does to the next. Each channel by itself sees nearly one
spectrum, so it has fewer pictures and terms; all together share them. What is clearly less work is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from photosite.camera.sampled_otf import LensTables, lens_tables
from photosite.engine.transfer import Sampling, Transfer
from photosite.optics.point_spread import FieldPsf, PointSpread

Array = NDArray[np.float64]

MAP_TOLERANCE = 5e-6
"""Of the largest transfer: what combining maps may change at any frequency, for any of the scene's spectra."""
_OF_FIELD_ERROR = 0.01
"""The same, of what a lens's few modes leave out by themselves, where that is more."""
_OF_SHARED_COLORS = 2e-4
"""The same where some wavelengths' images stand for all, which errs by more (`mapping.wavelength_nodes`)."""
_STRIDE = 7
"""Every how manieth frequency is looked at first; odd, for real and imaginary parts lie in turn."""
_LAYING = 0.2
"""A map times its weight over the field, against the transforms of a term: what they take."""
_VIEW, _PICTURE, _MIXING, _CHANNEL = 4.0, 0.7, 0.08, 0.4
"""The same of a wavelength's way through the lens, a picture on it, a picture that is added to a term, and a channel
that a term reaches (two cores, 10 megapixels)."""
_SPARING = 1.3
"""As much more work is worth the memory of fewer pictures."""
_MOST_KEPT = 4
_KEPT_BYTES = 1 << 28
"""Of the transfers that are kept with a spread."""


@dataclass(frozen=True, eq=False)
class Reduced:
    """Terms, and how maps become them.

    Parameters
    ----------
    transfer
        From each term to each channel, or to one.
    mixing
        (terms, R, S): term t is the sum over r of `mixing[t, r] @ pictures`, in the r-th part of the field.
    padding_m
        What a point may be spread over to either side, as far as it is kept.
    pictures
        For each wavelength that stands for others (S_n, K): the pictures that its light makes are these times the
        scene's weights, the S of all wavelengths one after another. None: the weights themselves, S is K.
    channel
        The only channel that the terms reach; None: all.
    """

    transfer: Transfer
    mixing: Array
    padding_m: float
    pictures: tuple[Array, ...] | None = None
    channel: int | None = None

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        radial, kernels = self.transfer.radial, self.transfer.kernels
        held = (self.mixing, None if radial is None else radial.table, kernels, *(self.pictures or ()))
        return sum(part.nbytes for part in held if part is not None)


_kept: WeakKeyDictionary[PointSpread, dict[tuple[Any, ...], tuple[Reduced, ...]]] = WeakKeyDictionary()
"""What was asked for last, for as long as the spread lives: a series of frames asks for the same again and again."""
_keeping = Lock()


def reduced_transfers(
    spread: PointSpread, coupling: Array, wavelength_nm: Array, sampling: Sampling, shares: Array | None = None
) -> tuple[Reduced, ...]:
    """The lens summed over wavelength, for as few terms as `MAP_TOLERANCE` asks.

    Parameters
    ----------
    spread
        The lens's. Of a `FieldPsf` the modes, each for the weights' largest magnitude (`field_scale`).
    coupling
        (channels, K, wavelengths) what a map of weight 1 gives to a channel at a wavelength.
    wavelength_nm
        (wavelengths,).
    sampling
        Pixels and cells.
    shares
        (N, wavelengths) of each wavelength's light those that the N wavelengths have which stand for all. None: N is 1.

    Returns
    -------
    tuple of Reduced
        One for all channels, or, if N is more and that is less work, one for each that gets light. Nobody may change
        them: they are kept with the spread.

    Raises
    ------
    InputError
        If a point would be spread over more cells than a mosaic can be made of.
    """
    tolerance = MAP_TOLERANCE
    if shares is None:
        shares = np.ones((1, wavelength_nm.size))
    if len(shares) > 1:
        tolerance = max(tolerance, _OF_SHARED_COLORS)
    if isinstance(spread, FieldPsf):
        tolerance = max(tolerance, _OF_FIELD_ERROR * spread.relative_error)
    with _keeping:
        kept = _kept.setdefault(spread, {})
    told = coupling, wavelength_nm, shares
    key = (*((one.shape, one.tobytes()) for one in told), astuple(sampling), tolerance)
    if (found := kept.get(key)) is None:
        lens = lens_tables(spread, wavelength_nm, sampling)
        found = tuple(_reduced(lens, coupling, shares, tolerance))
    with _keeping:
        kept.pop(key, None)
        kept[key] = found  # the last asked for stands last
        while len(kept) > _MOST_KEPT or sum(one.nbytes for some in kept.values() for one in some) > _KEPT_BYTES:
            del kept[next(iter(kept))]
    return found


def _largest(lens: LensTables, coupling: Array) -> float:
    """Of all transfers."""
    return max(float(np.abs(block).max()) for block in lens.blocks(coupling)(_STRIDE))


def _reduced(lens: LensTables, coupling: Array, shares: Array, tolerance: float) -> Sequence[Reduced]:
    limit = tolerance * _largest(lens, coupling @ lens.hats)
    if len(shares) == 1:
        return [Reduced(*_combined(lens, coupling @ lens.hats, limit), lens.padding_m)]
    apart = [
        found
        for channel in range(len(coupling))
        for found in _of_pictures(lens, coupling[channel : channel + 1], shares, limit, channel)
    ]
    together = _of_pictures(lens, coupling, shares, limit, None)
    return apart if _work(apart) <= _SPARING * _work(together) else together


def _of_pictures(
    lens: LensTables, coupling: Array, shares: Array, limit: float, channel: int | None
) -> Sequence[Reduced]:
    """The terms of some channels, of pictures in all the wavelengths that stand for others; none without light.

    Half of what may be lost is lost as maps become few pictures, half as these become terms; what different pictures
    lack adds up as squares do.
    """
    pictures, seen = [], []
    for share in shares:
        own = (coupling * share) @ lens.hats
        few = _pictures(lens, own, limit / (2 * math.sqrt(len(shares))))
        pictures.append(few)
        seen.append(np.einsum("sk,ckn->csn", few, own))
    if not (count := sum(map(len, pictures))):
        return []
    terms = _combined(lens, np.concatenate(seen, axis=1), limit / (2 * math.sqrt(count)))
    return [Reduced(*terms, lens.padding_m, tuple(pictures), channel)]


def _pictures(lens: LensTables, coupling: Array, limit: float) -> Array:
    """(S, K): as few combinations of maps as stand for all of them in (channels, K, nodes); none of too little."""
    limit /= lens.parts
    blocks = lens.blocks(coupling)
    if max(float(np.abs(block).max()) for block in blocks(1)) <= limit:
        return np.empty((0, coupling.shape[1]))

    def flat(every: int) -> Iterator[Array]:
        """(channels * modes, K, frequencies)."""
        return (block.reshape(-1, *block.shape[2:]) for block in blocks(every))

    return _mixing(flat, limit)


def _combined(lens: LensTables, coupling: Array, limit: float) -> tuple[Transfer, Array]:
    """Transfers of the fewest terms, and (terms, R, K): how maps become them.

    Parameters
    ----------
    lens
        The lens.
    coupling
        (channels, K, nodes).
    limit
        What may be lost of any map in any channel at any frequency.
    """
    limit /= lens.parts

    def flat(modes: slice) -> Callable[[int], Iterator[Array]]:
        """(channels, R * K, frequencies): what a map in a part of the field gives."""
        blocks = lens.blocks(coupling, modes)
        return lambda every: (block.reshape(len(coupling), -1, block.shape[3]) for block in blocks(every))

    mixing = _one_by_one([_mixing(flat(slice(r, r + 1)), limit) for r in range(lens.modes)])
    if lens.modes > 1 and len(mixing) > len(coupling) * lens.modes:
        together = _mixing(flat(slice(None)), limit).reshape(-1, lens.modes, coupling.shape[1])
        if _cost(together) < _cost(mixing):
            mixing = together
    return lens.transfer(coupling, mixing), mixing


def _one_by_one(mixings: Sequence[Array]) -> Array:
    """(terms, R, K): the terms of each mode, which are 0 in the others: few maps have to be laid for a term."""
    mixing = np.zeros((sum(map(len, mixings)), len(mixings), mixings[0].shape[1]))
    first = 0
    for r, of_mode in enumerate(mixings):
        mixing[first : first + len(of_mode), r] = of_mode
        first += len(of_mode)
    return mixing


def _work(parts: Sequence[Reduced]) -> float:
    """Of pictures and the terms that are made of them, in transforms of the frame."""
    total = 0.0
    for part in parts:
        assert part.pictures is not None
        views, pictures = sum(len(few) > 0 for few in part.pictures), sum(map(len, part.pictures))
        channels = part.transfer.channels
        total += _VIEW * views + _PICTURE * pictures + _cost(part.mixing)
        total += len(part.mixing) * (_CHANNEL * channels + _MIXING * pictures)
    return total


def _cost(mixing: Array) -> float:
    """Of terms, in transforms of the frame."""
    return len(mixing) + _LAYING * int(mixing.any(axis=2).sum())


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
