"""Smallest effects that calibrations find in 95 of 100 stacks, and false alarms of clean stacks, by diagnostic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from photosite.studies.imperfect_stacks import KINDS, StackKind, calibrate_stack

FOUND = 0.95
"""Fraction of the stacks in which an effect must be found."""

HALVINGS, BISECTIONS = 8, 3
"""Most halvings of the size; bisections of the last one, which leave a step of 9 %."""

COMMAND = "photosite reproduce detection"

Progress = Callable[[str, float], None]
"""Called with a kind and the size that is tried."""


@dataclass(frozen=True)
class Smallest:
    """Smallest size at which a diagnostic is raised in 95 of 100 stacks.

    Parameters
    ----------
    diagnostic, kind
        Id, and kind of stack.
    size
        The size in words; that of the kind where it cannot be varied.
    found, stacks
        Number of stacks in which it was found, and of all of this size.
    varied
        Whether smaller sizes were tried.
    """

    diagnostic: str
    kind: str
    size: str
    found: int
    stacks: int
    varied: bool

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, for JSON."""
        return {name: value for name, value in vars(self).items() if name != "diagnostic"}


def count_found(kind: StackKind, seeds: Sequence[int], *, stop: bool = True) -> int:
    """Return in how many stacks the diagnostic of a kind is raised; with `stop`, only until too few can be."""
    missed = 0
    for seed in seeds:
        missed += not calibrate_stack(kind, seed).found
        if stop and missed > (1.0 - FOUND) * len(seeds) + 1e-9:
            break
    return len(seeds) - missed


def smallest_found(kind: StackKind, seeds: Sequence[int], progress: Progress | None = None) -> Smallest:
    """Halve the size of a kind until it is found in fewer stacks, and bisect the last step in equal ratios."""

    def count(amount: float) -> int:
        if progress is not None:
            progress(kind.name, amount)
        return count_found(kind.at(amount), seeds)

    result = partial(Smallest, kind.diagnostic or "", kind.name)
    if kind.amount is None:
        return result(kind.text, count_found(kind, seeds, stop=False), len(seeds), varied=False)
    enough = FOUND * len(seeds) - 1e-9
    best, found, low = kind.amount, count(kind.amount), 0.0
    if found < enough:
        return result(kind.text, count_found(kind, seeds, stop=False), len(seeds), varied=False)
    for _ in range(HALVINGS):
        if (number := count(0.5 * best)) < enough:
            low = 0.5 * best
            break
        best, found = 0.5 * best, number
    for _ in range(BISECTIONS if low else 0):
        middle = (low * best) ** 0.5
        if (number := count(middle)) < enough:
            low = middle
        else:
            best, found = middle, number
    return result(kind.at(best).text, found, len(seeds), varied=True)


def detection_study(
    stacks: int = 20, clean: int = 100, kinds: Sequence[StackKind] = KINDS, progress: Progress | None = None
) -> dict[str, Any]:
    """Return the smallest sizes by diagnostic, and the alarms of clean stacks, as stored in `detection.json`.

    Parameters
    ----------
    stacks, clean
        Stacks of each size, and clean ones of each of the two kinds.
    kinds
        Kinds of stacks.
    progress
        Called before each size.
    """
    alarms: Counter[str] = Counter()
    sound = [kind for kind in kinds if kind.name.startswith("clean")]
    for kind in sound:
        if progress is not None:
            progress(kind.name, 0.0)
        alarms.update(name for seed in range(clean) for name in _alarms(kind, seed))
    smallest: dict[str, list[dict[str, Any]]] = {}
    for kind in kinds:
        if kind.diagnostic is not None and not kind.name.startswith("clean"):
            found = smallest_found(kind, range(stacks), progress)
            smallest.setdefault(found.diagnostic, []).append(found.to_dict())
    return {"command": COMMAND, "clean_stacks": clean * len(sound), "alarms": dict(alarms), "smallest": smallest}


def _alarms(kind: StackKind, seed: int) -> Iterator[str]:
    answer = calibrate_stack(kind, seed)
    yield from {entry.id for entry in answer.diagnostics if entry.severity != "withheld"} - {kind.diagnostic}
