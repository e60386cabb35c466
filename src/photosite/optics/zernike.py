"""Zernike polynomials: the common indices, and values over a pupil.

Polar coordinates of the pupil: radius 1 at its rim, angle from x (right) towards y (up), for an upright image. Terms
with m > 0 go with cos(m angle), those with m < 0 with sin(|m| angle).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError, did_you_mean
from photosite.optics.checks import check_number

Index = Literal["noll", "fringe", "nm"]
Norm = Literal["rms", "peak"]
Term = tuple[int, int]
Array = NDArray[np.float64]

HIGHEST_ORDER = 40
"""Highest radial order; more indicates a wrong index."""


def zernike_terms(
    coefficients: Mapping[int | Term, float], index: Index = "noll", norm: Norm | None = None
) -> dict[Term, float]:
    """Return coefficients by (n, m), each the RMS of its term over the full circle.

    Parameters
    ----------
    coefficients
        Values by index: numbers from 1 for "noll" and "fringe", pairs (n, m) for "nm". Any unit.
    index
        "noll" (Noll 1976; Zemax calls it Standard), "fringe" (University of Arizona; Code V and Zemax Fringe) or "nm".
    norm
        "rms": coefficients are RMS values over the full circle. "peak": values at the rim where the angular factor is
        1. None: "peak" for "fringe", "rms" for the others.

    Raises
    ------
    InputError
        If the index or norm is unknown, a term does not exist or occurs twice, or its coefficient is not finite.

    Notes
    -----
    RMS over peak is 1 / sqrt(n + 1) for m = 0, 1 / sqrt(2 (n + 1)) otherwise.

    References
    ----------
    R. J. Noll, J. Opt. Soc. Am. 66 (1976) 207.

    Examples
    --------
    >>> zernike_terms({4: 50.0, 11: 20.0})
    {(2, 0): 50.0, (4, 0): 20.0}
    >>> {term: round(rms, 3) for term, rms in zernike_terms({4: 50.0}, "fringe").items()}
    {(2, 0): 28.868}
    """
    if index not in ("noll", "fringe", "nm"):
        hint = did_you_mean(str(index), ["noll", "fringe", "nm"])
        raise InputError("index", value=index, expected="'noll', 'fringe' or 'nm'", hint=hint)
    if norm not in (None, "rms", "peak"):
        raise InputError("norm", value=norm, expected="'rms' or 'peak'")
    peak = norm == "peak" or (norm is None and index == "fringe")
    terms: dict[Term, float] = {}
    for key, value in coefficients.items():
        n, m = _term(key, index)
        check_number(f"coefficients[{key!r}]", value)
        if (n, m) in terms:
            raise InputError(f"Zernike term {key!r} is given twice", hint="Add the two coefficients")
        terms[n, m] = float(value) / math.sqrt((1 if m == 0 else 2) * (n + 1)) if peak else float(value)
    return terms


def _term(key: int | Term, index: Index) -> Term:
    if index == "nm":
        if not (isinstance(key, tuple | list) and len(key) == 2 and all(_whole(k) for k in key)):
            raise InputError("Zernike term", value=key, expected="a pair (n, m) of whole numbers for index 'nm'")
        n, m = int(key[0]), int(key[1])
        if n < 0 or abs(m) > n or (n - m) % 2:
            raise InputError("Zernike term", value=key, expected="a pair (n, m) with |m| = n, n - 2, n - 4, ...")
    else:
        if not _whole(key) or int(key) < 1:  # type: ignore[arg-type]
            raise InputError("Zernike term", value=key, expected=f"a whole number from 1 for index '{index}'")
        n, m = (noll_to_nm if index == "noll" else fringe_to_nm)(int(key))  # type: ignore[arg-type]
    if n > HIGHEST_ORDER:
        raise InputError("Zernike term", value=key, expected=f"of radial order {HIGHEST_ORDER} or less, not {n}")
    return n, m


def _whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def noll_to_nm(j: int) -> Term:
    """Return (n, m) of Noll's index j, from 1: orders n in turn, |m| rising, m > 0 for even j."""
    n = (math.isqrt(8 * j - 7) - 1) // 2
    k = j - n * (n + 1) // 2 - 1
    m = 2 * (k // 2) + 1 if n % 2 else 2 * ((k + 1) // 2)
    return n, m if j % 2 == 0 else -m


def fringe_to_nm(j: int) -> Term:
    """Return (n, m) of the Fringe index j, from 1: groups of equal (n + |m|) / 2, |m| falling, m > 0 first."""
    group = math.isqrt(j - 1)
    k = j - group * group - 1
    n = group + k // 2
    return n, (2 * group - n) * (-1 if k % 2 else 1)


def zernike_values(terms: Sequence[Term], x: Array, y: Array) -> Array:
    """Return (terms, ...) values with RMS 1 over the full circle at points of the pupil, y up.

    The radial polynomial is r^|m| P_k^(0, |m|)(2 r^2 - 1), k = (n - |m|) / 2, with Jacobi polynomials P (Born and Wolf,
    Principles of Optics, section 9.2).

    Examples
    --------
    >>> zernike_values([(1, 1), (1, -1), (2, 0)], np.array([1.0, 0.0]), np.array([0.0, 1.0])).round(3)
    array([[2.   , 0.   ],
           [0.   , 2.   ],
           [1.732, 1.732]])
    """
    if not terms:
        return np.zeros((0, *np.shape(x)))
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    argument = 2 * radius**2 - 1
    highest: dict[int, int] = {}
    for n, m in terms:
        highest[abs(m)] = max(highest.get(abs(m), 0), (n - abs(m)) // 2)
    jacobi = {m: _jacobi(order, m, argument) for m, order in highest.items()}
    values = []
    for n, m in terms:
        term = jacobi[abs(m)][(n - abs(m)) // 2] * np.sqrt((2 * (n + 1)) / (2 if m == 0 else 1))
        if m:
            term = term * (np.sin if m < 0 else np.cos)(abs(m) * angle) * radius ** abs(m)
        values.append(term)
    return np.stack(values)


def _jacobi(highest: int, b: int, x: Array) -> list[Array]:
    """Return the Jacobi polynomials P_k^(0, b)(x) for k = 0 to `highest`, by the recurrence DLMF 18.9.2."""
    values = [np.ones_like(x), 1 + (b + 2) * ((x - 1) / 2)]
    for n in range(1, highest):
        denominator = (n + 1) * (n + b + 1)
        first = (2 * n + b + 1) * (2 * n + b + 2) / (2 * denominator)
        constant = -(b**2) * (2 * n + b + 1) / (2 * denominator * (2 * n + b))
        previous = n * (n + b) * (2 * n + b + 2) / (denominator * (2 * n + b))
        values.append((first * x + constant) * values[n] - previous * values[n - 1])
    return values
