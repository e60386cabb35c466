"""The registry of effects: each file of `calibration/effects` defines one as `EFFECT`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import Literal

from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.values.deferred import Deferred
from photosite.values.registry import registered
from photosite.values.uncertain import Missing

Found = Finding | Missing
Measure = Callable[[Evidence], Found | Deferred[Found]]


@dataclass(frozen=True)
class Effect:
    """A sensor effect that a calibration looks for; its name is that of its file.

    Parameters
    ----------
    order
        Place among the effects: sections of the sensor file are made, and what they would count twice is subtracted,
        in this order.
    measure
        Returns what the evidence shows, or why it shows nothing. A `Deferred` is computed when it is first needed.
    exempt
        Parts that the effect lacks, with the reason: "section" of the sensor file, "drawing" step, "estimator",
        "figure" of the report, "study" with truth and coverage, page of the "docs".
    key, missing
        Name in `Calibration.to_dict`, by default that of the effect, and what stands there without a finding.
    labels
        Label and unit of those estimates, by name, that are no parameters of a calibration, for the terminal.
    """

    order: int
    measure: Measure
    key: str | None = ""
    missing: Literal["null", "reason", "absent"] = "null"
    exempt: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, tuple[str, str]] = field(default_factory=dict)


@cache
def effects() -> Mapping[str, Effect]:
    """Return all effects by name, in their order.

    Examples
    --------
    >>> list(effects())[:2]
    ['line_noise', 'response_curve']
    """
    found: dict[str, Effect] = registered("photosite.calibration.effects", "EFFECT")
    return MappingProxyType(dict(sorted(found.items(), key=lambda entry: entry[1].order)))


class Findings(Mapping[str, Found]):
    """What a calibration finds of each effect, by the effect's name.

    Findings that take long are computed when they are first read.

    Examples
    --------
    >>> Findings({"glow": Missing("the chip is too small")})["glow"].reason
    'the chip is too small'
    """

    def __init__(self, entries: Mapping[str, Found | Deferred[Found]]) -> None:
        self._entries = dict(entries)

    @classmethod
    def measure(cls, evidence: Evidence, known: Mapping[str, Found] = MappingProxyType({})) -> Findings:
        """Return what the evidence shows of each effect; those that are `known` are not measured again."""
        return cls({name: known.get(name) or effect.measure(evidence) for name, effect in effects().items()})

    def __getitem__(self, name: str) -> Found:
        entry = self._entries[name]
        return entry.value if isinstance(entry, Deferred) else entry

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)
