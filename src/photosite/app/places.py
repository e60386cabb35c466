"""Names of files in requests: of the served folder, uploaded, or of results; and the base of all requests."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from photosite.errors import InputError

FILE, UPLOAD, RESULT = "file:", "upload:", "result:"
"""Prefixes of names that are not built in: a file of the served folder, an uploaded one, and a file of a result."""

Text = Annotated[str, Field(max_length=400)]


class Part(BaseModel):
    """A part of the state; unknown fields are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Places(Part):
    """Where the names of files in a state are on disk, and the folder for the files of results."""

    folder: Path | None = None
    uploads: dict[str, Path] = {}
    results: Path | None = None

    def path(self, name: str) -> Path | None:
        """Return the path of `file:NAME`, `upload:ID` or `result:ID/NAME`; None for any other name.

        Raises
        ------
        InputError
            If the name leaves the served folder or that of the results, or there is no such file.
        """
        if name.startswith(UPLOAD):
            found = self.uploads.get(name.removeprefix(UPLOAD))
            if found is None:
                raise InputError("upload", value=name, expected="a file that was uploaded", hint="Upload it again")
            return found
        if name.startswith(RESULT):
            part = re.fullmatch(r"([0-9a-f]{16})/(\w[\w.-]{0,99})", name.removeprefix(RESULT))
            if part is None or self.results is None or not (file := self.results / part[1] / part[2]).is_file():
                raise InputError(
                    "result", value=name, expected="a file of a result that is kept", hint="Compute it again"
                )
            return file
        return inside(self.folder, name.removeprefix(FILE)) if name.startswith(FILE) else None


def inside(folder: Path | None, name: str) -> Path:
    """Return the path of a file or folder in the served folder.

    Parameters
    ----------
    folder
        The served folder.
    name
        A relative path with forward slashes.

    Raises
    ------
    InputError
        If nothing is served, the name is absolute or contains "..", a backslash, a colon or a control character, or
        the file does not exist or lies outside the folder, symbolic links followed.

    Examples
    --------
    >>> inside(Path("/data"), "../etc/passwd")
    Traceback (most recent call last):
    photosite.errors.InputError: file must be a relative path inside the served folder, got '../etc/passwd'
    """
    expected = "a relative path inside the served folder"
    if folder is None:
        raise InputError("no folder is served", hint="Start photosite serve with a folder")
    parts = name.split("/")
    if not all(is_plain(part) for part in parts):
        raise InputError("file", value=name, expected=expected)
    root = folder.resolve()
    try:
        found = root.joinpath(*parts).resolve(strict=True)
    except (OSError, RuntimeError, ValueError):
        raise InputError("file", value=name, expected="an existing file of the served folder") from None
    if not found.is_relative_to(root):
        raise InputError("file", value=name, expected=expected)
    return found


def is_plain(part: str) -> bool:
    """Return whether a file or folder of this name can be asked for: Unicode text, without characters of paths.

    Examples
    --------
    >>> is_plain("shot 1.dng"), is_plain(".."), is_plain("a\\nb.dng"), is_plain("\\udcff.dng")
    (True, False, False, False)
    """
    if part in ("", ".", ".."):
        return False
    return not any(c in '\\:%~*?<>|"/' or ord(c) < 32 or "\ud800" <= c <= "\udfff" for c in part)
