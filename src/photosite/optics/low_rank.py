"""Low-rank approximation of PSFs that vary over the field: a few modes with weights.

The first mode is the mean over the field, with weight 1 everywhere. The others are principal components of the
deviations. Every PSF sums to 1, so the others sum to 0: energy is conserved for any number of modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LowRank:
    """Modes and weights.

    Parameters
    ----------
    weights, modes
        (R, nodes), and (R, ...) of the shape of one node's samples.
    relative_error
        RMS of the omitted part over the RMS of all samples.
    error_by_rank
        (nodes,) the same error for 1, 2, ... modes.
    """

    weights: Array
    modes: Array
    relative_error: float
    error_by_rank: Array


def low_rank(samples: Array, *, tolerance: float, rank: int | None = None, compared: Array | None = None) -> LowRank:
    """Return the fewest modes that keep a tolerance.

    Parameters
    ----------
    samples
        (nodes, ...): samples at every node of the field.
    tolerance
        Largest relative error, RMS over all samples of all nodes.
    rank
        Number of modes, in place of the tolerance; at most the number of nodes.
    compared
        (nodes, ...) the samples to compare, such as blurred ones: modes are chosen for them, and errors are theirs.
        None: the samples themselves.

    References
    ----------
    C. Eckart and G. Young, Psychometrika 1 (1936) 211, for the samples less their mean. It is computed from the Gram
    matrix of the nodes, so that errors below 1e-8 are rounding.

    Examples
    --------
    >>> ramp = np.linspace(0, 1, 5)[:, None] * np.array([1.0, -1.0]) + np.array([0.0, 1.0])
    >>> result = low_rank(ramp, tolerance=1e-6)
    >>> result.modes.shape, bool(np.allclose(result.weights.T @ result.modes, ramp))
    ((2, 2), True)
    """
    nodes = samples.shape[0]
    flat = samples.reshape(nodes, -1)
    mean = flat.mean(axis=0)
    rest = flat - mean
    seen = flat if compared is None else compared.reshape(nodes, -1)
    deviation = rest if compared is None else seen - seen.mean(axis=0)
    power, vectors = np.linalg.eigh(deviation @ deviation.T)
    power, vectors = np.maximum(power[::-1], 0.0), vectors[:, ::-1]
    left = np.append(np.cumsum(power[::-1])[::-1], 0.0)[:nodes]
    errors = np.sqrt(left / float((seen**2).sum()))
    count = min(rank or int(np.argmax(np.append(errors, 0.0) <= tolerance)) + 1, nodes)
    directions = vectors[:, : count - 1]
    weights = np.concatenate([np.ones((1, nodes)), directions.T])
    modes = np.concatenate([mean[None], directions.T @ rest])
    return LowRank(weights, modes.reshape(count, *samples.shape[1:]), float(errors[count - 1]), errors)
