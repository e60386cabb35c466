"""Discrete Fourier transforms along one axis: those of scipy.fft, by its extension module alone.

Importing scipy.fft takes 0.1 s, a fifteenth of a simulated frame: it imports scipy.special and most of NumPy. Where a
version of SciPy keeps the module elsewhere, scipy.fft is imported.
"""

from __future__ import annotations

import sys
from functools import lru_cache
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.threads import thread_count

C64 = NDArray[np.complex64]
F32 = NDArray[np.float32]

_MODULE = "scipy.fft._pocketfft.pypocketfft"
_UNSCALED = 0
"""What the module calls a transform without a factor."""


def rfft(values: F32, axis: int) -> C64:
    """Return `scipy.fft.rfft`."""
    found: C64 = _library().r2c(np.asarray(values), (axis,), True, _UNSCALED, None, thread_count())
    return found


def fft(values: C64, axis: int) -> C64:
    """Return `scipy.fft.fft`, in place."""
    found: C64 = _library().c2c(values, (axis,), True, _UNSCALED, values, thread_count())
    return found


def ifft_unscaled(values: C64, axis: int) -> C64:
    """Return `scipy.fft.ifft` with the norm "forward", in place."""
    found: C64 = _library().c2c(values, (axis,), False, _UNSCALED, values, thread_count())
    return found


def irfft_unscaled(values: C64, count: int, axis: int) -> F32:
    """Return `scipy.fft.irfft` with the norm "forward"."""
    found: F32 = _library().c2r(values, (axis,), count, False, _UNSCALED, None, thread_count())
    return found


def next_fast_len(count: int) -> int:
    """Return `scipy.fft.next_fast_len` for real values."""
    return int(_library().good_size(count, True))


@lru_cache(maxsize=1)
def _library() -> Any:
    import scipy

    folder = Path(scipy.__path__[0], *_MODULE.split(".")[1:-1])
    if _MODULE not in sys.modules and (spec := PathFinder.find_spec(_MODULE, [str(folder)])) is not None:
        module = module_from_spec(spec)
        assert spec.loader is not None
        spec.loader.exec_module(module)
        sys.modules[_MODULE] = module
    return import_module(_MODULE)
