"""What can be wrong with data: a kind of problem with its explanation, and one case of it with its size."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, Literal

from photosite.errors import CalibrationError
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing

Severity = Literal["note", "warning", "left out", "withheld", "refused"]
"""A remark; a limitation of the results; a frame or level that was not used; a parameter without a value; no result."""


@dataclass(frozen=True)
class Diagnostic(Shown):
    """One case of something that is wrong with data.

    Parameters
    ----------
    id
        The kind (`DiagnosticKind`); `photosite explain ID` prints its entry.
    severity
        What follows from it.
    text
        What was seen, what it means for the results, and what to do.
    parameters
        The parameters that it concerns.
    size
        Size of the effect, in the unit that the kind states; None where there is none.
    remedy
        What to do about problems of this kind.

    Examples
    --------
    >>> Diagnostic("no-flats", "warning", "no light frames").severity
    'warning'
    """

    id: str
    severity: Severity
    text: str
    parameters: tuple[str, ...] = ()
    size: float | None = None
    remedy: str = ""

    def __str__(self) -> str:
        return self.text

    def within(self, where: str) -> Diagnostic:
        """Return the diagnostic with a place in front of its text.

        Examples
        --------
        >>> Diagnostic("no-flats", "warning", "no light frames").within("gain setting 100").text
        'gain setting 100: no light frames'
        """
        return replace(self, text=f"{where}: {self.text}")

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, for JSON."""
        return {**vars(self), "parameters": list(self.parameters)}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Diagnostic:
        """Return the diagnostic of the fields that `to_dict` returns."""
        return cls(**{**fields, "parameters": tuple(fields["parameters"])})


def texts(diagnostics: Iterable[Diagnostic], *severities: Severity) -> tuple[str, ...]:
    """Return the texts of the diagnostics of some severities.

    Examples
    --------
    >>> texts([Diagnostic("no-flats", "warning", "no light frames")], "warning")
    ('no light frames',)
    """
    return tuple(entry.text for entry in diagnostics if entry.severity in severities)


class Diagnosed:
    """Base of results that have diagnostics."""

    __slots__ = ()
    diagnostics: tuple[Diagnostic, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Texts of the diagnostics that limit the result."""
        return texts(self.diagnostics, "note", "warning")


def one_in(p_value: float) -> str:
    """Return a small probability in words.

    Examples
    --------
    >>> one_in(5e-4), one_in(1e-4)
    ('1 of 2000', '1 of 10 000')
    """
    count = round(1.0 / p_value)
    return f"1 of {count}" if count < 10_000 else f"1 of {count:,}".replace(",", " ")


@dataclass(frozen=True)
class DiagnosticKind(Shown):
    """An entry of the registry of diagnostics. Called with a text, it returns a `Diagnostic`.

    Parameters
    ----------
    id, severity
        As in `Diagnostic`.
    seen, effect, remedy
        What the data show; what it does to which figures; what to do.
    parameters
        Names of the parameters that it concerns, with `*` for any end or beginning.
    size
        What `Diagnostic.size` is, with its unit.
    false_alarms
        How often clean data raise it.

    Examples
    --------
    >>> kind = DiagnosticKind("no-flats", "warning", "No flat fields.", "No gain.", "Take some.", ("prnu_*",))
    >>> kind("no light frames").id, kind.missing("no light frames").id
    ('no-flats', 'no-flats')
    """

    id: str
    severity: Severity
    seen: str
    effect: str
    remedy: str
    parameters: tuple[str, ...] = ()
    size: str = ""
    false_alarms: str = ""

    def __call__(self, text: str, size: float | None = None, parameters: Iterable[str] | None = None) -> Diagnostic:
        """Return a case of this kind; `parameters` are those of the kind by default."""
        concerned = self.parameters if parameters is None else tuple(parameters)
        return Diagnostic(self.id, self.severity, text, concerned, size, self.remedy)

    def missing(self, reason: str) -> Missing:
        """Return a missing value with this kind as its reason."""
        return Missing(reason, self.id)

    def error(self, what: str, **fields: Any) -> CalibrationError:
        """Return the error that refuses a result; `fields` are those of the exception."""
        return CalibrationError(what, id=self.id, **fields)

    @property
    def entry(self) -> dict[str, str]:
        """What is known of the kind, by heading, for `photosite explain` and the documentation."""
        parts = {
            "Seen": self.seen,
            "Effect": self.effect,
            "What to do": self.remedy,
            "Size": self.size,
            "False alarms": self.false_alarms,
        }
        return {heading: text for heading, text in parts.items() if text}

    def concerns(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return those of some parameters that problems of this kind concern.

        Examples
        --------
        >>> kind = DiagnosticKind("no-flats", "warning", "", "", "", ("prnu_*",))
        >>> kind.concerns(["dsnu_e", "prnu_percent"])
        ('prnu_percent',)
        """
        return tuple(name for name in names if any(fnmatchcase(name, pattern) for pattern in self.parameters))
