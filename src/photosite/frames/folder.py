"""Frames in a folder: which files are frames, and which patterns make them dark or light."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from photosite.errors import FileError
from photosite.frames.frame_file import FrameFile
from photosite.frames.frame_settings import FrameSettings, Kind
from photosite.frames.io.emva_descriptor import looks_like_descriptor
from photosite.frames.io.read import FORMATS, SUFFIXES

PROTOCOL_NAMES = ("protocol.yaml", "protocol.yml")

KindPatterns = Mapping[Kind, tuple[str, ...]]
"""Glob patterns of the dark and of the light frames."""


def find_listing(folder: Path) -> Path | None:
    """Return the protocol or descriptor of a folder, or None.

    Raises
    ------
    FileError
        If there are several descriptors and no protocol.
    """
    files = _files(folder)
    for name in PROTOCOL_NAMES:
        if folder / name in files:
            return folder / name
    descriptors = [p for p in files if p.suffix.lower() == ".txt" and looks_like_descriptor(p)]
    if len(descriptors) > 1:
        names = ", ".join(p.name for p in descriptors[:3])
        raise FileError(folder, f"the folder has {len(descriptors)} descriptors ({names})", hint="Open one of them")
    return descriptors[0] if descriptors else None


def frame_files_in_folder(folder: Path, patterns: KindPatterns) -> list[FrameFile]:
    """List the frames in a folder, or in its subfolders if it has none itself.

    Raises
    ------
    FileError
        If there are no frames, or a pattern matches none.
    """
    images = [p for p in _files(folder) if p.suffix.lower() in SUFFIXES]
    names: dict[Path, tuple[str, ...]] = {image: (image.stem,) for image in images} or {
        image: (image.stem, image.parent.name) for image in _images_in_subfolders(folder)
    }
    for pattern in (pattern for texts in patterns.values() for pattern in texts):
        if not any(image.match(pattern) for image in names):
            example = next(iter(names)).name
            raise FileError(folder, "pattern", value=pattern, expected=f"one that matches a frame, such as {example}")
    return [
        FrameFile(image, FrameSettings(kind=kind_by_pattern(image, patterns)), names=texts)
        for image, texts in names.items()
    ]


def kind_by_pattern(image: Path, patterns: KindPatterns) -> Kind | None:
    """Return the kind whose patterns match a file, or None.

    Raises
    ------
    FileError
        If patterns of both kinds match.
    """
    matching = [(kind, pattern) for kind, texts in patterns.items() for pattern in texts if image.match(pattern)]
    if len({kind for kind, _ in matching}) > 1:
        both = " and ".join(repr(pattern) for _, pattern in matching)
        raise FileError(image, f"dark and light patterns match the file: {both}", hint="Make the patterns narrower")
    return matching[0][0] if matching else None


def _files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.is_file() and not p.name.startswith("."))


def _images_in_subfolders(folder: Path) -> list[Path]:
    subfolders = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    files = [file for subfolder in subfolders for file in _files(subfolder)]
    listings = [
        p for p in files if p.name in PROTOCOL_NAMES or (p.suffix.lower() == ".txt" and looks_like_descriptor(p))
    ]
    images = [p for p in files if p.suffix.lower() in SUFFIXES]
    if images and not listings:
        return images
    problem = f"the folder has no frames ({FORMATS}), no protocol.yaml and no EMVA 1288 descriptor"
    if listings:
        hint = f"Its subfolder {listings[0].parent.name} is a separate measurement: open that"
        raise FileError(folder, problem, hint=hint)
    if subfolders:
        problem += f"; its subfolders ({', '.join(p.name for p in subfolders)}) have none either"
    raise FileError(folder, problem)
