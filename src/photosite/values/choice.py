"""Values that are one of a few."""

from __future__ import annotations

from typing import Any, get_args

from photosite.errors import InputError, did_you_mean


def check_choice(name: str, value: object, choices: Any) -> None:
    """Raise `InputError` unless a value is one of a `Literal`'s.

    Examples
    --------
    >>> from typing import Literal
    >>> check_choice("waveform", "sin", Literal["sine", "square"])
    Traceback (most recent call last):
    photosite.errors.InputError: waveform must be 'sine' or 'square', got 'sin'. Did you mean 'sine'?
    """
    known = get_args(choices)
    if value not in known:
        hint = did_you_mean(str(value), map(str, known))
        raise InputError(name, value=value, expected=" or ".join(map(repr, known)), hint=hint)
