"""Philox4x32-10 compared with the known answers published by Random123 (kat_vectors)."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.engine.philox import key_from_seed, philox4x32

KNOWN_ANSWERS = [
    ([0, 0, 0, 0], [0, 0], [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
    ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
    (
        [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
        [0xA4093822, 0x299F31D0],
        [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
    ),
]


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN_ANSWERS)
def test_known_answers(counter: list[int], key: list[int], answer: list[int]) -> None:
    words = philox4x32(*(np.uint32(w) for w in counter), *(np.uint32(w) for w in key))
    assert [int(w) for w in words] == answer


@pytest.mark.parametrize("seed", [0, 1, 123456789, 2**63 + 11, 2**64 - 1])
def test_agrees_with_the_definition_in_integers(seed: int) -> None:
    """An independent Philox4x32-10 in Python integers."""

    def slow(c: list[int], k: list[int]) -> list[int]:
        for _ in range(10):
            a, b = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
            c = [(b >> 32) ^ c[1] ^ k[0], b & 0xFFFFFFFF, (a >> 32) ^ c[3] ^ k[1], a & 0xFFFFFFFF]
            k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
        return c

    k0, k1 = key_from_seed(seed)
    words = philox4x32(np.uint32(7), np.uint32(1), np.uint32(2), np.uint32(3), k0, k1)
    assert [int(w) for w in words] == slow([7, 1, 2, 3], [int(k0), int(k1)])
