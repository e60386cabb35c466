"""Where cameras are found: files that users have, and the places where other programs install theirs."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from photosite.errors import FileError, PhotositeWarning
from photosite.files.small_files import read_json_object
from photosite.frames.camera_names import full_name, name_words
from photosite.frames.io.darktable import DarktableCamera, darktable_cameras
from photosite.library.entry import ENTRY_NAME, INDEX_NAME, LoadedEntry, entry_in_folder, read_index, sha256_of
from photosite.library.spectra import SpectralFile, csv_camera, rawtoaces_camera
from photosite.values.shown import Shown

VARIABLE = "PHOTOSITE_PROFILES"
"""Environment variable with files and folders, separated as in PATH."""

DARKTABLE_LICENSE = "not stated (the file that darktable installs: GPL-3.0-or-later)"
NOT_STATED = "not stated"

LOOKED_FOR = (
    f"neither JSON files of darktable or rawtoaces, nor CSV files, an index ({INDEX_NAME}) or an entry ({ENTRY_NAME})"
)
"""What was not found in a folder without cameras."""

Profiles = str | PathLike[str] | Sequence[str | PathLike[str]] | None
Kind = Literal["noise profile", "spectral sensitivity", "contributed"]

_DARKTABLE_FOLDERS = (
    *("/usr/share/darktable", "/usr/local/share/darktable", "/opt/darktable/share/darktable", "~/.config/darktable"),
    *("/Applications/darktable.app/Contents/Resources/share/darktable", "C:/Program Files/darktable/share/darktable"),
    "/var/lib/flatpak/app/org.darktable.Darktable/current/active/files/share/darktable",
)
_RAWTOACES_FOLDERS = (
    "/usr/local/share/rawtoaces/data",
    "/usr/share/rawtoaces/data",
    "/usr/local/include/rawtoaces/data",
)
_RAWTOACES_VARIABLES = ("RAWTOACES_DATA_PATH", "AMPAS_DATA_PATH")
_MOST_FILES = 10_000


@dataclass(frozen=True)
class CameraSource(Shown):
    """One file's entry of a camera.

    Parameters
    ----------
    name
        Maker and model, the maker once.
    kind
        "noise profile" (darktable), "spectral sensitivity" (rawtoaces, CSV) or "contributed" (photosite).
    path, license, provenance
        The file; the license and origin that it states.
    content
        `DarktableCamera`, `SpectralFile` or `LoadedEntry`.
    """

    name: str
    kind: Kind
    path: Path
    license: str
    provenance: str
    content: DarktableCamera | SpectralFile | LoadedEntry

    @property
    def isos(self) -> tuple[float, ...]:
        """ISO speeds or gain settings with values; empty for a spectral sensitivity."""
        if isinstance(self.content, DarktableCamera):
            return self.content.isos
        if isinstance(self.content, LoadedEntry):
            return self.content.entry.gain_settings
        return ()

    @property
    def digest(self) -> str:
        """SHA-256 of the values, by which equal data are recognised; names, license and provenance are not in it."""
        if isinstance(self.content, LoadedEntry):
            values: Any = sorted(self.content.entry.sha256.items())
        elif isinstance(self.content, DarktableCamera):
            values = (self.content.isos, self.content.a, self.content.b, self.content.stated)
        else:
            table = self.content.sensitivity
            channels = sorted((name, column.tolist()) for name, column in table.channels.items())
            values = (table.wavelength_nm.tolist(), channels)
        return sha256_of(repr(values).encode())

    def to_dict(self) -> dict[str, Any]:
        """Return name, kind, file, license, provenance and ISO speeds."""
        fields = {"name": self.name, "kind": self.kind, "file": str(self.path), "license": self.license}
        return {**fields, "provenance": self.provenance, "isos": list(self.isos)}


def usual_places() -> tuple[Path, ...]:
    """Return the files and folders of `PHOTOSITE_PROFILES`, darktable and rawtoaces that exist."""
    named = [Path(text) for text in os.environ.get(VARIABLE, "").split(os.pathsep) if text]
    if missing := next((path for path in named if not os.path.exists(path)), None):
        raise FileError(
            missing, "there is no such file or folder", hint=f"The environment variable {VARIABLE} names it"
        )
    profiles = [Path(folder).expanduser() / "noiseprofiles.json" for folder in _DARKTABLE_FOLDERS]
    stated = [text for name in _RAWTOACES_VARIABLES for text in os.environ.get(name, "").split(os.pathsep) if text]
    tables = [Path(folder) for folder in (*stated, *_RAWTOACES_FOLDERS)]
    return tuple(dict.fromkeys([*named, *(path for path in (*profiles, *tables) if path.exists())]))


def given_places(profiles: Profiles) -> tuple[Path, ...]:
    """Return the files and folders of an argument `profiles`, `usual_places` for None."""
    if profiles is None:
        return usual_places()
    return tuple(map(Path, [profiles] if isinstance(profiles, str | PathLike) else profiles))


def entries_below(places: Iterable[Path]) -> tuple[Path, ...]:
    """Return the folders of contributed entries in folders without an index, by name."""
    folders = (place for place in places if place.is_dir())
    return tuple(sorted(path.parent for place in folders for path in place.glob(f"*/{ENTRY_NAME}")))


def find_cameras(profiles: Profiles = None) -> tuple[CameraSource, ...]:
    """Return the cameras of files and folders, by name.

    Parameters
    ----------
    profiles
        Files and folders: darktable's noiseprofiles.json, rawtoaces' JSON or CSV files, indexes and entries of
        contributed cameras. In a folder, these and `camera/` and `data/camera/` below it. Default: `usual_places`.

    Raises
    ------
    FileError
        If a file is missing, or none of these.
    """
    found = [source for path in given_places(profiles) for source in _path_sources(path)]
    return tuple(sorted(found, key=lambda source: (name_words(source.name), source.kind, str(source.path))))


def _path_sources(path: Path) -> Iterable[CameraSource]:
    if not path.is_dir():
        return _file_sources(path)
    if (path / ENTRY_NAME).is_file():
        return [_contributed(entry_in_folder(path))]
    if (path / INDEX_NAME).is_file():
        return _file_sources(path / INDEX_NAME)
    return list(_folder_sources(path))


def _folder_sources(folder: Path) -> Iterator[CameraSource]:
    """Yield the cameras of a folder with files of other programs.

    JSON files of other kinds are skipped, and invalid files with a warning.
    """
    count = 0
    places = (folder, folder / "camera", folder / "data" / "camera")
    for path in (path for place in places if place.is_dir() for path in sorted(place.iterdir())):
        if path.suffix.lower() not in (".json", ".csv") or not path.is_file():
            continue
        if (count := count + 1) > _MOST_FILES:
            raise FileError(folder, f"has more than {_MOST_FILES} files", hint="Name the files")
        try:
            unknown = (
                path.suffix.lower() == ".json"
                and not {"noiseprofiles", "spectral_data"} & read_json_object(path).keys()
            )
            found = () if unknown else _file_sources(path)
        except FileError as error:
            warnings.warn(PhotositeWarning(f"{error}. The file is skipped"), stacklevel=2)
            continue
        yield from found


def _file_sources(path: Path) -> Iterable[CameraSource]:
    if path.suffix.lower() in (".yaml", ".yml"):
        if path.name == ENTRY_NAME:
            return [_contributed(entry_in_folder(path.parent))]
        return [_contributed(entry) for entry in read_index(path)]
    if path.suffix.lower() == ".json":
        state = path.stat() if path.exists() else None
        return _json_cameras(path, *((0, 0) if state is None else (state.st_mtime_ns, state.st_size)))
    camera = csv_camera(path)
    name = full_name(camera.maker, camera.model)
    texts = camera.license or NOT_STATED, camera.provenance or NOT_STATED
    return [CameraSource(name, "spectral sensitivity", path, *texts, camera)]


@lru_cache(maxsize=64)
def _json_cameras(path: Path, _time: int, _size: int) -> tuple[CameraSource, ...]:
    data = read_json_object(path)
    if "noiseprofiles" in data:
        return tuple(_noise(camera, path) for camera in darktable_cameras(data, path))
    if "spectral_data" in data:
        camera = rawtoaces_camera(data, path)
        texts = camera.license or NOT_STATED, camera.provenance or NOT_STATED
        return (CameraSource(full_name(camera.maker, camera.model), "spectral sensitivity", path, *texts, camera),)
    problem = "the file is neither a darktable noise profile ('noiseprofiles') nor rawtoaces' ('spectral_data')"
    raise FileError(path, problem)


def _noise(camera: DarktableCamera, path: Path) -> CameraSource:
    license_, provenance = DARKTABLE_LICENSE, camera.comment or NOT_STATED
    if camera.stated is not None:
        license_, provenance = NOT_STATED, provenance.partition(":")[0]
    return CameraSource(full_name(camera.maker, camera.model), "noise profile", path, license_, provenance, camera)


def _contributed(loaded: LoadedEntry) -> CameraSource:
    entry = loaded.entry
    said = f"{entry.frames} frames, {entry.created}" + (f", {entry.attribution}" if entry.attribution else "")
    return CameraSource(entry.camera, "contributed", loaded.folder, entry.license, said, loaded)
