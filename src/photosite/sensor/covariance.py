"""Correlations between the measured values of a sensor file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from photosite.errors import InputError
from photosite.values.validated import Section

ROUNDING = 1e-5
"""Tolerance for symmetry and positive semi-definiteness of correlations that were written with rounding."""

_DIGITS = 10


class Covariance(Section):
    """Correlations of measured values; with the values' standard uncertainties they give the covariance.

    Values with a common source, such as volts that were divided by one system gain, have correlated errors.

    Examples
    --------
    >>> shared = Covariance(names=("read_noise_mv", "conversion_gain_uv_per_e"), correlation=((1, 0.5), (0.5, 1)))
    >>> shared.without({"read_noise_mv"}) is None
    True
    """

    names: Annotated[tuple[str, ...], Field(min_length=2)]
    correlation: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, names: Sequence[str], covariance: NDArray[np.float64]) -> Covariance | None:
        """Return the correlations of a covariance matrix, without values of variance 0; None for fewer than two.

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
    def _check(self) -> Self:
        n = len(self.names)
        if len(set(self.names)) != n:
            raise InputError("names", value=self.names, expected="different fields of the sensor")
        if len(self.correlation) != n or any(len(row) != n for row in self.correlation):
            raise InputError("correlation", expected=f"{n} rows of {n} numbers, one for each of names")
        matrix = np.array(self.correlation)
        if not np.isfinite(matrix).all() or np.abs(matrix).max() > 1.0 + ROUNDING:
            raise InputError("correlation", expected="finite and from -1 to 1")
        if np.abs(np.diag(matrix) - 1.0).max() > ROUNDING or np.abs(matrix - matrix.T).max() > ROUNDING:
            raise InputError("correlation", expected="symmetric, with 1 on the diagonal")
        if (lowest := float(np.linalg.eigvalsh(matrix).min())) < -n * ROUNDING:
            raise InputError("correlation", expected=f"positive semi-definite; its lowest eigenvalue is {lowest:.3g}")
        return self

    def without(self, names: set[str]) -> Covariance | None:
        """Return the correlations of the other values, or None for fewer than two."""
        kept = [k for k, name in enumerate(self.names) if name not in names]
        if len(kept) < 2:
            return None
        matrix = tuple(tuple(self.correlation[a][b] for b in kept) for a in kept)
        return Covariance(names=tuple(self.names[k] for k in kept), correlation=matrix)

    def matrix(self, names: Sequence[str], standard_uncertainty: ArrayLike) -> NDArray[np.float64]:
        """Return the (n, n) covariance of values by name; values without an entry are independent.

        Examples
        --------
        >>> shared = Covariance(names=("a", "b"), correlation=((1, 0.5), (0.5, 1)))
        >>> shared.matrix(["b", "other", "a"], [1.0, 3.0, 2.0]).tolist()
        [[1.0, 0.0, 1.0], [0.0, 9.0, 0.0], [1.0, 0.0, 4.0]]
        """
        known = [(i, self.names.index(name)) for i, name in enumerate(names) if name in self.names]
        correlation = np.eye(len(names))
        for i, a in known:
            for j, b in known:
                if i != j:
                    correlation[i, j] = self.correlation[a][b]
        scale = np.asarray(standard_uncertainty, dtype=np.float64)
        return correlation * np.outer(scale, scale)
