"""Conversion of scene files; a cube of any size is reduced into photosite's own format in bounded memory."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from photosite.errors import FileError
from photosite.scene.cube import SpectralCube, release
from photosite.scene.io.files import open_scene, writer_of
from photosite.scene.io.formats import FORMATS, format_of, not_reduced
from photosite.scene.options import ReadOptions
from photosite.scene.reduce import Reduction, reduce_cube
from photosite.scene.reduction import Progress
from photosite.scene.scene import Scene


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
    read_options, target = ReadOptions(**options), Path(output)
    write = writer_of(target)
    found = open_scene(Path(path), read_options)
    _check_apart(Path(path), found, target)
    if isinstance(found, Scene):
        raised = read_options.method == "jakob-hanika"  # spectra of single colours are reduced as a cube's are
        if "tolerance" in options and not raised:
            raise not_reduced(Path(path), found, read_options)
        write(found, target)
        return Reduction(found, found.wavelength_nm.size, reduced=raised)
    try:
        return _reduce_into(target, found, read_options, progress)
    finally:
        release(found)


def _reduce_into(target: Path, cube: SpectralCube, options: ReadOptions, progress: Progress | None) -> Reduction:
    if target.suffix.lower() in FORMATS[0].suffixes:
        from photosite.scene.io.hdf5 import reduce_to_own

        return reduce_to_own(lambda store: reduce_cube(cube, options, store=store, progress=progress), target)
    reduction = reduce_cube(cube, options, progress=progress)
    writer_of(target)(reduction.scene, target)
    return reduction


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
