"""Diagnostics in reports: limitations of a result as notices, and what each id means."""

from __future__ import annotations

from collections.abc import Iterable

from photosite.calibration.diagnostics import diagnostic_kinds
from photosite.report.page import Block, Details, Notice, Terms, sentence
from photosite.values.diagnostic import Diagnostic


def notices(diagnostics: Iterable[Diagnostic]) -> tuple[Notice, ...]:
    """Return the limitations of a result, each with its id, which `explanations` explains on the same page.

    Examples
    --------
    >>> notices([Diagnostic("bent-response", "warning", "the response bends by 3 %")])[0].id
    'bent-response'
    """
    limits, known = (entry for entry in diagnostics if entry.severity in ("note", "warning")), diagnostic_kinds()
    return tuple(Notice(sentence(e.text), warning=True, id=e.id if e.id in known else "") for e in limits)


def explanations(diagnostics: Iterable[Diagnostic]) -> tuple[Block, ...]:
    """Return what was seen, what it does to the results and what to do, by id; a page has them once."""
    kinds = diagnostic_kinds()
    found = {entry.id: entry.severity for entry in diagnostics}
    pairs = tuple(
        (name, f"{found[name].capitalize()}. {kinds[name].seen} {kinds[name].effect} {kinds[name].remedy}")
        for name in sorted(found)
        if name in kinds
    )
    return (Details("The diagnostics of this page, and what to do", (Terms(pairs, "diagnostic-"),)),) if pairs else ()
