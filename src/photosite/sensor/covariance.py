"""What the measured values of a sensor file share: their correlations, so that what is derived from them is exact."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, model_validator

ROUNDING = 1e-5
"""What correlations written with rounding may lack of being symmetric and positive semi-definite."""

_DIGITS = 10


class Covariance(BaseModel):
    """Correlations of measured values; with the standard uncertainties beside the values they are the covariance.

    Values that share a source, such as volts that were divided by one system gain, err together.

    Examples
    --------
    >>> shared = Covariance(names=("read_noise_mv", "conversion_gain_uv_per_e"), correlation=((1, 0.5), (0.5, 1)))
    >>> shared.without({"read_noise_mv"}) is None
    True
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    names: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, names: Sequence[str], covariance: NDArray[np.float64]) -> Covariance | None:
        """From a covariance matrix; what has no variance is left out. None where fewer than two values have some.

        Examples
        --------
        >>> Covariance.of(["a", "b", "c"], np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])).correlation
        ((1.0, 0.5), (0.5, 1.0))
        """
        kept = np.flatnonzero(np.diag(covariance) > 0.0)
        if kept.size < 2:
            return None
        scale = np.sqrt(np.diag(covariance)[kept])
        matrix = np.round(covariance[np.ix_(kept, kept)] / np.outer(scale, scale), _DIGITS)
        np.fill_diagonal(matrix, 1.0)
        return cls(names=tuple(names[int(k)] for k in kept), correlation=tuple(map(tuple, matrix.tolist())))

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        n = len(self.names)
        if n < 2 or len(set(self.names)) != n:
            raise ValueError("names are two different fields of the sensor or more")
        if len(self.correlation) != n or any(len(row) != n for row in self.correlation):
            raise ValueError(f"correlation needs {n} rows of {n} numbers, one for each of names")
        matrix = np.array(self.correlation)
        if not np.isfinite(matrix).all() or np.abs(matrix).max() > 1.0 + ROUNDING:
            raise ValueError("a correlation is a number from -1 to 1")
        if np.abs(np.diag(matrix) - 1.0).max() > ROUNDING or np.abs(matrix - matrix.T).max() > ROUNDING:
            raise ValueError("correlation is symmetric, with 1 on its diagonal")
        lowest = float(np.linalg.eigvalsh(matrix).min())
        if lowest < -n * ROUNDING:
            raise ValueError(
                f"these correlations cannot be together: an eigenvalue of the matrix is {lowest:.3g}, below 0"
            )
        return self

    def without(self, names: set[str]) -> Covariance | None:
        """Of the other values; None where fewer than two are left."""
        kept = [k for k, name in enumerate(self.names) if name not in names]
        if len(kept) < 2:
            return None
        matrix = tuple(tuple(self.correlation[a][b] for b in kept) for a in kept)
        return Covariance(names=tuple(self.names[k] for k in kept), correlation=matrix)

    def matrix(self, names: Sequence[str], standard_uncertainty: ArrayLike) -> NDArray[np.float64]:
        """(n, n) covariance of values by name; those that are not here are independent of all.

        Examples
        --------
        >>> shared = Covariance(names=("a", "b"), correlation=((1, 0.5), (0.5, 1)))
        >>> shared.matrix(["b", "other", "a"], [1.0, 3.0, 2.0]).tolist()
        [[1.0, 0.0, 1.0], [0.0, 9.0, 0.0], [1.0, 0.0, 4.0]]
        """
        place = {name: k for k, name in enumerate(self.names)}
        correlation = np.eye(len(names))
        for i, a in enumerate(names):
            for j, b in enumerate(names):
                if i != j and a in place and b in place:
                    correlation[i, j] = self.correlation[place[a]][place[b]]
        scale = np.asarray(standard_uncertainty, dtype=np.float64)
        return correlation * np.outer(scale, scale)
