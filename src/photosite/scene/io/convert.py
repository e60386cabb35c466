"""One scene file into another; a cube into photosite's own file without either of them ever being in memory."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from photosite.errors import FileError
from photosite.scene.cube import SpectralCube, release
from photosite.scene.io.files import FORMATS, format_of, open_scene, read_options, writer_of
from photosite.scene.needless import check_tolerance
from photosite.scene.options import ReadOptions
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
        A file that `photosite.scene.io.files.read_scene` reads.
    output
        The file wanted, as for `photosite.scene.io.files.write_scene`. Into `.h5`, photosite's own, weights are
        written as
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
        If a file cannot be read or written, or does not say what is needed; if the output would replace what is read,
        or a tolerance is given for a file that holds a scene of few spectra already.
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
    _check_apart(Path(path), found, target)
    if isinstance(found, Scene):
        if "tolerance" in options:
            check_tolerance(Path(path), found, said)
        write(found, target)
        # Spectra that were raised one by one are reduced as a cube's are.
        return Reduction(found, found.wavelength_nm.size, reduced=said.method == "jakob-hanika")
    try:
        return _reduced_into(target, found, said, progress)
    finally:
        release(found)


def _reduced_into(target: Path, cube: SpectralCube, said: ReadOptions, progress: Progress | None) -> Reduction:
    if target.suffix.lower() in FORMATS[0].suffixes:
        from photosite.scene.io.native import reduce_to_native

        return reduce_to_native(lambda store: reduced(cube, said, store=store, progress=progress), target)
    reduction = reduced(cube, said, progress=progress)
    writer_of(target)(reduction.scene, target)
    return reduction


def _check_apart(path: Path, found: SpectralCube | Scene, target: Path) -> None:
    """Refuse to write over what is read: measured data in many bands cannot be made again from few spectra.

    An ENVI image is two files, one of them perhaps given and the other found.
    """
    sources = {path, Path(getattr(found, "path", path))}
    if format_of(path).module == "envi":
        sources |= {path.with_suffix(".hdr"), path.with_name(f"{path.name}.hdr")}
    targets = [target, target.with_suffix(".img")] if target.suffix.lower() == ".hdr" else [target]
    for name in targets:
        if name.resolve() in {source.resolve() for source in sources}:
            raise FileError(target, f"would be written over {name.name}, which is read; choose another name")
