"""YAML of unknown origin, read with line numbers and limits on size and nesting, and validated by Pydantic."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from photosite.errors import FileError, did_you_mean, message_of
from photosite.files.small_files import read_small
from photosite.values.validated import input_error

LARGEST_BYTES = 1 << 22
"""Size limit of a file; a protocol that lists 10 000 frames one by one takes an eighth of it."""

_MOST_VALUES = 1_000_000
"""Limit of values in a document, aliases expanded."""


_DEEPEST = 200
"""Limit of open brackets."""

FILE_KINDS = {
    "photosite_sensor": "a sensor file",
    "photosite_optics": "an optics file",
    "photosite_lens_design": "an index of PSF files",
    "photosite_camera": "a camera file",
    "photosite_protocol": "a protocol of dark frames and flat fields",
    "photosite_spectral": "a spectral protocol",
    "photosite_sweep": "a sweep file",
    "photosite_limits": "a file of limits",
    "photosite_photographs": "a list of photographs",
    "photosite_entry": "a contributed camera",
    "photosite_camera_index": "an index of contributed cameras",
}
"""photosite's own YAML files, by the key that holds the version of the format."""


def read_yaml(file: Path, what: str) -> Any:
    """Read a YAML file; `what` names the expected content in messages, such as "a protocol"."""
    return parse_yaml(read_text(file, what), file)


def read_text(file: Path, what: str) -> str:
    """Read the text of a YAML file."""
    try:
        return read_small(file, what, LARGEST_BYTES).decode("utf-8")
    except UnicodeDecodeError:
        raise FileError(file, f"is not {what}: it is not text in UTF-8") from None


def check_version(path: str | PathLike[str], data: Any, key: str) -> None:
    """Raise `FileError` unless the content has a key of `FILE_KINDS` with the version 1.

    Examples
    --------
    >>> check_version("mine.yaml", {"photosite_sensor": 1}, "photosite_camera")
    Traceback (most recent call last):
    photosite.errors.FileError: mine.yaml: is a sensor file, not a camera file
    """
    fields = data if isinstance(data, Mapping) else {}
    if key in fields:
        if (version := fields[key]) != 1 or isinstance(version, bool):
            expected = "1, the version of the file format"
            raise FileError(path, key, line_of(data, key), value=version, expected=expected)
        return
    if other := next((kind for name, kind in FILE_KINDS.items() if name in fields), None):
        raise FileError(path, f"is {other}, not {FILE_KINDS[key]}")
    raise FileError(path, f"is not {FILE_KINDS[key]}", hint=f"Begin it with '{key}: 1'")


def parse_yaml(content: str, path: str | PathLike[str], *, keep_quotes: bool = False) -> Any:
    """Parse YAML text; `path` names it in errors, `keep_quotes` keeps the quotes of texts for writing.

    Examples
    --------
    >>> parse_yaml("a: [1, 2", "note.yaml")
    Traceback (most recent call last):
    photosite.errors.FileError: note.yaml:1: is not YAML: expected ',' or ']', but got '<stream end>'
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    depth = 0
    for bracket in re.finditer(r"[\[\]{}]", content):  # ruamel's scanner takes seconds for a thousand open brackets
        depth += 1 if bracket[0] in "[{" else -1
        if depth > _DEEPEST:
            raise FileError(path, "nests too deeply")
    try:
        yaml = YAML(typ="rt")
        yaml.preserve_quotes = keep_quotes
        data = yaml.load(content)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise FileError(path, f"is not YAML: {error.problem}", line) from None
    except YAMLError as error:
        raise FileError(path, f"is not YAML: {message_of(error)}") from None
    except RecursionError:
        raise FileError(path, "nests too deeply") from None
    except Exception as error:  # invalid tags (!!set x, !!int y) raise exceptions of many kinds
        raise FileError(path, f"is not valid YAML: {message_of(error)}") from None
    _check_size(data, path)
    return data


def _check_size(data: Any, path: str | PathLike[str]) -> None:
    """Reject integers beyond the range of floats, and aliases that expand to millions of values."""
    sizes: dict[int, int] = {}

    def size(node: Any) -> int:
        if isinstance(node, Mapping):
            children: list[Any] = [*node.keys(), *node.values()]
        elif isinstance(node, Sequence) and not isinstance(node, str | bytes):
            children = list(node)
        else:
            if isinstance(node, int) and abs(node) > sys.float_info.max:
                raise FileError(path, f"has an integer of {node.bit_length()} bits, {hex(node)[:12]}...")
            return 1
        if id(node) not in sizes:
            sizes[id(node)] = 1 + sum(map(size, children))
        return sizes[id(node)]

    try:
        values = size(data)
    except RecursionError:
        raise FileError(path, "nests too deeply, or contains itself") from None
    if values > _MOST_VALUES:
        raise FileError(path, f"has more than {_MOST_VALUES} values with its aliases expanded")


def dump_yaml(data: Mapping[str, Any], width: int = 120) -> str:
    """Return fields as YAML with lists on one line; a list of mappings has a line for each.

    Examples
    --------
    >>> print(dump_yaml({"name": "lens", "relative": [1.0, 0.5], "parts": [{"f": 1}, {"f": 2}]}))
    name: lens
    relative: [1.0, 0.5]
    parts:
    - {f: 1}
    - {f: 2}
    <BLANKLINE>
    """
    return _dumped(_styled(dict(data)), width)


def _dumped(document: Any, width: int) -> str:
    from ruamel.yaml import YAML

    yaml = YAML()
    yaml.width = width
    yaml.preserve_quotes = True
    out = io.StringIO()
    yaml.dump(document, out)
    return out.getvalue()


def _styled(node: Any, flow: bool = False) -> Any:
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    def in_flow(node: Any) -> Any:
        node.fa.set_flow_style()
        return node

    if isinstance(node, dict):
        mapping = CommentedMap({key: _styled(value, flow) for key, value in node.items()})
        return in_flow(mapping) if flow else mapping
    if isinstance(node, list | tuple):
        holds_mappings = not flow and len(node) > 0 and all(isinstance(value, dict) for value in node)
        sequence = CommentedSeq([_styled(value, True) for value in node])
        return sequence if holds_mappings else in_flow(sequence)
    return node


def rewrite_yaml(content: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Return YAML text with the fields that differ between two versions of its data; comments and other fields stay.

    Parameters
    ----------
    content
        The text.
    old, new
        The data of the text, and the data to write, both in the same form. The text may state a field in another form.

    Examples
    --------
    >>> print(rewrite_yaml("a: 1.50 # measured\\nb: 2\\n", {"a": 1.5, "b": 2}, {"a": 1.5, "b": 3, "c": [4]}))
    a: 1.50 # measured
    b: 3
    c: [4]
    <BLANKLINE>
    """

    def edit(node: Any, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
        for key in [key for key in old if key not in new and key in node]:
            del node[key]
        for key, value in new.items():
            before = old.get(key)
            if value == before and type(value) is type(before):
                continue
            parts = value, before, node.get(key)
            if all(isinstance(part, Mapping) for part in parts) and "value" not in value:
                edit(node[key], before, value)  # type: ignore[arg-type]
            else:
                entry = _styled(value, flow=isinstance(value, Mapping) and "value" in value)
                if key in node:
                    node[key] = entry
                else:  # before the last one if that has a comment, which may be the end of the section
                    node.insert(len(node) - (list(node)[-1] in node.ca.items if node else 0), key, entry)

    document = parse_yaml(content, "the text", keep_quotes=True)
    edit(document, old, new)
    return _dumped(document, width=1 << 20)


def line_of(node: Any, key: Any) -> int | None:
    """Return the line, counted from 1, of an entry of a mapping or list; None where unknown."""
    positions = getattr(getattr(node, "lc", None), "data", None) or {}
    return positions[key][0] + 1 if key in positions else None


def check_keys(path: str | PathLike[str], data: Mapping[Any, Any], known: Sequence[str], what: str) -> None:
    """Raise `FileError` with the line for an unknown key."""
    for key in data:
        if key not in known:
            name = str(key)[:80]
            hint = did_you_mean(name, known)
            raise FileError(path, f"{what} has no key '{name}'", line_of(data, key), hint=hint)


def optional_text(path: str | PathLike[str], data: Mapping[Any, Any], key: str) -> str | None:
    """Return the text under a key, or None."""
    value = data.get(key)
    if value is not None and not isinstance(value, str):
        raise FileError(path, key, line_of(data, key), value=value, expected="text")
    return None if value is None else str(value)


def validated(kind: Any, data: Any, path: str | PathLike[str], section: str = "", context: Any = None) -> Any:
    """Return the value of a type that the fields describe.

    Parameters
    ----------
    kind
        A Pydantic model, or another type that Pydantic validates.
    data
        The fields, as `read_yaml` returns them.
    path
        The file, for messages.
    section
        Section of the file that the fields are in; empty for the top level.
    context
        What the validators of the type need, see Pydantic's `ValidationInfo`.

    Raises
    ------
    FileError
        If the fields are invalid; with the line of the deepest part of the location that the file has.
    """
    try:
        return TypeAdapter(kind).validate_python(data, context=context)
    except ValidationError as error:
        found, location = input_error(error), error.errors()[0]["loc"]
    inner = found.where.split(".") if found.where and not location else ()
    line = line_at(data, (*location, *inner, found.what.partition("[")[0]))
    if line is None and section:
        line = data.lc.line + 1 if hasattr(data, "lc") else None
    where = ".".join(part for part in (section, found.where) if part) or None
    raise FileError(path, found.what, line, **found.fields | {"where": where}) from None


def line_at(data: Any, location: Sequence[str | int]) -> int | None:
    """Return the line of the deepest part of the location that the file has."""
    line: int | None = None
    for part in location:
        if (found := line_of(data, part)) is None:
            break
        line, data = found, data[part]
    return line
