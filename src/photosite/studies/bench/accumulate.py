"""The frame accumulators' case: exact sums of a stack, against NumPy, and against only reading the stack."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.engine.frame_sums import FrameSums
from photosite.studies.bench.camera import COLS, ROWS
from photosite.studies.bench.timing import Case, in_turn, peak_mb

_TILE = np.array([[0, 1], [1, 2]])


def stack(frames: int) -> NDArray[np.uint16]:
    """(frames, rows, cols) of a D200's size: 12-bit numbers about a quarter of the range."""
    one = np.random.default_rng(1).normal(1000.0, 30.0, (ROWS, COLS)).astype(np.uint16)
    return np.stack([np.roll(one, k, axis=1) for k in range(frames)])


def sums() -> FrameSums:
    """Nothing yet, over a mosaic of three channels."""
    return FrameSums((ROWS, COLS), _TILE, white=4095)


Maps = tuple[NDArray[np.float64], NDArray[np.float64]]


def rooms() -> Maps:
    """Memory for the two maps, written once, so that neither side waits for the system to give it."""
    return np.zeros((ROWS, COLS)), np.zeros((ROWS, COLS))


def maps(pixels: NDArray[np.uint16], total: FrameSums, out: Maps) -> None:
    """Mean and variance over the frames, by way of the sums."""
    total.clear().add(pixels)
    total.mean(out[0])
    total.variance(out[1])


def maps_by_numpy(pixels: NDArray[np.uint16], out: Maps) -> None:
    """Mean and variance over the frames, NumPy's."""
    pixels.mean(axis=0, out=out[0])
    pixels.var(axis=0, ddof=1, out=out[1])


def work_maps(frames: int) -> None:
    """The work alone, for its memory, which is mostly the stack's."""
    maps(stack(frames), sums(), rooms())


def _frames(quick: bool) -> int:
    return 16 if quick else 64


def accumulate_d200(quick: bool = False) -> Case:
    """Mean and variance maps of a stack, against NumPy's `mean` and `var`."""
    pixels, total, out = stack(_frames(quick)), sums(), rooms()
    ours, theirs = in_turn(lambda: maps(pixels, total, out), lambda: maps_by_numpy(pixels, out), 2 if quick else 4)
    return Case(ours, theirs, peak_mb(work_maps, frames=len(pixels)), pixels.size / 1e6)


def accumulate_against_reading(quick: bool = False) -> Case:
    """A stack added to sums, against only reading it: NumPy's largest of its 64-bit words, as fast as memory is."""
    pixels = stack(_frames(quick))
    words, total = pixels.reshape(-1).view(np.uint64), sums()
    ours, theirs = in_turn(lambda: total.add(pixels), lambda: words.max(), 5 if quick else 15)
    return Case(ours, theirs, peak_mb(work_maps, frames=len(pixels)), pixels.size / 1e6)
