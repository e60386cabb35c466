"""YAML as people and strangers write it: read with line numbers, or refused in one line."""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.errors import FileError, did_you_mean
from photosite.files.small import read_small

LARGEST_BYTES = 1 << 22
"""Of a file that is read at all. A protocol that lists 10 000 frames one by one takes an eighth of that."""

_MOST_VALUES = 1_000_000
"""Values in a document with its aliases written out; what looks at every value would not end with many more."""


def read_yaml(file: Path, what: str) -> Any:
    """The content of a YAML file.

    Parameters
    ----------
    file
        The file.
    what
        What it should have been, for messages: "a protocol".

    Raises
    ------
    FileError
        If it cannot be read, is not text in UTF-8, or is not YAML; with the line.
    """
    try:
        return parse_yaml(read_small(file, what, LARGEST_BYTES).decode("utf-8"), file)
    except UnicodeDecodeError:
        raise FileError(file, f"is not {what}: it is not text in UTF-8") from None


def parse_yaml(content: str, path: str | PathLike[str]) -> Any:
    """The content of a YAML text; `path` is what errors call it.

    Raises
    ------
    FileError
        If it is not YAML, nests too deep, or holds too much; with the line where there is one.

    Examples
    --------
    >>> parse_yaml("a: [1, 2", "note.yaml")
    Traceback (most recent call last):
    photosite.errors.FileError: note.yaml:1: is not YAML: expected ',' or ']', but got '<stream end>'
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        data = YAML(typ="rt").load(content)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise FileError(path, f"is not YAML: {error.problem}", line) from None
    except YAMLError as error:
        raise FileError(path, f"is not YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise FileError(path, "nests too deep") from None
    # A tag that its value does not fit (!!set x, !!int y) comes through as whatever the parser stumbles over.
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise FileError(path, f"is not YAML that can be read: {reason}") from None
    _check_size(data, path)
    return data


def _check_size(data: Any, path: str | PathLike[str]) -> None:
    """Refuse whole numbers that no float holds, and aliases that would write out to a billion values."""
    sizes: dict[int, int] = {}

    def size(node: Any) -> int:
        if isinstance(node, Mapping):
            children: list[Any] = [*node.keys(), *node.values()]
        elif isinstance(node, Sequence) and not isinstance(node, str | bytes):
            children = list(node)
        else:
            if isinstance(node, int) and abs(node) > sys.float_info.max:
                raise FileError(path, f"holds a whole number of {node.bit_length()} bits, {hex(node)[:12]}...")
            return 1
        if id(node) not in sizes:
            sizes[id(node)] = 1 + sum(map(size, children))
        return sizes[id(node)]

    try:
        values = size(data)
    except RecursionError:
        raise FileError(path, "nests too deep, or holds itself") from None
    if values > _MOST_VALUES:
        raise FileError(path, f"holds more than {_MOST_VALUES} values once its aliases are written out")


def dump_yaml(data: Mapping[str, Any]) -> str:
    """Fields as YAML, lists on one line, as people write them; `parse_yaml` gives them back.

    Examples
    --------
    >>> dump_yaml({"name": "lens", "relative": [1.0, 0.5]})
    'name: lens\\nrelative: [1.0, 0.5]\\n'
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.comments import CommentedSeq

    def in_flow(node: Any) -> Any:
        if isinstance(node, dict):
            return {key: in_flow(value) for key, value in node.items()}
        if isinstance(node, list | tuple):
            sequence = CommentedSeq([in_flow(value) for value in node])
            sequence.fa.set_flow_style()
            return sequence
        return node

    yaml = YAML()
    yaml.width = 120
    out = io.StringIO()
    yaml.dump(in_flow(dict(data)), out)
    return out.getvalue()


def line_of(node: Any, key: Any) -> int | None:
    """The line, from 1, that an entry of a mapping or list stands on; None where that is not known."""
    positions = getattr(getattr(node, "lc", None), "data", None) or {}
    return positions[key][0] + 1 if key in positions else None


def check_keys(path: str | PathLike[str], data: Mapping[Any, Any], known: Sequence[str], what: str) -> None:
    """Raise `FileError`, with the line, for a key that is not known."""
    for key in data:
        if key not in known:
            name = str(key)[:80]
            raise FileError(path, f"{what} has no key '{name}'. {did_you_mean(name, known)}", line_of(data, key))


def optional_text(path: str | PathLike[str], data: Mapping[Any, Any], key: str) -> str | None:
    """The text under a key, or None.

    Raises
    ------
    FileError
        If something else stands there; with the line.
    """
    value = data.get(key)
    if value is not None and not isinstance(value, str):
        raise FileError(path, f"'{key}' is text, not {value!r:.80}", line_of(data, key))
    return None if value is None else str(value)
