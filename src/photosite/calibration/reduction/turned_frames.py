"""Frames that are mirrored or rotated relative to the others of their chip."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.foreign_frames import fine_pattern
from photosite.values.diagnostic import DiagnosticKind

Turn = Callable[[NDArray[np.generic]], NDArray[np.generic]]

LEFT_TO_RIGHT = "mirrored left to right"
MIRRORED = MappingProxyType[str, Turn](
    {
        LEFT_TO_RIGHT: lambda frame: frame[:, ::-1],
        "mirrored top to bottom": lambda frame: frame[::-1],
        "rotated by 180 degrees": lambda frame: frame[::-1, ::-1],
    }
)
_OF_SQUARES = MappingProxyType[str, Turn](
    {
        "rotated by 90 degrees": np.rot90,
        "rotated by 270 degrees": lambda frame: np.rot90(frame, 3),
        "mirrored along a diagonal": np.transpose,
        "mirrored along the other diagonal": lambda frame: frame[::-1, ::-1].T,
    }
)

TURNED_FRAME = DiagnosticKind(
    "turned-frame",
    "left out",
    "A frame is mirrored or rotated relative to the others: its fixed pattern is theirs after it is turned.",
    "The frame was left out: its pixels are not those of the others.",
    "Use the frames as the camera writes them.",
    false_alarms="none: only frames that differ from the others are compared",
)

LEAST_SIGMA = 8.0
"""Correlation with the turned frame, in standard deviations of chance, from which the frame is turned."""
MOST_COMPARED, MOST_LINES = 4, 512
"""Frames that are read for each mean; rows and columns in the middle that are compared."""


def turns(shape: tuple[int, ...]) -> dict[str, Turn]:
    """Return the ways in which frames of a size (rows, cols) can be turned: what each is called, and what undoes it."""
    return {**MIRRORED, **(_OF_SQUARES if shape[0] == shape[1] else {})}


def middle(frame: NDArray[np.generic], tile: tuple[int, ...]) -> NDArray[np.generic]:
    """Return the part in the middle of a frame that is compared, from a corner of a tile on."""
    edges = [max(size - MOST_LINES, 0) // 2 // step * step for size, step in zip(frame.shape, tile, strict=True)]
    (top, left), (rows, cols) = edges, frame.shape
    return frame[top : rows - top, left : cols - left]


def how_turned(
    frames: Sequence[NDArray[np.generic]], others: Sequence[NDArray[np.generic]], tile: tuple[int, ...]
) -> str | None:
    """Return how frames that differ from others are turned relative to them; None if they are not.

    Parameters
    ----------
    frames, others
        (rows, cols) digital numbers, all of `middle`.
    tile
        Rows and columns of the tile of the color filter array: a turned frame has other colors at its sites.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> chip = rng.normal(1000.0, 5.0, (48, 64))
    >>> frames = [np.uint16(chip + rng.normal(0.0, 8.0, (48, 64))) for _ in range(4)]
    >>> how_turned([frames[0][::-1]], frames[1:], (1, 1)), how_turned(frames[:1], frames[1:], (1, 1))
    ('mirrored top to bottom', None)
    """
    frame, mean = (np.mean(np.stack(each), axis=0) for each in (frames, others))
    shape = frame.shape
    sites = np.arange(shape[0])[:, None] % tile[0] * tile[1] + np.arange(shape[1]) % tile[1]
    ways = turns(shape)
    patterns = np.concatenate(fine_pattern([mean, frame, *(turn(frame) for turn in ways.values())], sites), axis=1)
    lengths = np.linalg.norm(patterns, axis=1)
    if not lengths.all():
        return None
    as_it_is, *turned = (patterns[1:] @ patterns[0]) / (lengths[1:] * lengths[0])
    best = int(np.argmax(turned))
    limit = max(LEAST_SIGMA / math.sqrt(patterns.shape[1]), 2.0 * abs(float(as_it_is)))
    return list(ways)[best] if turned[best] > limit else None
