"""The base of the sections of effects, which answer what sensors, studies and previews ask of any effect."""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple, Self

from photosite.values.validated import Section

Corner = Literal["top_left", "top_right", "bottom_left", "bottom_right"]
"""Corner of the array at which the output amplifier lies."""


class Limits(NamedTuple):
    """What effects have to be consistent with: the sensor's array, well, converter and output."""

    rows: int
    cols: int
    tile: tuple[int, int]
    well_capacity_e: float
    black_level_dn: float
    white_level_dn: float
    output: Corner


class EffectSection(Section):
    """Section of the sensor file of one effect."""

    placed: ClassVar[bool] = False
    """Whether the effect depends on places in the array, or reaches over many pixels: previews are without it."""
    changes_response: ClassVar[bool] = False
    """Whether the effect changes the mean digital number of a charge."""
    of_single_captures: ClassVar[bool] = False
    """Whether sensors with several captures of one exposure cannot have the effect."""

    def check(self, limits: Limits) -> None:
        """Raise `InputError` unless the effect is consistent with the sensor."""

    def nominal(self) -> Self | None:
        """Return what is known of the effect before a measurement."""
        return None

    def with_dark_current(self, ratio: float) -> Self:
        """Return the effect with a dark current that is larger or smaller by a ratio."""
        return self

    @property
    def line_variances(self) -> tuple[float, float]:
        """Variance over pixels of fixed offsets, e-^2, and relative gains, of rows, columns and channels."""
        return 0.0, 0.0
