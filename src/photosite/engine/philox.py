"""Counter-based random numbers: Philox4x32-10.

A number is a function of a key and a counter, with no state: Salmon, Moraes, Dror, Shaw, "Parallel random numbers:
as easy as 1, 2, 3", SC 2011. The key is 64 bits. The counter is four 32-bit words: pixel, frame, noise source, draw.
"""

from __future__ import annotations

import numpy as np

from photosite.engine.jit import compiled

_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint32(0x9E3779B9)
_W1 = np.uint32(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)
_ROUNDS = 10

Words = tuple[np.uint32, np.uint32, np.uint32, np.uint32]


@compiled(inline=True)
def philox4x32(c0: np.uint32, c1: np.uint32, c2: np.uint32, c3: np.uint32, k0: np.uint32, k1: np.uint32) -> Words:
    """Four random 32-bit words of a counter and a key."""
    for _ in range(_ROUNDS):
        p0 = _M0 * np.uint64(c0)
        p1 = _M1 * np.uint64(c2)
        c0 = np.uint32(p1 >> _32) ^ c1 ^ k0
        c2 = np.uint32(p0 >> _32) ^ c3 ^ k1
        c1 = np.uint32(p1 & _LOW)
        c3 = np.uint32(p0 & _LOW)
        k0 = np.uint32(k0 + _W0)
        k1 = np.uint32(k1 + _W1)
    return c0, c1, c2, c3


def key_from_seed(seed: int) -> tuple[np.uint32, np.uint32]:
    """The two key words of a seed, 0 to 2^64 - 1.

    Examples
    --------
    >>> key_from_seed(7)
    (np.uint32(7), np.uint32(0))
    """
    return np.uint32(seed & 0xFFFFFFFF), np.uint32(seed >> 32)
