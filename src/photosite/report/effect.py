"""The registry of figures of effects: files of `report/effects` define one as `FIGURE`, under the effect's name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

from photosite.calibration.result import Calibration
from photosite.report.page import Block
from photosite.values.registry import registered


@dataclass(frozen=True)
class EffectFigure:
    """An effect in the report of a calibration.

    Parameters
    ----------
    section, order
        Section of the report, and place among the effects there.
    blocks
        Returns figure and table, or the reason why they are missing; none where the effect was not looked for.
    """

    section: str
    order: int
    blocks: Callable[[Calibration], tuple[Block, ...]]


@cache
def effect_figures() -> Mapping[str, EffectFigure]:
    """Return the figures of all effects that have one, by the effect's name, in their order.

    Examples
    --------
    >>> effect_figures()["glow"].section
    'Dark current'
    """
    found: dict[str, EffectFigure] = registered("photosite.report.effects", "FIGURE")
    return MappingProxyType(dict(sorted(found.items(), key=lambda entry: entry[1].order)))
