"""Defective pixels: dead, stuck and hot ones, columns and clusters; drawn from the serial, or listed."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from photosite.errors import InputError
from photosite.sensor.effects.section import EffectSection, Limits
from photosite.sensor.quantity import NO_UNIT, about
from photosite.values.validated import Number, Section

_Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
_Count = Annotated[int, Field(ge=0, strict=True)]
_Place = Annotated[int, Field(ge=0, le=65_535, strict=True)]
DefectName = Literal["dead", "stuck", "hot"]


class ListedDefect(Section):
    """A rectangle of defective pixels.

    Examples
    --------
    >>> column = ListedDefect(kind="dead", rows=(0, 99), cols=(7, 7), value=0.2)
    >>> ListedDefect(kind="stuck", rows=(5, 5), cols=(8, 8)).value is None
    True
    """

    kind: DefectName = about("dead, stuck or hot.", NO_UNIT, "stuck")
    rows: tuple[_Place, _Place] = about("First and last row.", "pixels", [5, 5])
    cols: tuple[_Place, _Place] = about("First and last column.", "pixels", [8, 8])
    value: Annotated[Number, Field(ge=0.0)] | None = about(
        "Of dead pixels the relative response to light, default 0; of stuck ones the digital number, default the white "
        "level; of hot ones the additional dark current in e-/s.",
        "1, DN or e-/s",
        300,
        default=None,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind == "hot" and self.value is None:
            raise InputError("field 'value' is missing", hint="State the dark current of hot pixels in e-/s")
        for name, (first, last) in (("rows", self.rows), ("cols", self.cols)):
            if first > last:
                raise InputError(name, value=(first, last), expected="the first and the last, in this order")
        return self


class PixelDefects(EffectSection):
    """Fractions and numbers of defects that are drawn from the serial, and defects at stated places.

    Examples
    --------
    >>> PixelDefects(dead_fraction=1e-4, dead_columns=1).stuck_fraction
    0.0
    """

    placed = True

    dead_fraction: _Fraction = about("Fraction of the pixels without response to light.", "1", 1e-4, default=0.0)
    stuck_fraction: _Fraction = about(
        "Fraction of the pixels with a constant digital number, any of the converter's.", "1", 1e-5, default=0.0
    )
    dead_columns: _Count = about("Number of columns without response to light.", "1", 1, default=0)
    clusters: _Count = about("Number of clusters of pixels without response to light.", "1", 2, default=0)
    cluster_pixels: Annotated[int, Field(ge=2, le=1000, strict=True)] = about(
        "Pixels of a cluster, those next to its center.", "pixels", 9, default=9
    )
    listed: tuple[ListedDefect, ...] = about(
        "Defects at stated places.", NO_UNIT, [{"kind": "stuck", "rows": [5, 5], "cols": [8, 8]}], default=()
    )

    def check(self, limits: Limits) -> None:
        """Raise `InputError` unless listed defects are on the chip, and there are as many columns as dead ones."""
        if self.dead_columns > limits.cols:
            raise InputError("dead_columns", value=self.dead_columns, expected=f"at most {limits.cols}")
        for number, one in enumerate(self.listed):
            where = f"listed[{number}]."
            for name, (_, last), size in (("rows", one.rows, limits.rows), ("cols", one.cols, limits.cols)):
                if last >= size:
                    raise InputError(where + name, value=last, expected=f"at most {size - 1}")
            if one.kind == "stuck" and one.value is not None and one.value > limits.white_level_dn:
                raise InputError(where + "value", value=one.value, expected=f"at most {limits.white_level_dn:g}")

    def with_dark_current(self, ratio: float) -> Self:
        """Return the defects with a dark current of listed hot pixels that is larger or smaller by a ratio."""
        listed = tuple(
            one.model_copy(update={"value": (one.value or 0.0) * ratio}) if one.kind == "hot" else one
            for one in self.listed
        )
        return self.model_copy(update={"listed": listed})
