"""Files that the page reads: those of the served folder, and uploads, which a guarded child process reads first."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import warnings
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from photosite.app.places import Part, is_plain
from photosite.color.illuminants import load_illuminant
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.child import ChildError, call_in_child
from photosite.files.hdf5 import open_hdf5
from photosite.frames.io.format_table import SUFFIXES as RAW_SUFFIXES
from photosite.frames.io.formats import read_headers, read_raw
from photosite.optics.io.formats import load_optics
from photosite.scene.io.formats import FORMATS, read_scene
from photosite.sensor.io.sensor_file import load_sensor

FileKind = Literal["scene", "sensor", "lens", "raw", "lamp"]
UploadKind = Literal["scene", "sensor", "lens", "raw", "lamp", "frames"]

SUFFIXES: dict[FileKind, tuple[str, ...]] = {
    "scene": tuple(dict.fromkeys(suffix for kind in FORMATS for suffix in kind.suffixes)),
    "sensor": (".sensor.yaml", ".sensor.yml", ".yaml", ".yml"),
    "lens": (".optics.yaml", ".optics.yml", ".yaml", ".yml"),
    "raw": tuple(sorted(RAW_SUFFIXES)),
    "lamp": (".csv",),
}
"""Names that the page offers and takes, by what the file holds."""

MOST_FRAMES = 5000
"""Frames of an uploaded folder."""
MOST_LISTED = 500
_MOST_DEPTH = 4
_MOST_NAME_BYTES = 100
_CHECK_S, _CHECK_BYTES = 60.0, 4 << 30


class FileEntry(Part):
    """A file of the served folder."""

    name: str
    bytes: int


class Upload(Part):
    """An uploaded file, or a folder of frames with the name of the last one, by the name that states use."""

    name: str
    kind: UploadKind
    file_name: str
    bytes: int
    holds: str


def listed(folder: Path | None, kind: FileKind | Literal["folder"]) -> list[FileEntry]:
    """Return files, or folders, of the served folder.

    Hidden ones, symbolic links, and those whose names cannot be asked for are left out.
    """
    if folder is None:
        return []
    found: list[FileEntry] = []
    root = folder.resolve()
    for place, folders, names in os.walk(root, followlinks=False):
        here = Path(place)
        depth = len(here.relative_to(root).parts)
        folders[:] = sorted(name for name in folders if _is_shown(here / name) and depth < _MOST_DEPTH)
        if kind == "folder":
            found += [FileEntry(name=(here / name).relative_to(root).as_posix(), bytes=0) for name in folders]
        else:
            for name in sorted(names):
                path = here / name
                if name.lower().endswith(SUFFIXES[kind]) and _is_shown(path) and _may_hold(path, kind):
                    size = path.stat().st_size
                    found.append(FileEntry(name=path.relative_to(root).as_posix(), bytes=size))
        if len(found) >= MOST_LISTED:
            break
    return found[:MOST_LISTED]


def _is_shown(path: Path) -> bool:
    return is_plain(path.name) and not path.name.startswith(".") and not path.is_symlink()


_YAML = {"sensor": b"photosite_sensor", "lens": b"photosite_optics"}
_HEAD_BYTES = 1 << 16


def _may_hold(path: Path, kind: FileKind) -> bool:
    """Return whether a path is a file of a kind, as far as its beginning shows it.

    YAML names its format. Frames, maps and noise-free mosaics of photosite are no scenes.
    """
    if path.is_file() and kind == "scene":
        return not _is_frame_or_maps(path)
    if not path.is_file() or kind not in _YAML:
        return path.is_file()
    try:
        with path.open("rb") as file:
            return _YAML[kind] in file.read(_HEAD_BYTES)
    except OSError:
        return False


_OF_FRAMES = (b'{"photosite_frame"', b'{"photosite_clean"')
_TIFF_AND_PNG, _HDF5 = (".tif", ".tiff", ".png"), (".h5", ".hdf5", ".hdf")


def _is_frame_or_maps(path: Path) -> bool:
    """Return whether a file is a raw frame, maps of a chip or a noise-free mosaic that photosite wrote."""
    suffix = path.suffix.lower()
    try:
        if suffix in _TIFF_AND_PNG:
            with path.open("rb") as file:
                head = file.read(_HEAD_BYTES)
            return any(mark in head for mark in _OF_FRAMES)
        if suffix not in _HDF5:
            return False
        with open_hdf5(path) as opened:
            names = set(opened.datasets)
            return "photosite_maps" in opened.file.attrs or names in ({"frame"}, {"clean"})
    except (OSError, FileError):
        return False


async def store(folder: Path, file_name: str, kind: FileKind, content: AsyncIterator[bytes]) -> Path:
    """Write an upload to a new folder.

    Raises
    ------
    InputError
        If its name has no suffix of the kind, or there is no space left.
    """
    name = _plain_name(file_name.replace("\\", "/").rsplit("/", 1)[-1])
    if not name.lower().endswith(SUFFIXES[kind]):
        raise InputError("file name", value=file_name, expected=f"a name that ends in {', '.join(SUFFIXES[kind])}")
    own = folder / secrets.token_hex(8)
    try:
        await _write(own / name, content)
    except BaseException:
        shutil.rmtree(own, ignore_errors=True)
        raise
    return own / name


def _plain_name(name: str) -> str:
    """Return a name without characters of paths, its last `_MOST_NAME_BYTES` in UTF-8: systems count bytes."""
    plain = re.sub(r"[^\w.-]", "_", name).encode("utf-8", "replace")[-_MOST_NAME_BYTES:]
    return plain.decode("utf-8", "ignore").lstrip(".")


async def _write(path: Path, content: AsyncIterator[bytes]) -> None:
    """Write a file, and its folder where it is missing; raise `InputError` for a full disk."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as file:
            async for chunk in content:
                file.write(chunk)
    except OSError as error:
        raise InputError(f"the upload cannot be stored: {error.strerror}", hint="Free space on the disk") from None


@dataclass(frozen=True)
class FrameFolder:
    """A folder that frames are uploaded to, one after the other."""

    path: Path

    @classmethod
    def start(cls, uploads: Path) -> FrameFolder:
        """Return a new folder."""
        return cls(uploads / secrets.token_hex(8))

    @classmethod
    def of(cls, path: Path | None) -> FrameFolder:
        """Return the folder of an earlier upload; raise `InputError` for a file."""
        if path is None or not path.is_dir():
            raise InputError("folder", value=None if path is None else path.name, expected="one of uploaded frames")
        return cls(path)

    async def store(self, name: str, content: AsyncIterator[bytes], most_bytes: int) -> Path:
        """Write a frame, with the folder right above it, to the folder.

        Raises
        ------
        InputError
            If its name has no suffix of frames, a frame of its name is there, or the folder is full.
        """
        parts = [_plain_name(part) for part in name.replace("\\", "/").split("/") if part.strip(".")][-2:]
        if not parts or not parts[-1].lower().endswith(tuple(RAW_SUFFIXES)):
            suffixes = ", ".join(sorted(RAW_SUFFIXES)[:8])
            raise InputError("file name", value=name, expected=f"one of a frame: {suffixes}, ...")
        target = self.path.joinpath(*parts)
        self._check_size(target, most_bytes)
        if target.exists():
            raise InputError("file name", value=name, expected="a name that was not uploaded before")
        created = not self.path.exists()
        try:
            await _write(target, content)
            self._check_size(target, most_bytes)  # frames that arrived meanwhile count too
        except BaseException:
            if created:
                shutil.rmtree(self.path, ignore_errors=True)
            else:
                target.unlink(missing_ok=True)
            raise
        return target

    def sizes(self, new: Path | None = None) -> list[int]:
        """Return the sizes of the frames in bytes, without a new one."""
        return [file.stat().st_size for file in self.path.rglob("*") if file.is_file() and file != new]

    def _check_size(self, new: Path, most_bytes: int) -> None:
        """Raise `InputError` if the folder is full without a new frame."""
        sizes = self.sizes(new)
        if len(sizes) >= MOST_FRAMES or sum(sizes) >= most_bytes:
            hint = "Start photosite serve with the folder"
            raise InputError("the folder is too large to upload", value=f"{len(sizes)} files", hint=hint)


def check_frame(path: Path) -> str:
    """Read a frame in the guarded child process and return its size; delete it if it cannot be read.

    Raises
    ------
    PhotositeError
        As `check_upload`.
    """
    try:
        return str(call_in_child(frame_size, path, time_s=_CHECK_S, memory_bytes=_CHECK_BYTES))
    except ChildError as error:
        path.unlink(missing_ok=True)
        raise FileError(path.name, f"cannot be read: {error}") from None
    except Exception:
        path.unlink(missing_ok=True)
        raise


def frame_size(path: Path) -> str:
    """Read the pixels of a frame, or the first of several in a file, and return their number."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhotositeWarning)
        raw = read_raw(path, index=0) if len(read_headers(path)) > 1 else read_raw(path)
    return f"{raw.shape[0]} x {raw.shape[1]} pixels"


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
        load_illuminant(path)
        return path.name
    try:
        scene = read_scene(path)
    except FileError as error:
        if not error.arguments:
            raise
        scene = read_scene(path, **dict(error.arguments))  # values that the file does not state, as an example
    return f"{scene.shape[0]} x {scene.shape[1]} samples"
