"""Transfers from a scene's weight maps to the sensor's channels, reduced to few terms (docs/theory/model.md).

A chart has 24 spectra and a cube may have more, but three channels behind a lens cannot distinguish them all, and the
modes of a lens that varies over the field resemble each other. Maps and modes are therefore combined to the few *terms*
that matter, by singular value decomposition.

With lateral color, the images of a few wavelengths, the *wavelength nodes*, stand for those of all
(`mean_image.frame_wavelength_nodes`). For each node the maps are first reduced to few *node maps*; terms are then
combinations of the node maps of all nodes. A single channel responds to few wavelengths, so it needs fewer node maps
and terms; all channels together share them. The alternative with less work is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from photosite.camera.sampled_otf import MapTransfers, Progress, SampledOtf, sample_otf
from photosite.engine.transfer import (
    RadialTransfer,
    Sampling,
    Transfer,
    fold_coefficients,
    keep_fold_coefficients,
)
from photosite.files.cache import Arrays, cached_arrays
from photosite.optics.point_spread import FieldPsf, PointSpread
from photosite.values.block_diagonal import block_diagonal

Array = NDArray[np.float64]

TOLERANCE = 5e-6
"""Largest error of the reduction at any frequency, for any of the scene's spectra, relative to the largest transfer."""
_TOLERANCE_PER_FIELD_ERROR = 0.01
"""The same, relative to the error of the lens's own sum of modes, if that is more."""
_TOLERANCE_WITH_NODES = 2e-4
"""The same with wavelength nodes, whose interpolation errs by more (`photosite.optics.distortion.wavelength_nodes`)."""
_STRIDE = 7
"""Frequency stride of the first pass; odd, because real and imaginary parts alternate."""
_MAP_COST = 0.2
"""Cost of resampling one map and multiplying it by its field weight, in transforms of the frame, as all costs here."""
_NODE_COST, _NODE_MAP_COST, _MIXING_COST, _CHANNEL_COST = 4.0, 0.7, 0.08, 0.4
"""Costs of a wavelength node's warp, a node map, adding a node map to a term, and a channel that a term reaches;
measured on two cores with 10 megapixels. They decide between two results of the same tolerance."""
_SEPARATE_PREFERENCE = 1.3
"""Factor of additional work that the smaller memory of separate channels is worth."""
_CACHE_ENTRIES = 4
_CACHE_BYTES = 1 << 28
"""Limits of the transfers cached per spread."""


@dataclass(frozen=True, eq=False)
class ReducedTransfer:
    """Terms as combinations of maps, and their transfers to the channels."""

    transfer: Transfer  # from each term to each channel, or to one channel
    # (terms, R, S): term t is the sum over modes r of `mixing[t, r] @ maps`, times the field weight of mode r
    mixing: Array
    padding_m: float  # distance to either side over which a point is spread
    # For each wavelength node (S_n, K): its node maps are these times the scene's K weight maps; the S of all nodes
    # follow one another. None: terms combine the weight maps themselves, and S is K.
    node_maps: tuple[Array, ...] | None = None
    channel: int | None = None  # the only channel that the terms reach; None: all

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        radial, kernels = self.transfer.radial, self.transfer.kernels
        arrays = (self.mixing, None if radial is None else radial.table, kernels, *(self.node_maps or ()))
        return sum(array.nbytes for array in arrays if array is not None)


_cache: WeakKeyDictionary[PointSpread, dict[tuple[Any, ...], tuple[ReducedTransfer, ...]]] = WeakKeyDictionary()
"""The latest results of each spread, for as long as the spread lives: a series of frames repeats the same call."""
_cache_lock = Lock()


def reduced_transfers(
    spread: PointSpread,
    coupling: Array,
    wavelength_nm: Array,
    sampling: Sampling,
    node_fractions: Array | None = None,
    progress: Progress | None = None,
) -> tuple[ReducedTransfer, ...]:
    """Return the transfers of a lens, summed over wavelength, with as few terms as the tolerance permits.

    - `spread`: Point spread of the lens. The modes of a `FieldPsf` are multiplied by `field_scale`.
    - `coupling`, `wavelength_nm`: (channels, K, wavelengths) electrons per second that a map of weight 1 gives a
      channel; (wavelengths,).
    - `node_fractions`: (N, wavelengths) fraction of each wavelength's light at each of N nodes; None: one node.
    - `progress`: Receives the number of sampled wavelengths.

    Returns one result for all channels; or, if N > 1 or the lens varies over the field, and that is less work, one for
    each channel that receives light.
    Results are cached, in memory and on disk (`photosite.files.cache`), and must not be changed.

    Raises `InputError` if a point is spread over more cells than a mosaic can be computed with.
    """
    tolerance = TOLERANCE
    if node_fractions is None:
        node_fractions = np.ones((1, wavelength_nm.size))
    if len(node_fractions) > 1:
        tolerance = max(tolerance, _TOLERANCE_WITH_NODES)
    if isinstance(spread, FieldPsf):
        tolerance = max(tolerance, _TOLERANCE_PER_FIELD_ERROR * spread.relative_error)
    with _cache_lock:
        cached = _cache.setdefault(spread, {})
    arrays = coupling, wavelength_nm, node_fractions
    key = (*((array.shape, array.tobytes()) for array in arrays), astuple(sampling), tolerance)
    if (found := cached.get(key)) is None:

        def compute() -> Arrays:
            otf = sample_otf(spread, wavelength_nm, sampling, progress)
            return _to_arrays(_reduce(otf, coupling, node_fractions, tolerance), sampling)

        inputs = (spread, *arrays, sampling, tolerance)
        found = _from_arrays(cached_arrays("transfers", inputs, compute), sampling)
    with _cache_lock:
        cached.pop(key, None)
        cached[key] = found  # the most recently used entry is last
        while len(cached) > _CACHE_ENTRIES or _bytes_of(cached.values()) > _CACHE_BYTES:
            del cached[next(iter(cached))]
    return found


def _to_arrays(parts: Sequence[ReducedTransfer], sampling: Sampling) -> Arrays:
    arrays: dict[str, Any] = {}
    for n, part in enumerate(parts):
        radial = part.transfer.radial
        of_part = {
            "mixing": part.mixing,
            "padding_m": part.padding_m,
            "table": None if radial is None else radial.table,
            "step_per_m": None if radial is None else radial.step_per_m,
            "folds": None if radial is None else fold_coefficients(radial, sampling),
            "kernels": part.transfer.kernels,
            "channel": part.channel,
        }
        of_part |= {f"node_maps_{node}": maps for node, maps in enumerate(part.node_maps or ())}
        arrays |= {f"{n}.{name}": np.asarray(value) for name, value in of_part.items() if value is not None}
    return arrays


def _from_arrays(arrays: Arrays, sampling: Sampling) -> tuple[ReducedTransfer, ...]:
    """Return the parts of `_to_arrays`."""
    parts: list[ReducedTransfer] = []
    while f"{len(parts)}.mixing" in arrays:
        begin = f"{len(parts)}."
        of_part: Any = {name.removeprefix(begin): v for name, v in arrays.items() if name.startswith(begin)}
        radial, nodes = None, [name for name in of_part if name.startswith("node_maps_")]
        if "table" in of_part:
            radial = RadialTransfer(of_part["table"], float(of_part["step_per_m"]))
            keep_fold_coefficients(radial, sampling, of_part["folds"])
        parts.append(
            ReducedTransfer(
                Transfer(radial, of_part.get("kernels")),
                of_part["mixing"],
                float(of_part["padding_m"]),
                tuple(of_part[f"node_maps_{node}"] for node in range(len(nodes))) if nodes else None,
                int(of_part["channel"]) if "channel" in of_part else None,
            )
        )
    return tuple(parts)


def _bytes_of(results: Iterable[Sequence[ReducedTransfer]]) -> int:
    return sum(part.nbytes for parts in results for part in parts)


def _reduce(otf: SampledOtf, coupling: Array, node_fractions: Array, tolerance: float) -> Sequence[ReducedTransfer]:
    at_nodes = coupling @ otf.node_fractions
    limit = tolerance * max(of_mode.largest(_STRIDE) for of_mode in MapTransfers.by_map(otf, at_nodes))
    if len(node_fractions) == 1:
        together = [ReducedTransfer(*_terms(otf, at_nodes, limit), otf.padding_m)]
        if otf.modes == 1:
            return together
        separate = [
            ReducedTransfer(*_terms(otf, at_nodes[channel : channel + 1], limit), otf.padding_m, channel=channel)
            for channel in np.flatnonzero(at_nodes.any(axis=(1, 2))).tolist()
        ]
        return separate if 0 < _work(separate) < _work(together) else together
    separate = [
        found
        for channel in range(len(coupling))
        for found in _reduce_with_nodes(otf, coupling[channel : channel + 1], node_fractions, limit, channel)
    ]
    shared = _reduce_with_nodes(otf, coupling, node_fractions, limit, None)
    return separate if _work(separate) <= _SEPARATE_PREFERENCE * _work(shared) else shared


def _reduce_with_nodes(
    otf: SampledOtf, coupling: Array, node_fractions: Array, limit: float, channel: int | None
) -> Sequence[ReducedTransfer]:
    """Return the terms of some channels as combinations of node maps; none if the channels receive no light.

    Half of the permitted error is for reducing maps to node maps, half for reducing these to terms. The errors of
    different node maps add up as squares.
    """
    node_maps, couplings = [], []
    for fraction in node_fractions:
        of_node = (coupling * fraction) @ otf.node_fractions
        combinations = _node_maps(otf, of_node, limit / (2 * math.sqrt(len(node_fractions))))
        node_maps.append(combinations)
        couplings.append(np.einsum("sk,ckn->csn", combinations, of_node))
    if not (count := sum(map(len, node_maps))):
        return []
    terms = _terms(otf, np.concatenate(couplings, axis=1), limit / (2 * math.sqrt(count)))
    return [ReducedTransfer(*terms, otf.padding_m, tuple(node_maps), channel)]


def _node_maps(otf: SampledOtf, coupling: Array, limit: float) -> Array:
    """Return (S, K): the fewest combinations of maps that replace all K; none if all transfers are below the limit."""
    limit /= len(otf.parts)
    transfers = MapTransfers.by_map(otf, coupling)
    if all(of_mode.within(limit, 1) for of_mode in transfers):
        return np.empty((0, coupling.shape[1]))
    return _fewest_combinations(transfers, limit)


def _terms(otf: SampledOtf, coupling: Array, limit: float) -> tuple[Transfer, Array]:
    """Return the transfers of the fewest terms, and (terms, R, K) the maps that each term combines.

    `limit` is the largest error of any map in any channel at any frequency.
    """
    limit /= len(otf.parts)
    mixings = [_fewest_combinations([of_mode], limit) for of_mode in MapTransfers.by_map(otf, coupling)]
    # A term is 0 in all modes but its own.
    mixing = block_diagonal(*mixings).reshape(-1, otf.modes, coupling.shape[1])
    if otf.modes > 1 and len(mixing) > len(coupling) * otf.modes:
        of_all_modes = [MapTransfers.by_mode_and_map(otf, coupling)]
        directions = _directions(of_all_modes)
        terms = directions.reshape(-1, otf.modes, coupling.shape[1])
        # Terms of all modes cost more each: whether as few as are worth it suffice is checked first.
        most = int(np.searchsorted(np.cumsum(1 + _MAP_COST * terms.any(axis=2).sum(axis=1)), _term_cost(mixing)))
        if (count := _fewest(of_all_modes, limit, directions, most)) is not None:
            mixing = terms[:count]
    return otf.transfer(coupling, mixing), mixing


def _work(parts: Sequence[ReducedTransfer]) -> float:
    """Return the cost of node maps and terms, in transforms of the frame."""
    total = 0.0
    for part in parts:
        node_maps = part.node_maps or ()
        nodes, maps = sum(len(combinations) > 0 for combinations in node_maps), sum(map(len, node_maps))
        channels = part.transfer.channels
        total += _NODE_COST * nodes + _NODE_MAP_COST * maps + _term_cost(part.mixing)
        total += len(part.mixing) * (_CHANNEL_COST * channels + _MIXING_COST * maps)
    return total


def _term_cost(mixing: Array) -> float:
    """Count in transforms of the frame."""
    return len(mixing) + _MAP_COST * int(mixing.any(axis=2).sum())


def _fewest_combinations(transfers: Sequence[MapTransfers], limit: float) -> Array:
    """Return (terms, maps): the fewest orthonormal combinations of maps that represent all within the limit."""
    directions = _directions(transfers)
    count = _fewest(transfers, limit, directions, len(directions) - 1)
    return np.eye(len(directions)) if count is None else directions[:count]


def _directions(transfers: Sequence[MapTransfers]) -> Array:
    """Return (maps, maps): orthonormal combinations of maps, those that contribute most to the transfers first."""
    squares: Any = sum(part.squares(_STRIDE) for part in transfers)
    # Only singular values above 1e-6 of the first matter; doubles hold their squares, which are faster to find.
    directions: Array = np.linalg.eigh(squares)[1][:, ::-1].T
    return directions


def _fewest(transfers: Sequence[MapTransfers], limit: float, directions: Array, most: int) -> int | None:
    """Return how many of the first directions represent all transfers within the limit; None if more than `most`."""

    def enough(terms: int, stride: int) -> bool:
        return all(part.without(directions[:terms]).within(limit, stride) for part in transfers)

    if most < 1 or not enough(most, _STRIDE):
        return None
    low, high = 1, most
    while low < high:  # bisect with some of the frequencies
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle, _STRIDE) else (middle + 1, high)
    while low <= most and not enough(low, 1):  # then check all of them
        low += 1
    return low if low <= most else None
