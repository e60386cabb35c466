"""Numbers that are sums of several of the converter's codes: binned pixels, averaged frames."""

from __future__ import annotations

from dataclasses import dataclass

NUMBERS = (2, 4, 8, 9, 16, 32, 64)
"""Numbers of frames or pixels that cameras add up."""

LEAST_BITS = 10
"""Smallest bit depth that is searched: a white level is a multiple of 1023 or more, times one of the numbers, by chance
in fewer than one of 1000 cameras."""


@dataclass(frozen=True)
class Sums:
    """Each number is the sum of `number` codes of `bits` bits."""

    number: int
    bits: int

    def __str__(self) -> str:
        return (
            f"the flat fields are clipped at {self.number} times the full scale of {self.bits} bits: each number is "
            f"the sum of {self.number} of the converter's (binned pixels or averaged frames); gain, wells and noise "
            f"hold for the sums, and the quantization noise of {self.number} codes was taken off"
        )


def find_sums(white: int, step: float, bits: int) -> Sums | None:
    """Return how many of the converter's codes make one number, from the white level; None for one.

    Examples
    --------
    >>> find_sums(4 * 4095, 1.0, 14), find_sums(4 * 4095, 4.0, 14), find_sums(4095, 1.0, 12)
    (Sums(number=4, bits=12), None, None)
    """
    if step < 1.0 or step != round(step) or white % round(step):
        return None
    codes = white // round(step)
    for fewer in range(LEAST_BITS, bits):
        number, left = divmod(codes, (1 << fewer) - 1)
        if left == 0 and number in NUMBERS:
            return Sums(number, fewer)
    return None
