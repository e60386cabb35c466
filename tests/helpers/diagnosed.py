"""Diagnostics that limit a result: what its `warnings` are the texts of."""

from typing import Any


def limits(result: Any) -> dict[str, float | None]:
    """Return the size of each note and warning of a result, by its id."""
    return {entry.id: entry.size for entry in result.diagnostics if entry.severity in ("note", "warning")}
