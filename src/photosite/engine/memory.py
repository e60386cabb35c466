"""The memory that this process may still take: that of the machine, or of the container that it runs in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple


class AvailableMemory(NamedTuple):
    """Memory that can be taken, in bytes, and whether a container's limit is the reason that it is no more."""

    size: int
    of_container: bool


def available_memory(root: Path = Path("/")) -> AvailableMemory | None:
    """Return the memory that can be taken, without swap; None where the system does not tell (not Linux).

    It is `MemAvailable` of /proc/meminfo, or what the limits of control groups (versions 1 and 2) leave: of this
    process's group and of the groups above. Cached file pages count as free, because the system drops them first.

    Parameters
    ----------
    root
        The folder with proc and sys, for tests.
    """
    machine = _first_numbers(root / "proc/meminfo").get("MemAvailable:")
    if machine is None:
        return None
    limited = min(_left_in_groups(root), default=None)
    if limited is None or limited >= 1024 * machine:
        return AvailableMemory(1024 * machine, of_container=False)
    return AvailableMemory(max(limited, 0), of_container=True)


def _left_in_groups(root: Path) -> Iterator[int]:
    """Yield what the limit of each control group leaves, in bytes."""
    for line in _lines(root / "proc/self/cgroup"):
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        top = root / "sys/fs/cgroup" / ("memory" if controllers else "")
        names = ("limit_in_bytes", "usage_in_bytes", "total_") if controllers else ("max", "current", "")
        # In a container the path may be that of the host, of which the folder shows the end only.
        parts = [part for part in path.split("/") if part]
        for count in range(len(parts) + 1):
            group = top.joinpath(*parts[:count])
            limit, usage = (_number(group / f"memory.{name}") for name in names[:2])
            if limit is not None and usage is not None:
                cached = _first_numbers(group / "memory.stat")
                yield limit - usage + sum(cached.get(f"{names[2]}{which}_file", 0) for which in ("active", "inactive"))


def _lines(path: Path) -> list[str]:
    with suppress(OSError, ValueError):
        return path.read_text().splitlines()
    return []


def _number(path: Path) -> int | None:
    """Return the number that a file holds; None without one, as where there is no limit."""
    lines = _lines(path)
    return int(lines[0]) if lines and lines[0].isdecimal() else None


def _first_numbers(path: Path) -> dict[str, int]:
    """Return the number after the name of each line."""
    words = (line.split() for line in _lines(path))
    return {line[0]: int(line[1]) for line in words if len(line) > 1 and line[1].isdecimal()}


KILLED = "killed by the system, usually for lack of memory"
"""How a process ended that no other process of photosite ended by SIGKILL."""


def how_it_ended(exit_code: int) -> str:
    """Return how a process ended, from the exit code of `multiprocessing` or `subprocess`.

    Examples
    --------
    >>> how_it_ended(-9), how_it_ended(-11), how_it_ended(3)
    ('killed by the system, usually for lack of memory', 'signal 11', 'exit status 3')
    """
    if exit_code == -_SIGKILL:
        return KILLED
    return f"signal {-exit_code}" if exit_code < 0 else f"exit status {exit_code}"


_SIGKILL = 9
