"""Counter-based random numbers: Philox4x32-10.

A random number is a function of a key and a counter, without state: Salmon, Moraes, Dror, Shaw, "Parallel random
numbers: as easy as 1, 2, 3", SC 2011. The key has 64 bits. The counter is four 32-bit words: pixel, frame, use, draw.
"""

from __future__ import annotations

import numpy as np

from photosite.engine.jit import compiled

# Uses, the third word of the counter. Each block has four words. These numbers never change: seeds keep their meaning.
EXPOSURE = np.uint32(0)
"""Words 0 and 1: the Poisson trial. Word 2: the read noise."""
FIXED_PATTERN = np.uint32(1)
"""Words 0, 1 and 2: PRNU, DSNU and dark current."""
BLINKING = np.uint32(2)
"""Word 0: the state of a blinking pixel."""
LINES = np.uint32(3)
"""Word 0: the deviate of a row. Word 1: that of the column with the same number."""

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
    """Return the four random 32-bit words of a counter and a key."""
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
    """Return the two key words of a seed from 0 to 2^64 - 1.

    Examples
    --------
    >>> key_from_seed(7)
    (np.uint32(7), np.uint32(0))
    """
    return np.uint32(seed & 0xFFFFFFFF), np.uint32(seed >> 32)
