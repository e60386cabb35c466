"""The registry of diagnostics and of the checks that raise them."""

from __future__ import annotations

import json
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from photosite.calibration.parameters import PARAMETER_LABELS, Parameters
from photosite.errors import InputError, did_you_mean
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.registry import registered

Stage = Literal["set", "levels", "channels", "result"]
"""What a check looks at: a frame set before any frame is read; its reduction; the reduction and the channels of the
flat fields; the evidence."""

FOLDERS = "calibration", "frames", "sensor", "metrics"
"""Where kinds of diagnostics are defined."""


@dataclass(frozen=True)
class Check:
    """A check of one stage. Files of `calibration/checks` define them as `CHECKS`.

    Parameters
    ----------
    stage
        When the check runs.
    order
        Place among the checks of its stage, which is that of its diagnostics.
    run
        Called with what the stage has established. It returns diagnostics, or raises a `CalibrationError` that has the
        id of one.
    linear
        Whether the check needs flat fields without a tone curve.
    """

    stage: Stage
    order: int
    run: Callable[..., Iterable[Diagnostic] | None]
    linear: bool = False


@cache
def checks(stage: Stage) -> tuple[Check, ...]:
    """Return the checks of a stage, in their order."""
    found: Iterable[tuple[Check, ...]] = registered("photosite.calibration.checks", "CHECKS").values()
    return tuple(sorted((each for all_ in found for each in all_ if each.stage == stage), key=lambda each: each.order))


def run_checks(stage: Stage, *established: Any, linear: bool = True) -> Iterator[Diagnostic]:
    """Yield the diagnostics of the checks of a stage; `linear` is whether the flat fields have no tone curve.

    Raises
    ------
    CalibrationError
        If the frames cannot support a calibration.
    """
    for check in checks(stage):
        if linear or not check.linear:
            yield from check.run(*established) or ()


@cache
def diagnostic_kinds() -> Mapping[str, DiagnosticKind]:
    """Return all kinds of diagnostics by id, in alphabetical order.

    Examples
    --------
    >>> diagnostic_kinds()["no-flat-fields"].severity
    'warning'
    """
    found: dict[str, DiagnosticKind] = {}
    for name in FOLDERS:
        package = f"photosite.{name}"
        folder = import_module(package)
        for module in pkgutil.walk_packages(folder.__path__, f"{package}."):
            for value in vars(import_module(module.name)).values():
                if isinstance(value, DiagnosticKind) and found.setdefault(value.id, value) is not value:
                    raise AssertionError(f"two kinds of diagnostics have the id {value.id}")
    return MappingProxyType(dict(sorted(found.items())))


def diagnostic_kind(name: str) -> DiagnosticKind:
    """Return a kind of diagnostic by its id.

    Raises
    ------
    InputError
        If no kind has the id.
    """
    kinds = diagnostic_kinds()
    if name not in kinds:
        hint = did_you_mean(name, kinds, "photosite explain lists the ids")
        raise InputError("id", value=name, expected="the id of a diagnostic", hint=hint)
    return kinds[name]


@cache
def _detection() -> dict[str, Any]:
    """Return the result of `photosite reproduce detection --json`."""
    return dict(json.loads(Path(__file__).with_name("detection.json").read_text(encoding="utf-8")))


def detection_entry(kind: DiagnosticKind) -> dict[str, str]:
    """Return which effects of virtual stacks raise a diagnostic, and how many clean ones do, by heading."""
    known, found = _detection(), []
    for each in known["smallest"].get(kind.id, ()):
        tried = "" if each["varied"] else ", no smaller one was tried"
        found.append(f"{each['kind']}, {each['size']}: {each['found']} of {each['stacks']} stacks{tried}")
    entry = {"Smallest found": "; ".join(found)} if found else {}
    if known["clean_stacks"] and kind.severity in ("warning", "left out", "refused"):
        entry["Clean stacks"] = f"{known['alarms'].get(kind.id, 0)} of {known['clean_stacks']} raise it"
    return entry


def collected(
    raised: Iterable[Diagnostic], left_out: Iterable[Diagnostic], parameters: Parameters
) -> tuple[Diagnostic, ...]:
    """Return the diagnostics of a calibration, with the names of the parameters that each concerns.

    Parameters
    ----------
    raised, left_out
        Those of the checks, and of frames that were left out.
    parameters
        The parameters; each reason for missing ones is a diagnostic.
    """
    reasons: dict[tuple[str, str], list[str]] = {}
    for name, entry in parameters.estimates().items():
        if entry.value is None:
            reasons.setdefault((entry.reason_id, entry.reason or ""), []).append(name)
    withheld = (Diagnostic(id, "withheld", text, tuple(names)) for (id, text), names in reasons.items())
    return (*named((*raised, *left_out)), *withheld)


def named(raised: Iterable[Diagnostic]) -> Iterator[Diagnostic]:
    """Yield diagnostics with the names of the parameters that each concerns in place of patterns.

    Examples
    --------
    >>> [found.parameters for found in named([Diagnostic("no-gain", "warning", "", ("system_gain_*",))])]
    [('system_gain_dn_per_e',)]
    """
    for entry in raised:
        kind = DiagnosticKind("", "note", "", "", "", entry.parameters)
        yield replace(entry, parameters=kind.concerns(PARAMETER_LABELS))
