"""Files that the page reads: those of the served folder, and uploads, which a guarded child process reads first."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Literal

from photosite.app.state import Part
from photosite.errors import FileError, InputError
from photosite.files.child import ChildError, call_in_child
from photosite.frames.io.formats import SUFFIXES as RAW_SUFFIXES
from photosite.frames.io.formats import read_raw
from photosite.optics.io.formats import load_optics
from photosite.scene.io.formats import FORMATS, read_scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.validation.lamp import read_lamp

FileKind = Literal["scene", "sensor", "lens", "raw", "lamp"]

SUFFIXES: dict[FileKind, tuple[str, ...]] = {
    "scene": tuple(dict.fromkeys(suffix for kind in FORMATS for suffix in kind.suffixes)),
    "sensor": (".sensor.yaml", ".sensor.yml", ".yaml", ".yml"),
    "lens": (".optics.yaml", ".optics.yml", ".yaml", ".yml"),
    "raw": tuple(sorted(RAW_SUFFIXES)),
    "lamp": (".csv",),
}
"""Names that the page offers and takes, by what the file holds."""

MOST_LISTED = 500
_MOST_DEPTH = 4
_CHECK_S, _CHECK_BYTES = 60.0, 4 << 30


class FileEntry(Part):
    """A file of the served folder."""

    name: str
    bytes: int


class Upload(Part):
    """An uploaded file, by the name that states use."""

    name: str
    file_name: str
    bytes: int
    holds: str


def listed(folder: Path | None, kind: FileKind | Literal["folder"]) -> list[FileEntry]:
    """Return files, or folders, of the served folder; hidden ones and symbolic links are left out."""
    if folder is None:
        return []
    found: list[FileEntry] = []
    root = folder.resolve()
    for place, folders, names in os.walk(root, followlinks=False):
        here = Path(place)
        depth = len(here.relative_to(root).parts)
        folders[:] = sorted(name for name in folders if not name.startswith(".") and depth < _MOST_DEPTH)
        if kind == "folder":
            found += [FileEntry(name=(here / name).relative_to(root).as_posix(), bytes=0) for name in folders]
        else:
            for name in sorted(names):
                path = here / name
                if name.lower().endswith(SUFFIXES[kind]) and not name.startswith(".") and not path.is_symlink():
                    size = path.stat().st_size
                    found.append(FileEntry(name=path.relative_to(root).as_posix(), bytes=size))
        if len(found) >= MOST_LISTED:
            break
    return found[:MOST_LISTED]


async def store(folder: Path, file_name: str, kind: FileKind, content: AsyncIterator[bytes]) -> Path:
    """Write an upload to a new folder.

    Raises
    ------
    InputError
        If its name has no suffix of the kind, or there is no space left.
    """
    name = re.sub(r"[^\w.-]", "_", file_name.replace("\\", "/").rsplit("/", 1)[-1])[-100:].lstrip(".")
    if not name.lower().endswith(SUFFIXES[kind]):
        raise InputError("file name", value=file_name, expected=f"a name that ends in {', '.join(SUFFIXES[kind])}")
    own = folder / secrets.token_hex(8)
    try:
        own.mkdir(parents=True)
        with (own / name).open("xb") as file:
            async for chunk in content:
                file.write(chunk)
    except OSError as error:
        shutil.rmtree(own, ignore_errors=True)
        raise InputError(f"the upload cannot be stored: {error.strerror}", hint="Free space on the disk") from None
    except BaseException:
        shutil.rmtree(own, ignore_errors=True)
        raise
    return own / name


def check_upload(path: Path, kind: FileKind) -> str:
    """Read an upload in the guarded child process and return what it holds; delete it if it cannot be read.

    Raises
    ------
    PhotositeError
        If the file is invalid, or reading it crashes or takes too long or too much memory.
    """
    try:
        return str(call_in_child(content_of, path, kind, time_s=_CHECK_S, memory_bytes=_CHECK_BYTES))
    except ChildError as error:
        shutil.rmtree(path.parent, ignore_errors=True)
        raise FileError(path.name, f"cannot be read: {error}") from None
    except Exception:
        shutil.rmtree(path.parent, ignore_errors=True)
        raise


def content_of(path: Path, kind: FileKind) -> str:
    """Return what a file holds, in a few words."""
    if kind == "sensor":
        sensor = load_sensor(path)
        if sensor.maps is not None:
            hint = "Put both files into the served folder"
            raise InputError("an uploaded sensor file cannot name maps", hint=hint)
        return sensor.name
    if kind == "lens":
        return type(load_optics(path)).__name__
    if kind == "raw":
        rows, cols = read_raw(path).shape
        return f"{rows} x {cols} pixels"
    if kind == "lamp":
        return read_lamp(path).name
    try:
        scene = read_scene(path)
    except FileError as error:
        if not error.arguments:
            raise
        scene = read_scene(path, **dict(error.arguments))  # values that the file does not state, as an example
    return f"{scene.shape[0]} x {scene.shape[1]} samples"
