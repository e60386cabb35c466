"""Discrete Fourier transforms along one axis: those of scipy.fft, by its extension module alone.

Importing scipy.fft takes 0.1 s, a fifteenth of a simulated frame: it imports scipy.special and most of NumPy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.extension_module import extension_module
from photosite.engine.threads import thread_count

C64 = NDArray[np.complex64]
F32 = NDArray[np.float32]

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


def _library() -> Any:
    return extension_module("scipy.fft._pocketfft.pypocketfft")
