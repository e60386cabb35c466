"""Roots of functions, as those of SciPy."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest
import scipy.optimize

from photosite.engine.roots import brentq


def test_the_root_is_that_of_scipy() -> None:
    for power in range(2, 9):
        options = {"xtol": 10.0**-power, "rtol": 1e-12}
        assert brentq(math.cos, 0.0, 3.0, **options) == scipy.optimize.brentq(math.cos, 0.0, 3.0, **options)
    assert brentq(math.cos, 0.0, 3.0) == scipy.optimize.brentq(math.cos, 0.0, 3.0)


@pytest.mark.parametrize("function", [lambda x: x + 1.0, lambda x: math.nan])
def test_no_root(function) -> None:
    with pytest.raises(ValueError, match=r"signs|not a number"):
        brentq(function, 0.0, 1.0)


def test_the_package_is_not_imported() -> None:
    code = """
import sys
from photosite.engine.roots import brentq
root = brentq(lambda x: x - 0.25, 0.0, 1.0)
if "scipy.optimize" in sys.modules:
    sys.exit(1)
import scipy.optimize
sys.exit(root != scipy.optimize.brentq(lambda x: x - 0.25, 0.0, 1.0))
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
