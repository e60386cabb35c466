"""Drift of the black level from frame to frame: 1/f noise that all pixels share."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import about


class BlackLevelDrift(EffectSection):
    """1/f noise of the black level over the frames of a seed: a sum of steps, each held for twice as long as the last.

    Examples
    --------
    >>> BlackLevelDrift(standard_deviation_e=2).octaves
    12
    """

    standard_deviation_e: Annotated[float, Field(ge=0.0)] = about(
        "Standard deviation of the black level over many frames.", "e-", 2.0
    )
    octaves: Annotated[int, Field(ge=1, le=32, strict=True)] = about(
        "Number of steps: the slowest one is held for 2^(octaves - 1) frames. 1: independent frames.",
        "1",
        12,
        default=12,
    )
