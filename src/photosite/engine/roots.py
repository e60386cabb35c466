"""Roots of functions: `scipy.optimize.brentq`, by its extension module alone; the package takes 0.1 s to import."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

from photosite.engine.extension_module import extension_module

_MOST_STEPS = 100


def brentq(
    function: Callable[[float], float],
    low: float,
    high: float,
    *,
    xtol: float = 2e-12,
    rtol: float = 4.0 * sys.float_info.epsilon,
) -> float:
    """Return the root between two arguments at which a function has different signs, by Brent's method.

    Parameters
    ----------
    function
        The function.
    low, high
        The arguments.
    xtol, rtol
        Absolute and relative tolerance of the root.

    Raises
    ------
    ValueError
        If the signs are equal, or the function is not a number.
    RuntimeError
        If the method does not converge.

    Examples
    --------
    >>> round(brentq(lambda x: x * x - 2.0, 0.0, 2.0), 12)
    1.414213562373
    """

    def checked(x: float) -> float:
        if math.isnan(value := function(x)):
            raise ValueError(f"the function is not a number at {x}")
        return value

    solve = extension_module("scipy.optimize._zeros")._brentq
    return float(solve(checked, low, high, xtol, rtol, _MOST_STEPS, (), False, True))
