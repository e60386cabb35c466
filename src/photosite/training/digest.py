"""What a dataset depends on, as plain values for JSON: settings as they are, arrays and files by their SHA-256."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from photosite.files.small_files import reading


def described(value: Any) -> Any:
    """Return a value's content as plain values; two values with the same content give the same.

    Examples
    --------
    >>> described((1.0, None, np.zeros(2)))
    [1.0, None, {'array': '(2,) float64', 'sha256': '374708fff7719dd5979ec875d56cd2286f6d3cf7ec317a3b25632aab28ec37bb'}]
    """
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        return {"array": f"{array.shape} {array.dtype}", "sha256": hashlib.sha256(array.tobytes()).hexdigest()}
    if isinstance(value, os.PathLike):
        return {"file": str(value), "sha256": sha256_of(Path(value))}
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        entries = {entry.name: described(getattr(value, entry.name)) for entry in dataclasses.fields(value)}
        return {"type": type(value).__name__, **entries}
    if isinstance(value, Mapping):
        return {str(name): described(entry) for name, entry in value.items()}
    if isinstance(value, tuple | list):
        return [described(entry) for entry in value]
    if isinstance(value, partial):
        return {"function": described(value.func), "arguments": described(value.args), **described(value.keywords)}
    if callable(value) and hasattr(value, "__qualname__"):
        return f"{value.__module__}.{value.__qualname__}"
    return repr(value)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file; raise `FileError` if it cannot be read."""
    with reading(path), path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def described_files(entries: Sequence[Any]) -> list[Any]:
    """Return the entries described; a text that is the path of a file stands for the file."""
    return [
        described(Path(entry)) if isinstance(entry, str) and Path(entry).is_file() else described(entry)
        for entry in entries
    ]
