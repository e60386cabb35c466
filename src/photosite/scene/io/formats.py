"""The table of scene file formats: suffixes, contents, the options that apply, and the module that reads and writes.

To add a format: write a module in `photosite.scene.io` with `open_cube(path, options)`, which returns a cube, to be
reduced, or a scene; `read(path, options)`, which returns a scene; or `read_patches(path)`, which returns the table of a
measured chart; and `write(scene, path)` where scenes can be written. Add an entry to `FORMATS`. Keyword arguments of
`write` are the options of `write_scene`. Each raises `FileError` for a file that it cannot read or write.
docs/contributing.md lists tests and documentation.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from photosite.errors import FileError
from photosite.scene.cube import SpectralCube
from photosite.scene.io.patch_table import chart_scene
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene

_HEAD_BYTES = 1 << 10

_ALL_CONTENTS = frozenset({"distance_m", "width_m", "illuminant", "mean_luminance_cd_m2"})
"""Options of reading that apply to every content."""
_BANDS = frozenset({"units", "wavelength_nm", "band_range_nm", "no_data", "negative", "sort_bands"})
"""Options that apply to values in bands."""


@dataclass(frozen=True)
class Content:
    """What a file can hold, by its name in messages, and the options of reading that apply to it besides all's."""

    name: str
    options: frozenset[str]


CUBE = Content("a cube", _BANDS | {"tolerance"})
CHART = Content("a measured chart", _BANDS | {"patch_cols"})
DISPLAY_PICTURE = Content("a display picture", frozenset({"tolerance", "method", "out_of_gamut"}))
LIGHT_PICTURE = Content("a picture of light", frozenset({"negative"}))
SCENE = Content("a scene", frozenset({"tolerance", "band_range_nm"}))


@dataclass(frozen=True)
class Format:
    """A file format.

    Parameters
    ----------
    name, suffixes, module
        Its common name, the suffixes of its files in lower case, and its module in `photosite.scene.io`.
    holds
        What its files can hold; a content that is read as a scene at once comes last.
    signatures
        First bytes that identify it whatever the suffix; none where only the suffix does.
    options
        Options of reading that apply to the format, whatever the file holds.
    writes
        Suffixes of the files that scenes can be written to; none where its module has no `write`.
    """

    name: str
    suffixes: tuple[str, ...]
    module: str
    holds: tuple[Content, ...]
    signatures: tuple[bytes, ...] = ()
    options: frozenset[str] = frozenset()
    writes: tuple[str, ...] = ()

    def load(self) -> ModuleType:
        """Import and return its module."""
        return importlib.import_module(f"photosite.scene.io.{self.module}")

    def open(self, path: Path, options: ReadOptions) -> SpectralCube | Scene:
        """Return what a file holds, before any reduction; options that do not apply are refused."""
        self._check(path, options, self.holds, f"is a {self.name} file")
        module = self.load()
        found: SpectralCube | Scene
        if CHART in self.holds:
            found = chart_scene(module.read_patches(path), options)
        else:
            found = (module.open_cube if hasattr(module, "open_cube") else module.read)(path, options)
        content = self.holds[-1] if isinstance(found, Scene) else CUBE
        self._check(path, options, (content,), f"holds {content.name}")
        if content is DISPLAY_PICTURE and options.method != "jakob-hanika" and "tolerance" in options.given():
            raise not_reduced(path, found, options)
        return found

    def _check(self, path: Path, options: ReadOptions, contents: tuple[Content, ...], what: str) -> None:
        known = _ALL_CONTENTS.union(self.options, *(content.options for content in contents))
        for name, value in options.given().items():
            if name not in known:
                raise FileError(
                    path, f"{what}, to which an option does not apply", hint=f"Omit {{{name}}}", arguments={name: value}
                )


FORMATS: tuple[Format, ...] = (
    Format(
        "HDF5",
        (".h5", ".hdf5", ".hdf", ".he5"),
        "hdf5",
        (CUBE, SCENE),
        (b"\x89HDF\r\n\x1a\n",),
        frozenset({"variable", "interleave"}),
        writes=(".h5", ".hdf5", ".hdf", ".he5"),
    ),
    Format(
        "MATLAB",
        (".mat",),
        "matlab",
        (CUBE,),
        (b"MATLAB 5.0", b"MATLAB 7.3"),
        frozenset({"variable"}),
        writes=(".mat",),
    ),
    Format(
        "TIFF",
        (".tif", ".tiff"),
        "tiff",
        (CUBE, DISPLAY_PICTURE),
        (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),
        writes=(".tif", ".tiff"),
    ),
    Format(
        "ENVI",
        (".hdr", ".img", ".bsq", ".bil", ".bip", ".raw", ".dat"),
        "envi",
        (CUBE,),
        (b"ENVI",),
        writes=(".hdr",),
    ),
    Format(
        "OpenEXR",
        (".exr",),
        "exr",
        (CUBE, LIGHT_PICTURE),
        (b"\x76\x2f\x31\x01",),
        frozenset({"no_data"}),
        writes=(".exr",),
    ),
    Format(
        "CGATS",
        (".cgats", ".it8", ".ti3", ".txt"),
        "cgats",
        (CHART,),
        (b"CGATS", b"IT8.", b"CTI3", b"ISO28178"),
        writes=(".cgats", ".it8", ".ti3", ".txt"),
    ),
    Format("CSV", (".csv", ".tsv"), "chart_csv", (CHART,), writes=(".csv", ".tsv")),
    Format(
        "PNG or JPEG", (".png", ".jpg", ".jpeg"), "picture", (DISPLAY_PICTURE,), (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")
    ),
    Format(
        "Radiance", (".pic", ".rgbe"), "radiance", (LIGHT_PICTURE,), (b"#?RADIANCE", b"#?RGBE"), frozenset({"units"})
    ),
)
"""In the order of the test by signature: a MATLAB 7.3 file is HDF5 behind 512 other bytes."""


def suffixes_of_scenes() -> tuple[str, ...]:
    """Return the suffixes in which any scene can be written, not only a chart's patches."""
    return tuple(suffix for kind in FORMATS if CHART not in kind.holds for suffix in kind.writes)


def not_reduced(path: Path, scene: SpectralCube | Scene, options: ReadOptions) -> FileError:
    """Return the error for a tolerance where nothing is reduced."""
    count = len(scene.basis) if isinstance(scene, Scene) else 0
    return FileError(
        path,
        f"holds a scene of {count} basis spectra, which is not reduced",
        hint="Omit {tolerance}",
        arguments={"tolerance": options.tolerance},
    )


def format_of(path: Path) -> Format:
    """Return the format of a file, by its first bytes and then by its suffix."""
    try:
        head = _first_bytes(path)
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    for kind in FORMATS:
        if any(head.startswith(signature) for signature in kind.signatures):
            return kind
    for kind in FORMATS:
        if path.suffix.lower() in kind.suffixes:
            return kind
    envi = next(kind for kind in FORMATS if kind.module == "envi")
    for header in (path.with_name(path.name + suffix) for suffix in (".hdr", ".HDR")):
        if header.is_file() and _first_bytes(header).startswith(envi.signatures):
            return envi  # the data file beside an ENVI header needs no suffix
    known = ", ".join(f"{kind.name} ({kind.suffixes[0]})" for kind in FORMATS)
    if path.suffix:
        raise FileError(path, f"has the unknown suffix '{path.suffix}'", hint=f"Known formats are {known}")
    raise FileError(path, "has no suffix", hint=f"For an ENVI image, give the .hdr. Known formats are {known}")


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES)
