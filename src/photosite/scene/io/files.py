"""Scenes from files and into them: one door for all formats, which go by the file's first bytes and its name.

To add a format: a module in `photosite.scene.io` with `open_cube(path, options)` (a cube, to be reduced, or a
scene) or `read(path, options)` (a scene), `write(scene, path)` where it can be written, and an entry in `FORMATS`.
"""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any

from photosite.errors import FileError, InputError, PhotositeWarning, did_you_mean
from photosite.scene.bands import within_range
from photosite.scene.cube import SpectralCube, picked, release
from photosite.scene.needless import check_after, check_before
from photosite.scene.options import ReadOptions
from photosite.scene.reduce import Progress, reduced
from photosite.scene.scene import Scene

_HEAD_BYTES = 1 << 10
_MEANT = {
    "luminance": "mean_luminance_cd_m2",
    "luminance_cd_m2": "mean_luminance_cd_m2",
    "wavelengths": "wavelength_nm",
    "bands": "band_range_nm",
    "distance": "distance_m",
    "width": "width_m",
}
"""Names under which options are known elsewhere, as the command line's."""


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Parameters
    ----------
    name
        What people call it.
    suffixes
        Endings of its files, lower case.
    module
        In `photosite.scene.io`.
    signatures
        First bytes by which it is known whatever its name; none where only the name tells.
    writes
        Whether scenes can be written in it.
    """

    name: str
    suffixes: tuple[str, ...]
    module: str
    signatures: tuple[bytes, ...] = ()
    writes: bool = False

    def load(self) -> ModuleType:
        """Its module, imported now."""
        return importlib.import_module(f"photosite.scene.io.{self.module}")


FORMATS: tuple[Format, ...] = (
    Format("HDF5", (".h5", ".hdf5", ".hdf", ".he5"), "hdf5", (b"\x89HDF\r\n\x1a\n",), writes=True),
    Format("MATLAB", (".mat",), "matlab", (b"MATLAB 5.0", b"MATLAB 7.3"), writes=True),
    Format("TIFF", (".tif", ".tiff"), "tiff", (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), writes=True),
    Format("ENVI", (".hdr", ".img", ".bsq", ".bil", ".bip", ".raw", ".dat"), "envi", (b"ENVI",), writes=True),
    Format("OpenEXR", (".exr",), "exr", (b"\x76\x2f\x31\x01",), writes=True),
    Format("CGATS", (".cgats", ".it8", ".ti3", ".txt"), "cgats", (b"CGATS", b"IT8.", b"CTI3", b"ISO28178"), True),
    Format("CSV", (".csv", ".tsv"), "chart_csv", writes=True),
    Format("PNG or JPEG", (".png", ".jpg", ".jpeg"), "picture", (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")),
    Format("Radiance", (".pic", ".rgbe"), "radiance", (b"#?RADIANCE", b"#?RGBE")),
)
"""In the order in which they are asked: a MATLAB 7.3 file is HDF5 behind 512 bytes of its own."""


def read_scene(
    path: str | PathLike[str],
    *,
    progress: Progress | None = None,
    **options: Any,
) -> Scene:
    """A scene from a file: photosite's own, a spectral cube, a rendering, a measured chart.

    Parameters
    ----------
    path
        The file.
    progress
        Told (done, total, what) while a cube is reduced.
    **options
        Fields of `photosite.scene.options.ReadOptions`: distance_m, width_m, tolerance, illuminant,
        mean_luminance_cd_m2, units, wavelength_nm, band_range_nm, no_data, negative, sort_bands, interleave, variable,
        patch_cols, method, out_of_gamut.
        What the file says itself need not be said.

    Returns
    -------
    Scene
        Its `relative_error` is the RMS error of the radiance that reducing a cube to few spectra made.

    Raises
    ------
    FileError
        If the file is damaged, of no known kind, or does not say what is needed and the options do not either.
    InputError
        If an option is unknown or cannot be.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> folder = tempfile.TemporaryDirectory()
    >>> write_scene(Scene.uniform(np.full(31, 1e14), np.arange(400, 701, 10)), f"{folder.name}/grey.h5")
    >>> read_scene(f"{folder.name}/grey.h5").basis.shape
    (1, 31)
    """
    said = read_options(options)
    file = Path(path)
    found = open_scene(file, said)
    if isinstance(found, Scene):
        return found
    try:
        done = reduced(found, said, progress=progress)
    finally:
        release(found)
    counts = ((done.no_data_values, "missing"), (done.negative_values, "negative"))
    if told := " and ".join(f"{count} {what}" for count, what in counts if count):
        warnings.warn(PhotositeWarning(f"{file}: {told} values were taken as 0"), stacklevel=2)
    return done.scene


def open_scene(path: Path, said: ReadOptions) -> SpectralCube | Scene:
    """What a file holds, before any reduction: a cube, or a scene as it is.

    Raises
    ------
    FileError
        As for `read_scene`.
    """
    kind = format_of(path)
    check_before(path, kind.name, kind.module, said)
    module = kind.load()
    found: SpectralCube | Scene = (module.open_cube if hasattr(module, "open_cube") else module.read)(path, said)
    check_after(path, kind.module, found, said)
    return found if isinstance(found, Scene) else picked(found, within_range(found.wavelength_nm, said.band_range_nm))


def open_cube(path: str | PathLike[str], **options: Any) -> SpectralCube:
    """A spectral file's values, to be looked at some rows at a time.

    Parameters
    ----------
    path
        The file.
    **options
        As for `read_scene`.

    Raises
    ------
    FileError
        If the file cannot be read, or holds no cube.
    InputError
        If an option is unknown or cannot be.
    """
    found = open_scene(Path(path), read_options(options))
    if isinstance(found, Scene):
        raise FileError(path, "holds a scene and no cube of values; read it with read_scene")
    return found


def write_scene(scene: Scene, path: str | PathLike[str], **how: Any) -> None:
    """Write a scene; the name's ending chooses the format.

    Parameters
    ----------
    scene
        The scene.
    path
        `.h5` is photosite's own file and keeps everything. Others hold photon radiance of every sample, in single
        precision: `.hdr` (ENVI, the numbers in `.img` beside it), `.tif` (a page a band), `.mat` (ISET's scene file);
        `.exr` energy radiance. `.csv` and `.cgats` hold the patches of a chart.
    **how
        The format's own: cube=True (HDF5: a plain cube), interleave="bsq", "bil" or "bip" (ENVI), version="5" or "7.3"
        (MATLAB), half=True (OpenEXR: 16-bit floats).

    Raises
    ------
    FileError
        If the ending is of no format that can be written, or the file cannot.
    InputError
        If the format has no such option.
    """
    file = Path(path)
    write = writer_of(file)
    known = list(inspect.signature(write).parameters)[2:]
    for name in how:
        if name not in known:
            hint = did_you_mean(name, known) if known else "it has none"
            raise InputError(f"writing {file.suffix} knows no option '{name}'; {hint}")
    write(scene, file, **how)


def writer_of(path: Path) -> Callable[..., None]:
    """What writes a scene to a file of this name.

    Raises
    ------
    FileError
        If its ending is of no format that can be written.
    """
    kind = next((kind for kind in FORMATS if path.suffix.lower() in kind.suffixes and kind.writes), None)
    if kind is None:
        endings = ", ".join(kind.suffixes[0] for kind in FORMATS if kind.writes)
        raise FileError(path, f"cannot be written: a scene's file ends in {endings}")
    write: Callable[..., None] = kind.load().write
    return write


def format_of(path: Path) -> Format:
    """The kind of a file, by its first bytes and then by its name.

    Raises
    ------
    FileError
        If there is no such file, or it is of no known kind.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    for kind in FORMATS:
        if any(head.startswith(signature) for signature in kind.signatures):
            return kind
    for kind in FORMATS:
        if path.suffix.lower() in kind.suffixes:
            return kind
    envi = next(kind for kind in FORMATS if kind.module == "envi")
    if any(_begins(path.with_name(path.name + ending), envi.signatures) for ending in (".hdr", ".HDR")):
        return envi  # its numbers, which need no ending
    names = ", ".join(f"{kind.name} ({kind.suffixes[0]})" for kind in FORMATS)
    ending = f"ends in '{path.suffix}'" if path.suffix else "has no ending (of an ENVI image, give the .hdr)"
    raise FileError(path, f"is no scene's file that is known: its name {ending}; known are {names}")


def _begins(path: Path, signatures: tuple[bytes, ...]) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(max(map(len, signatures))).startswith(signatures)
    except OSError:
        return False


def read_options(options: dict[str, Any]) -> ReadOptions:
    """Options by their names.

    Raises
    ------
    InputError
        If a name is unknown or a value cannot be.
    """
    known = [field.name for field in fields(ReadOptions)]
    for name in options:
        if name not in known:
            hint = f"did you mean '{_MEANT[name]}'?" if name in _MEANT else did_you_mean(name, known)
            raise InputError(f"reading a scene knows no option '{name}'; {hint}")
    return ReadOptions(**options)
