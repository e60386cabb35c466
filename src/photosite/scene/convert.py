"""One scene file into another; a cube into photosite's own file without either of them ever being in memory."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from photosite.scene.files import FORMATS, open_scene, read_options, writer_of
from photosite.scene.reduce import Progress, Reduction, reduced
from photosite.scene.scene import Scene


def convert(
    path: str | PathLike[str],
    output: str | PathLike[str],
    *,
    progress: Progress | None = None,
    **options: Any,
) -> Reduction:
    """Bring a scene's file into another format, through the few spectra of a scene.

    Parameters
    ----------
    path
        A file that `photosite.scene.files.read_scene` reads.
    output
        The file wanted, as for `photosite.scene.files.write_scene`. Into `.h5`, photosite's own, weights are written as
        they are computed, so that memory does not grow with the cube.
    progress
        Told (done, total, what).
    **options
        As for `read_scene`.

    Returns
    -------
    Reduction
        The scene, and what the reduction took.

    Raises
    ------
    FileError
        If a file cannot be read or written, or does not say what is needed.
    InputError
        If an option cannot be.

    Examples
    --------
    >>> import tempfile, photosite as ps
    >>> folder = tempfile.TemporaryDirectory()
    >>> ps.charts.macbeth("A", 40).save(f"{folder.name}/chart.tif")
    >>> done = convert(f"{folder.name}/chart.tif", f"{folder.name}/chart.h5", tolerance=0.01)
    >>> done.bands, done.components, done.scene.relative_error < 0.01
    (41, 8, True)
    """
    said, target = read_options(options), Path(output)
    write = writer_of(target)
    found = open_scene(Path(path), said)
    if isinstance(found, Scene):
        write(found, target)
        return Reduction(found, found.wavelength_nm.size)
    if target.suffix.lower() in FORMATS[0].suffixes:
        from photosite.scene.formats.native import reduce_to_native

        return reduce_to_native(lambda store: reduced(found, said, store=store, progress=progress), target)
    reduction = reduced(found, said, progress=progress)
    write(reduction.scene, target)
    return reduction
