"""All file formats of scenes in one table, with reading, writing and conversion.

The table has suffixes, contents, the options that apply, and the module that reads and writes.

To add a format: write a module in `photosite.scene.io` with `open_cube(path, options)`, which returns a cube, to be
reduced, or a scene; `read(path, options)`, which returns a scene; or `read_patches(path)`, which returns the table of a
measured chart (`read_patches(path, variable)` where this option applies); and `write(scene, path)` where scenes can be
written. Add an entry to `FORMATS`. Keyword arguments of `write` are the options of `write_scene`. Each raises
`FileError` for a file that it cannot read or write. docs/development/contributing.md lists tests and documentation.
"""

from __future__ import annotations

import importlib
import inspect
import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any, Unpack

from photosite.errors import FileError, InputError, PhotositeWarning, did_you_mean
from photosite.files.small_files import reading
from photosite.scene.cube import SpectralCube, select_bands, within_range
from photosite.scene.io.patch_table import chart_scene
from photosite.scene.options import ReadArguments, ReadOptions, WriteArguments
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import Reduction, reduce_cube
from photosite.scene.weights import Progress

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
HDF5_CUBE = Content(CUBE.name, CUBE.options | {"variable", "interleave"})
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
        What its files can hold: first a cube, last what is read as a scene at once.
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
            chosen = (options.variable,) if "variable" in self.options else ()
            found = chart_scene(module.read_patches(path, *chosen), options)
        else:
            found = (module.open_cube if hasattr(module, "open_cube") else module.read)(path, options)
        content = self.holds[-1 if isinstance(found, Scene) else 0]
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
        (HDF5_CUBE, SCENE),
        (b"\x89HDF\r\n\x1a\n",),
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
        "ENVI", (".hdr", ".img", ".bsq", ".bil", ".bip", ".raw", ".dat"), "envi", (CUBE,), (b"ENVI",), writes=(".hdr",)
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
        (".cgats", ".it8", ".ti3", ".txt", ".icc", ".icm"),
        "cgats",
        (CHART,),
        (b"CGATS", b"IT8.", b"CTI3", b"ISO28178"),
        writes=(".cgats", ".it8", ".ti3", ".txt"),
    ),
    Format("CSV", (".csv", ".tsv"), "chart_csv", (CHART,), writes=(".csv", ".tsv")),
    Format("CxF", (".cxf",), "cxf", (CHART,), options=frozenset({"variable"})),
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
    head = _first_bytes(path)
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
    with reading(path), path.open("rb") as file:
        return file.read(_HEAD_BYTES)


# Reading, writing and conversion of scene files of any known format.


def read_scene(
    path: str | PathLike[str], *, progress: Progress | None = None, **options: Unpack[ReadArguments]
) -> Scene:
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
    >>> Scene.uniform(np.full(31, 1e14), np.arange(400, 701, 10)).save(f"{folder.name}/gray.h5")
    >>> read_scene(f"{folder.name}/gray.h5").basis.shape
    (1, 31)
    """
    read_options = ReadOptions(**dict[str, Any](options))
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


def open_cube(path: str | PathLike[str], **options: Unpack[ReadArguments]) -> SpectralCube:
    """Open a spectral file, to read its values block by block; options as for `read_scene`.

    Raises
    ------
    FileError
        If the file cannot be read, or holds no cube.
    InputError
        If an option is unknown or invalid.
    """
    found = _opened(Path(path), ReadOptions(**dict[str, Any](options)))
    if isinstance(found, Scene):
        raise FileError(path, "holds a scene, not a cube", hint="Read it with read_scene")
    return found


def write_scene(scene: Scene, path: str | PathLike[str], **options: Unpack[WriteArguments]) -> None:
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

    Warns
    -----
    PhotositeWarning
        If the light is polarized, which only `.h5` keeps.

    Examples
    --------
    >>> import tempfile
    >>> from photosite.scene import charts
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_scene(charts.ramp("D65", 100, rows=4, cols=6), f"{folder}/ramp.tif")
    ...     read_scene(f"{folder}/ramp.tif").shape
    (4, 6)
    """
    file = Path(path)
    write = _format_to_write(file).load().write
    known = list(inspect.signature(write).parameters)[2:]
    for name in options:
        if name not in known:
            hint = did_you_mean(name, known) if known else "There are no options"
            raise InputError(f"writing {file.suffix} has no option '{name}'", hint=hint)
    write(scene, file, **options)
    if scene.polarization is not None and (write.__module__ != "photosite.scene.io.hdf5" or options.get("cube")):
        problem = "the polarization of the scene's light is not written"
        warnings.warn(PhotositeWarning(problem, where=str(file), hint="Save as .h5, which keeps it"), stacklevel=2)


def _format_to_write(path: Path) -> Format:
    kind = next((kind for kind in FORMATS if path.suffix.lower() in kind.writes), None)
    if kind is None:
        suffixes = ", ".join(kind.writes[0] for kind in FORMATS if kind.writes)
        raise FileError(path, f"cannot be written: a scene file has one of the suffixes {suffixes}")
    return kind


def convert_scene(
    path: str | PathLike[str],
    output: str | PathLike[str],
    *,
    progress: Progress | None = None,
    **options: Unpack[ReadArguments],
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
    >>> done = convert_scene(f"{folder.name}/chart.tif", f"{folder.name}/chart.h5", tolerance=0.01)
    >>> done.bands, done.components, done.scene.relative_error < 0.01
    (41, 8, True)
    """
    read_options, source, target = ReadOptions(**dict[str, Any](options)), Path(path), Path(output)
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
