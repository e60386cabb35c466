"""Point spreads that differ over the field as a few modes with weights: the least error for their number.

The first mode is the mean over the field, its weight 1 everywhere. The others are principal components of what is
left. Every point spread sums to 1, so that these sum to 0: however many are kept, light is neither lost nor won.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LowRank:
    """Modes and weights.

    Parameters
    ----------
    weights
        (R, nodes).
    modes
        (R, ...) of the shape of one node's samples.
    relative_error
        RMS of what is left out over the RMS of all samples, as judged.
    error_by_rank
        (nodes,) the same for 1, 2, ... modes.
    """

    weights: Array
    modes: Array
    relative_error: float
    error_by_rank: Array


def low_rank(samples: Array, *, tolerance: float, rank: int | None = None, judged: Array | None = None) -> LowRank:
    """The fewest modes that keep a tolerance.

    Parameters
    ----------
    samples
        (nodes, ...): of every node of the field.
    tolerance
        Largest relative error, RMS over all samples of all nodes.
    rank
        Number of modes instead, at most that of the nodes.
    judged
        (nodes, ...) the samples as they are looked at, blurred say: errors are those of these, and modes are chosen for
        them. None: the samples.

    Raises
    ------
    InputError
        If the tolerance is not between 0 and 1, or the rank not between 1 and the number of nodes.

    Notes
    -----
    Eckart and Young, Psychometrika 1 (1936) 211, for the samples less their mean; by the nodes' Gram matrix, so that
    an error below 1e-8 is that of rounding.

    Examples
    --------
    >>> ramp = np.linspace(0, 1, 5)[:, None] * np.array([1.0, -1.0]) + np.array([0.0, 1.0])
    >>> result = low_rank(ramp, tolerance=1e-6)
    >>> result.modes.shape, bool(np.allclose(result.weights.T @ result.modes, ramp))
    ((2, 2), True)
    """
    nodes = samples.shape[0]
    if not 0 < tolerance < 1:
        raise InputError(f"a low-rank sum's tolerance is a fraction between 0 and 1, not {tolerance}")
    if rank is not None and not 1 <= rank <= nodes:
        raise InputError(f"a low-rank sum over {nodes} nodes has 1 to {nodes} modes, not {rank}")
    flat = samples.reshape(nodes, -1)
    mean = flat.mean(axis=0)
    rest = flat - mean
    seen = flat if judged is None else judged.reshape(nodes, -1)
    deviation = rest if judged is None else seen - seen.mean(axis=0)
    power, vectors = np.linalg.eigh(deviation @ deviation.T)
    power, vectors = np.maximum(power[::-1], 0.0), vectors[:, ::-1]
    left = np.append(np.cumsum(power[::-1])[::-1], 0.0)[:nodes]
    errors = np.sqrt(left / float((seen**2).sum()))
    count = rank if rank is not None else int(np.argmax(np.append(errors, 0.0) <= tolerance)) + 1
    count = min(count, nodes)
    directions = vectors[:, : count - 1]
    weights = np.concatenate([np.ones((1, nodes)), directions.T])
    modes = np.concatenate([mean[None], directions.T @ rest])
    return LowRank(weights, modes.reshape(count, *samples.shape[1:]), float(errors[count - 1]), errors)
