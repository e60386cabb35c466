"""Reading and writing of scene files of any known format."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.errors import FileError, InputError, PhotositeWarning, did_you_mean
from photosite.scene.bands import within_range
from photosite.scene.cube import SpectralCube, release, select_bands
from photosite.scene.io.formats import FORMATS, format_of
from photosite.scene.options import ReadOptions
from photosite.scene.reduce import reduce_cube
from photosite.scene.reduction import Progress
from photosite.scene.scene import Scene


def read_scene(path: str | PathLike[str], *, progress: Progress | None = None, **options: Any) -> Scene:
    """Read a scene from a file: photosite's own, a spectral cube, a rendering, a measured chart or a picture.

    Parameters
    ----------
    path
        The file.
    progress
        Called with (done, total, unit) while a cube is reduced.
    **options
        Fields of `photosite.scene.options.ReadOptions`, such as `illuminant`, `mean_luminance_cd_m2`, `units` and
        `tolerance`. What the file states itself need not be given.

    Returns
    -------
    Scene
        Its `relative_error` is the RMS error of the reduction of a cube to few basis spectra.

    Raises
    ------
    FileError
        If the file is damaged, of an unknown format, or lacks information that the options do not give.
    InputError
        If an option is unknown or invalid.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> folder = tempfile.TemporaryDirectory()
    >>> Scene.uniform(np.full(31, 1e14), np.arange(400, 701, 10)).save(f"{folder.name}/grey.h5")
    >>> read_scene(f"{folder.name}/grey.h5").basis.shape
    (1, 31)
    """
    read_options = ReadOptions(**options)
    file = Path(path)
    found = open_scene(file, read_options)
    if isinstance(found, Scene):
        return found
    try:
        reduction = reduce_cube(found, read_options, progress=progress)
    finally:
        release(found)
    counts = ((reduction.no_data_values, "missing"), (reduction.negative_values, "negative"))
    if replaced := " and ".join(f"{count} {what}" for count, what in counts if count):
        warnings.warn(PhotositeWarning(f"{replaced} values were read as 0", where=str(file)), stacklevel=2)
    return reduction.scene


def open_scene(path: Path, options: ReadOptions) -> SpectralCube | Scene:
    """Return what a file holds, before any reduction: a cube of the wanted bands, or a scene.

    Raises
    ------
    FileError
        As for `read_scene`.
    """
    found = format_of(path).open(path, options)
    if isinstance(found, Scene):
        return found
    return select_bands(found, within_range(found.wavelength_nm, options.band_range_nm))


def open_cube(path: str | PathLike[str], **options: Any) -> SpectralCube:
    """Open a spectral file, to read its values block by block.

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
        If an option is unknown or invalid.
    """
    found = open_scene(Path(path), ReadOptions(**options))
    if isinstance(found, Scene):
        raise FileError(path, "holds a scene, not a cube", hint="Read it with read_scene")
    return found


def write_scene(scene: Scene, path: str | PathLike[str], **options: Any) -> None:
    """Write a scene in the format of the file's suffix.

    Parameters
    ----------
    scene
        The scene.
    path
        `.h5` is photosite's own format and keeps all of the scene. Others hold the photon radiance of every sample, in
        single precision: `.hdr` (ENVI, with the numbers in `.img` beside it), `.tif` (a page per band), `.mat` (ISET's
        scene file); `.exr` holds energy radiance. `.csv` and `.cgats` hold the patches of a chart.
    **options
        Of the format: cube=True (HDF5: a plain cube), interleave="bsq", "bil" or "bip" (ENVI), version="5" or "7.3"
        (MATLAB), half=True (OpenEXR: 16-bit floats).

    Raises
    ------
    FileError
        If the suffix is of no format that can be written, or the file cannot be written.
    InputError
        If the format has no such option.
    """
    file = Path(path)
    write = writer_of(file)
    known = list(inspect.signature(write).parameters)[2:]
    for name in options:
        if name not in known:
            hint = did_you_mean(name, known) if known else "There are no options"
            raise InputError(f"writing {file.suffix} has no option '{name}'", hint=hint)
    write(scene, file, **options)


def writer_of(path: Path) -> Callable[..., None]:
    """Return the function that writes a scene to a file of this name.

    Raises
    ------
    FileError
        If the suffix is of no format that can be written.
    """
    kind = next((kind for kind in FORMATS if path.suffix.lower() in kind.suffixes and kind.writes), None)
    if kind is None:
        suffixes = ", ".join(kind.suffixes[0] for kind in FORMATS if kind.writes)
        raise FileError(path, f"cannot be written: a scene file has one of the suffixes {suffixes}")
    write: Callable[..., None] = kind.load().write
    return write
