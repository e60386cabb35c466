"""Check of 8-bit frames for JPEG compression: its cosine coefficients of blocks are whole numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.special import ndtri

from photosite.calibration.diagnostics import Check
from photosite.calibration.reduction.reduce import Reduction
from photosite.values.diagnostic import Diagnostic, DiagnosticKind, one_in

P_VALUE, LEAST_CONCENTRATION = 1e-8, 0.02
"""Fraction of uncompressed frames that are reported, and the mean cosine that matters: compressed ones have 0.19."""

_SIDE, _MOST = 8, 512
"""Side of JPEG's blocks; largest number of rows and columns that are looked at."""

_LEAST_SPREAD = 0.75
"""Standard deviation of a coefficient from which its fraction is even by chance, with a mean cosine below 2e-5."""

JPEG_FRAMES = DiagnosticKind(
    "jpeg-frames",
    "warning",
    "The cosine coefficients of blocks of 8 x 8 pixels are whole numbers: the frames were compressed as JPEG.",
    "The temporal variances are not those of the sensor. Gain, read noise and what follows from them may be percents "
    "off.",
    "Use frames without lossy compression.",
    ("system_gain_dn_per_e", "read_noise_*", "temporal_dark_noise_e", "dsnu*", "prnu*", "saturation_*", "*_e", "*_db"),
    "mean cosine of the coefficients' fractions; 0.19 for whole numbers in rounded pixels, 0 without compression",
    f"below {one_in(P_VALUE)} sets",
)


def concentration(frame: NDArray[np.unsignedinteger]) -> tuple[float, int]:
    """Return the mean cosine of 2 pi times the coefficients of blocks, and the number of coefficients.

    Only coefficients that vary count. Those of the frequencies 0 and 4 are fractions of whole numbers in any frame.

    Examples
    --------
    >>> frame = np.random.default_rng(1).normal(100, 3, (256, 256)).round().astype(np.uint8)
    >>> mean, number = concentration(frame)
    >>> abs(mean) < 5 / math.sqrt(2 * number)
    True
    """
    rows, cols = (min(length, _MOST) // _SIDE for length in frame.shape)
    blocks = frame[: rows * _SIDE, : cols * _SIDE].reshape(rows, _SIDE, cols, _SIDE).astype(np.float64)
    found = scipy.fft.dctn(blocks, axes=(1, 3), norm="ortho").transpose(1, 3, 0, 2).reshape(_SIDE, _SIDE, -1)
    varies = found.std(axis=2) >= _LEAST_SPREAD
    varies[np.ix_([0, 4], [0, 4])] = False
    chosen = found[varies]
    return (float(np.cos(2.0 * math.pi * chosen).mean()) if chosen.size else 0.0), chosen.size


def jpeg_frames(reduction: Reduction) -> Iterator[Diagnostic]:
    """Blocks of one of the brightest unclipped flat fields of 8 bits or fewer."""
    clear = [entry for entry in reduction.lights if not any(level.clipped for level in entry.levels)]
    if reduction.frames.bits > 8 or not clear:
        return
    members = {id(source) for source in max(clear, key=lambda entry: entry.levels[0].mean).group.frames}
    source = next(entry.source for entry in reduction.used if id(entry.source) in members)
    mean, number = concentration(source.read())
    if mean > max(LEAST_CONCENTRATION, -float(ndtri(P_VALUE)) / math.sqrt(2.0 * max(number, 1))):
        yield JPEG_FRAMES(
            f"the frames were compressed as JPEG ({source.name}): the cosine coefficients of blocks of 8 x 8 pixels "
            f"are whole numbers. Temporal variances are not those of the sensor, and gain and read noise may be "
            f"percents off; use frames without lossy compression",
            mean,
        )


CHECKS = (Check("levels", 60, jpeg_frames),)
