"""Zernike polynomials: which is which in the indices people use, and their values over a pupil.

Polar coordinates of the pupil: radius 1 at its rim, the angle from x (right) towards y (up), the picture upright.
Terms of m > 0 go with cos(m angle), those of m < 0 with sin(|m| angle).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError, did_you_mean

Index = Literal["noll", "fringe", "nm"]
Norm = Literal["rms", "peak"]
Term = tuple[int, int]
Array = NDArray[np.float64]

HIGHEST_ORDER = 40
"""Radial order up to which terms are taken: more is a wrong index rather than a lens."""


def zernike_terms(
    coefficients: Mapping[int | Term, float], index: Index = "noll", norm: Norm | None = None
) -> dict[Term, float]:
    """Coefficients by (n, m), each the RMS of its term over the full circle.

    Parameters
    ----------
    coefficients
        By index: numbers from 1 for "noll" and "fringe", pairs (n, m) for "nm". The unit is the caller's.
    index
        "noll" (Noll 1976; Zemax calls it Standard), "fringe" (University of Arizona; Code V and Zemax Fringe), "nm".
    norm
        What a coefficient is: "rms" over the full circle, or "peak", the term's value at the rim where its angular part
        is 1. None: what goes with the index, "peak" for "fringe", "rms" for the others.

    Raises
    ------
    InputError
        If the index or norm is unknown, a term does not exist, comes twice, or its coefficient is not finite.

    Notes
    -----
    R. J. Noll, J. Opt. Soc. Am. 66 (1976) 207. RMS over peak is 1 / sqrt(n + 1) for m = 0, 1 / sqrt(2 (n + 1)) else.

    Examples
    --------
    >>> zernike_terms({4: 50.0, 11: 20.0})
    {(2, 0): 50.0, (4, 0): 20.0}
    >>> {term: round(rms, 3) for term, rms in zernike_terms({4: 50.0}, "fringe").items()}
    {(2, 0): 28.868}
    """
    if index not in ("noll", "fringe", "nm"):
        raise InputError(f"unknown Zernike index '{index}'; {did_you_mean(str(index), ['noll', 'fringe', 'nm'])}")
    if norm not in (None, "rms", "peak"):
        raise InputError(f"a Zernike coefficient's norm is 'rms' or 'peak', not '{norm}'")
    peak = norm == "peak" or (norm is None and index == "fringe")
    terms: dict[Term, float] = {}
    for key, value in coefficients.items():
        n, m = _term(key, index)
        if not math.isfinite(value):
            raise InputError(f"Zernike coefficient {key} must be a finite number, not {value}")
        if (n, m) in terms:
            raise InputError(f"Zernike coefficient {key} is given twice; add the two")
        terms[n, m] = float(value) / math.sqrt((1 if m == 0 else 2) * (n + 1)) if peak else float(value)
    return terms


def _term(key: int | Term, index: Index) -> Term:
    """(n, m) of an index."""
    from prysm.polynomials import fringe_to_nm, noll_to_nm

    if index == "nm":
        if not (isinstance(key, tuple | list) and len(key) == 2 and all(_whole(k) for k in key)):
            raise InputError(f"with index 'nm' a Zernike term is a pair (n, m) of whole numbers, not {key!r}")
        n, m = int(key[0]), int(key[1])
        if n < 0 or abs(m) > n or (n - m) % 2:
            raise InputError(f"there is no Zernike term (n, m) = ({n}, {m}): |m| goes from n down in steps of 2")
    else:
        if not _whole(key) or int(key) < 1:  # type: ignore[arg-type]
            raise InputError(f"a Zernike term of index '{index}' is a whole number from 1, not {key!r}")
        n, m = (noll_to_nm if index == "noll" else fringe_to_nm)(int(key))  # type: ignore[arg-type]
        n, m = int(n), int(m)
    if n > HIGHEST_ORDER:
        raise InputError(f"Zernike term {key!r} has radial order {n}; orders up to {HIGHEST_ORDER} are taken")
    return n, m


def _whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def zernike_values(terms: Sequence[Term], x: Array, y: Array) -> Array:
    """(terms, ...) values of RMS 1 over the full circle at points of the pupil, y up.

    Examples
    --------
    >>> zernike_values([(1, 1), (1, -1), (2, 0)], np.array([1.0, 0.0]), np.array([0.0, 1.0])).round(3)
    array([[2.   , 0.   ],
           [0.   , 2.   ],
           [1.732, 1.732]])
    """
    from prysm.polynomials import zernike_nm_sequence

    if not terms:
        return np.zeros((0, *np.shape(x)))
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    return np.stack([np.asarray(z, np.float64) for z in zernike_nm_sequence(list(terms), radius, angle, norm=True)])
