"""Reading, writing and conversion of scene files of any known format."""

from __future__ import annotations

import inspect
import warnings
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.errors import FileError, InputError, PhotositeWarning, did_you_mean
from photosite.scene.bands import within_range
from photosite.scene.cube import SpectralCube, select_bands
from photosite.scene.io.formats import FORMATS, Format, format_of, not_reduced
from photosite.scene.options import ReadOptions
from photosite.scene.reduction import Progress
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import Reduction, reduce_cube


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
    found = _opened(file, read_options)
    if isinstance(found, Scene):
        return found
    try:
        reduction = reduce_cube(found, read_options, progress=progress)
    finally:
        found.release()
    counts = ((reduction.no_data_values, "missing"), (reduction.negative_values, "negative"))
    if replaced := " and ".join(f"{count} {what}" for count, what in counts if count):
        warnings.warn(PhotositeWarning(f"{replaced} values were read as 0", where=str(file)), stacklevel=2)
    return reduction.scene


def _opened(path: Path, options: ReadOptions) -> SpectralCube | Scene:
    """Return what a file holds, before any reduction: a cube of the wanted bands, or a scene."""
    found = format_of(path).open(path, options)
    if isinstance(found, Scene):
        return found
    return select_bands(found, within_range(found.wavelength_nm, options.band_range_nm))


def open_cube(path: str | PathLike[str], **options: Any) -> SpectralCube:
    """Open a spectral file, to read its values block by block; options as for `read_scene`.

    Raises
    ------
    FileError
        If the file cannot be read, or holds no cube.
    InputError
        If an option is unknown or invalid.
    """
    found = _opened(Path(path), ReadOptions(**options))
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
    write = _format_to_write(file).load().write
    known = list(inspect.signature(write).parameters)[2:]
    for name in options:
        if name not in known:
            hint = did_you_mean(name, known) if known else "There are no options"
            raise InputError(f"writing {file.suffix} has no option '{name}'", hint=hint)
    write(scene, file, **options)


def _format_to_write(path: Path) -> Format:
    """Return the format of a scene file to write."""
    kind = next((kind for kind in FORMATS if path.suffix.lower() in kind.writes), None)
    if kind is None:
        suffixes = ", ".join(kind.writes[0] for kind in FORMATS if kind.writes)
        raise FileError(path, f"cannot be written: a scene file has one of the suffixes {suffixes}")
    return kind


def convert(
    path: str | PathLike[str], output: str | PathLike[str], *, progress: Progress | None = None, **options: Any
) -> Reduction:
    """Convert a scene file to another format, through the few basis spectra of a scene.

    Parameters
    ----------
    path
        A file that `photosite.read_scene` reads.
    output
        The file to write, as for `photosite.write_scene`. Into `.h5`, photosite's own format, weights are written as
        they are computed, so that memory does not grow with the cube.
    progress
        Called with (done, total, unit).
    **options
        As for `read_scene`.

    Returns
    -------
    Reduction
        The scene, and how it was reduced.

    Raises
    ------
    FileError
        If a file cannot be read or written, or lacks information; if the output would overwrite the input; or if a
        tolerance is given for a file that holds a scene of few basis spectra.
    InputError
        If an option is unknown or invalid.

    Examples
    --------
    >>> import tempfile, photosite as ps
    >>> folder = tempfile.TemporaryDirectory()
    >>> ps.charts.macbeth("A", 40).save(f"{folder.name}/chart.tif")
    >>> done = convert(f"{folder.name}/chart.tif", f"{folder.name}/chart.h5", tolerance=0.01)
    >>> done.bands, done.components, done.scene.relative_error < 0.01
    (41, 8, True)
    """
    read_options, source, target = ReadOptions(**options), Path(path), Path(output)
    kind = _format_to_write(target)
    found = _opened(source, read_options)
    _check_apart(source, found, target)
    if isinstance(found, Scene):
        reduced = read_options.method == "jakob-hanika"  # spectra of single colors are reduced as a cube's are
        if "tolerance" in options and not reduced:
            raise not_reduced(source, found, read_options)
        kind.load().write(found, target)
        return Reduction(found, found.wavelength_nm.size, reduced=reduced)
    try:
        if kind.module == "hdf5":
            from photosite.scene.io.hdf5 import reduce_to_own

            return reduce_to_own(lambda store: reduce_cube(found, read_options, store=store, progress=progress), target)
        reduction = reduce_cube(found, read_options, progress=progress)
        kind.load().write(reduction.scene, target)
        return reduction
    finally:
        found.release()


def _check_apart(path: Path, found: SpectralCube | Scene, target: Path) -> None:
    """Refuse to overwrite the input: measured data in many bands cannot be restored from few spectra.

    An ENVI image is two files, one of them given and the other found beside it.
    """
    sources = {path, Path(getattr(found, "path", path))}
    if format_of(path).module == "envi":
        sources |= {path.with_suffix(".hdr"), path.with_name(f"{path.name}.hdr")}
    targets = [target, target.with_suffix(".img")] if target.suffix.lower() == ".hdr" else [target]
    for name in targets:
        if name.resolve() in {source.resolve() for source in sources}:
            raise FileError(target, f"would overwrite the input {name.name}", hint="Choose another name")
