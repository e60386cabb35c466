"""Power failures: what a disk may hold when operations that were not synced are lost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from faults import Case, state


@dataclass
class Node:
    """A file or folder. Of a file, the number of writes to it, and of those that are synced."""

    is_folder: bool = False
    is_old: bool = False
    writes: int = 0
    synced: int = 0
    entries: dict[str, Node] = field(default_factory=dict)


@dataclass(frozen=True)
class Change:
    """A change of names, which the disk holds when the folder `place` is synced."""

    place: str
    remove: str | None
    add: tuple[str, Node] | None


class Disk:
    """Names and files as processes see them, and as the disk holds them."""

    def __init__(self, root: str, old: set[str]) -> None:
        self.root = root
        self.names: dict[str, Node] = {root: Node(is_folder=True)}
        for name in old:
            path = Path(root, name)
            self.names[str(path)] = Node(is_old=True)
            for above in path.parents:
                if str(above).startswith(root):
                    self.names.setdefault(str(above), Node(is_folder=True))
        self.durable = dict(self.names)
        self.pending: list[Change] = []

    def apply(self, line: str) -> None:
        """Do an operation of the shim's log."""
        operation, path, *rest = line.split("\t")
        parent = str(Path(path).parent)
        if operation in ("create", "folder"):
            if path not in self.names:
                self._change(Change(parent, None, (path, Node(is_folder=operation == "folder"))))
        elif operation in ("write", "truncate"):
            if path in self.names:  # else of a file whose name was removed
                self.names[path].writes += 1
        elif operation == "remove":
            if path in self.names:
                self._change(Change(parent, path, None))
        elif operation == "rename":
            (target,) = rest
            self._change(Change(str(Path(target).parent), path, (target, self.names[path])))
        elif operation == "sync" and path in self.names:
            if self.names[path].is_folder:
                for change in [change for change in self.pending if change.place == path]:
                    self.pending.remove(change)
                    self._do(self.durable, change)
            else:
                self.names[path].synced = self.names[path].writes

    def _change(self, change: Change) -> None:
        self._do(self.names, change)
        self.pending.append(change)

    @staticmethod
    def _do(names: dict[str, Node], change: Change) -> None:
        below: dict[str, Node] = {}
        if change.remove is not None:
            start = f"{change.remove}/"
            below = {name: node for name, node in names.items() if name.startswith(start)}
            for name in (*below, change.remove):
                names.pop(name, None)
        if change.add is not None:
            target, node = change.add
            names[target] = node
            for name, entry in below.items():
                names[target + name.removeprefix(str(change.remove))] = entry

    def after_failure(self, most: int) -> Iterator[dict[str, Node]]:
        """Yield what the disk may hold: with none, all, the first or last, one, all but one of the pending changes."""
        numbers = range(len(self.pending))
        kept = {frozenset(numbers[:n]) for n in range(len(numbers) + 1)} | {frozenset(numbers[n:]) for n in numbers}
        kept |= {frozenset({n}) for n in numbers} | {frozenset(numbers) - {n} for n in numbers}
        choices = sorted(kept, key=lambda choice: (len(choice), sorted(choice)))
        for choice in choices[:: -(-len(choices) // most)]:
            names = dict(self.durable)
            for number in sorted(choice):
                change = self.pending[number]
                if change.remove is None or change.remove in names or change.add is None:
                    self._do(names, change)
            yield names


Seen = dict[str, tuple[Node, int]]
"""Visible files by name, each with the number of its writes that the disk holds."""


def failures(case: Case, log: str, root: str, most: int = 60) -> tuple[int, list[str]]:
    """Return the number of states after power failures, `most` for each operation, and what is wrong with them."""
    disk = Disk(root, set(case.old))
    seen: list[tuple[str, Seen]] = []
    for number, line in enumerate(log.splitlines()):
        disk.apply(line)
        for names in disk.after_failure(most):
            files = {name.removeprefix(f"{root}/"): node for name, node in names.items() if not node.is_folder}
            found = {name: (node, node.synced) for name, node in files.items()}
            if not seen or seen[-1][1] != found:
                seen.append((f"operation {number + 1} ({line})", found))
    wrong = []
    for where, found in seen:
        held: dict[str, bytes] = {}
        for name, (node, synced) in found.items():
            complete = not node.is_old and synced == node.writes  # of all writes, until the end of the run
            held[name] = case.old[name] if node.is_old else case.new.get(name, b"") if complete else b"torn"
            if complete and name.endswith(".new"):
                held[name] = case.new.get(name.removesuffix(".new"), b"")
        wrong += [f"power failure after {where}: {text}" for text in state(case, held)]
    return len(seen), wrong
