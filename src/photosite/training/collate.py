"""Batches of pairs, as arrays of NumPy, torch or JAX."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.training.pair import Pair
from photosite.values.cfa import Cfa, cfa_from
from photosite.values.choice import check_choice

Library = Literal["numpy", "torch", "jax"]

_FROM_DLPACK = {"torch": "torch", "jax": "jax.dlpack"}
"""The module of each library that has `from_dlpack`."""


def collate(pairs: Sequence[Pair], library: Library = "numpy", *, packed: bool = False) -> Pair:
    """Return a batch of pairs; frames are copied once, in a worker of torch's `DataLoader` to memory that is shared.

    For torch: `DataLoader(dataset, collate_fn=functools.partial(collate, library="torch"))`.

    Parameters
    ----------
    pairs
        Items of a dataset.
    library
        "numpy", "torch" or "jax", which must be installed.
    packed
        Whether a mosaic becomes one channel for each place in the color filter array's tile: (channels, rows / tile
        rows, cols / tile columns), as networks take them.

    Returns
    -------
    Pair
        `clean` and `noisy` (pairs, rows, cols), or (pairs, channels, rows, cols) if packed, of the items' types;
        `metadata` with an array (pairs,) of each number and a list of each text.

    Raises
    ------
    InputError
        If there are no pairs, their shapes or metadata differ, or the library is unknown or not installed.

    Examples
    --------
    >>> import photosite as ps
    >>> light = ps.training.Electrons([np.full((32, 32), 100.0)])
    >>> pairs = ps.training.PairDataset(light, ps.load_sensor("vendor-2.2um"), draws=3)
    >>> batch = collate([pairs[0], pairs[2]], packed=True)
    >>> batch.noisy.shape, batch.noisy.dtype, batch.metadata["draw"]
    ((2, 4, 16, 16), dtype('uint16'), array([0, 2]))
    """
    check_choice("library", library, Library)
    if not pairs:
        raise InputError("pairs", value=0, expected="one or more")
    first = pairs[0]
    for number, pair in enumerate(pairs):
        if not isinstance(pair, Pair):
            raise InputError(f"pairs[{number}]", value=type(pair).__name__, expected="a Pair, an item of a dataset")
        if pair.clean.shape != first.clean.shape or pair.noisy.dtype != first.noisy.dtype:
            found = f"{pair.clean.shape} of {pair.noisy.dtype}"
            raise InputError("pairs", value=found, expected=f"all {first.clean.shape} of {first.noisy.dtype}")
        if pair.metadata.keys() != first.metadata.keys():
            names = sorted(pair.metadata.keys() ^ first.metadata.keys())
            raise InputError("pairs", value=names, expected="of the same metadata")
    made = _array_maker(library)
    stack = _stack_tensors if library == "torch" else lambda frames: made(np.stack(frames))

    def batch(frames: list[NDArray[Any]]) -> Any:
        if packed:
            frames = [pack(frame, cfa_from(pair.metadata["cfa"])) for frame, pair in zip(frames, pairs, strict=True)]
        return stack(frames)

    facts = {name: [pair.metadata[name] for pair in pairs] for name in first.metadata}
    metadata = {
        name: values if any(isinstance(value, str) for value in values) else made(np.array(values))
        for name, values in facts.items()
    }
    return Pair(batch([pair.clean for pair in pairs]), batch([pair.noisy for pair in pairs]), metadata)


def pack(mosaic: NDArray[Any], cfa: Cfa) -> NDArray[Any]:
    """Return (places of the tile, rows / tile rows, cols / tile columns) of a mosaic (rows, cols).

    Examples
    --------
    >>> pack(np.arange(8).reshape(2, 4), (("R", "G"), ("G", "B")))[:, 0]
    array([[0, 2],
           [1, 3],
           [4, 6],
           [5, 7]])
    """
    rows, cols = len(cfa), len(cfa[0])
    return np.stack([mosaic[r::rows, c::cols] for r in range(rows) for c in range(cols)])


def _stack_tensors(frames: list[NDArray[Any]]) -> Any:
    """Return a tensor of all frames: in a worker of a `DataLoader`, in memory that the program's process shares."""
    torch, data = importlib.import_module("torch"), importlib.import_module("torch.utils.data")
    return data.default_collate([torch.from_numpy(np.require(frame, None, "W")) for frame in frames])


def _array_maker(library: Library) -> Callable[[NDArray[Any]], Any]:
    if library == "numpy":
        return lambda array: array
    try:
        from_dlpack = importlib.import_module(_FROM_DLPACK[library]).from_dlpack
    except ImportError:
        hint = f"Install {library}, or pass {{library}}"
        raise InputError(
            "library", value=library, expected="installed", hint=hint, arguments={"library": "numpy"}
        ) from None
    # DLPack has no bool before version 1.
    return lambda array: from_dlpack(array.astype(np.uint8) if array.dtype == np.bool_ else array)
