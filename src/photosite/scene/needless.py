"""Options of reading that mean nothing for a file: refused, since whoever says one expects something of it."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Literal

from photosite.errors import FileError
from photosite.scene.cube import SpectralCube
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene

Content = Literal["a cube", "a chart", "a display picture", "a picture of light", "a scene"]

_CONTENTS: dict[str, tuple[Content, ...]] = {
    "hdf5": ("a cube", "a scene"),
    "matlab": ("a cube",),
    "tiff": ("a cube", "a display picture"),
    "envi": ("a cube",),
    "exr": ("a cube", "a picture of light"),
    "cgats": ("a chart",),
    "chart_csv": ("a chart",),
    "picture": ("a display picture",),
    "radiance": ("a picture of light",),
}
"""What files of a format hold, by its module; what is read as a scene at once last."""

_MEANS: dict[str, tuple[Content, ...]] = {
    "tolerance": ("a cube", "a scene"),
    "band_range_nm": ("a cube", "a chart", "a scene"),
    "no_data": ("a cube", "a chart", "a picture of light"),
    "negative": ("a cube", "a chart", "a picture of light"),
    "sort_bands": ("a cube", "a chart"),
    "patch_cols": ("a chart",),
    "method": ("a display picture",),
    "out_of_gamut": ("a display picture",),
}
"""For what an option means something. Those that are not here do for all, or are looked at where they are used."""

_ABOUT = {
    "band_range_nm": "band_range_nm takes some bands of a cube, a chart or a scene",
    "no_data": "no_data is about values that cubes, charts and OpenEXR's pictures lack",
    "negative": "negative is about values below 0 of cubes, charts and pictures of light",
    "sort_bands": "sort_bands is about the bands of a cube or a chart",
    "patch_cols": "patch_cols is about measured charts (CGATS, CSV)",
    "method": "method says how the colours of a display picture (PNG, JPEG, TIFF) become spectra",
    "out_of_gamut": "out_of_gamut is about the colours of a display picture (PNG, JPEG, TIFF)",
    "variable": "variable is about files of several data sets (HDF5, MATLAB)",
}


def check_before(path: Path, name: str, module: str, said: ReadOptions) -> None:
    """Refuse what means nothing for any file of a format.

    Parameters
    ----------
    path
        The file.
    name, module
        Of the format (`photosite.scene.io.files.Format`).
    said
        The options.

    Raises
    ------
    FileError
        If an option is said that the format has no use for.
    """
    if said.interleave is not None and module != "hdf5":
        raise FileError(path, f"is {name}, which has its own order of axes; leave interleave out")
    contents = set(_CONTENTS[module])
    for option in _said(said):
        nothing = option in _MEANS and not contents & set(_MEANS[option])
        nothing |= (module, option) == ("radiance", "no_data")
        nothing |= option == "variable" and module not in ("hdf5", "matlab")
        if nothing and option in _ABOUT:
            raise FileError(path, f"is {name}, and {_ABOUT[option]}; leave it out")


def check_after(path: Path, module: str, found: SpectralCube | Scene, said: ReadOptions) -> None:
    """Refuse what means nothing for what a file turned out to hold.

    Raises
    ------
    FileError
        If an option is said that it has no use for.
    """
    content: Content = _CONTENTS[module][-1] if isinstance(found, Scene) else "a cube"
    for option in _said(said):
        if option not in _MEANS or content in _MEANS[option]:
            continue
        if option == "tolerance":
            check_tolerance(path, found, said)
        else:
            raise FileError(path, f"holds {content}, and {_ABOUT[option]}; leave it out")


def check_tolerance(path: Path, found: SpectralCube | Scene, said: ReadOptions) -> None:
    """Refuse a tolerance for what is not reduced.

    Raises
    ------
    FileError
        If it is a scene already, and none of the spectra that are raised one by one.
    """
    if isinstance(found, Scene) and said.method != "jakob-hanika":
        raise FileError(
            path, f"holds a scene of {len(found.basis)} spectra and no cube to be reduced; leave the tolerance out"
        )


def _said(said: ReadOptions) -> list[str]:
    """The options that are not as they are where nothing is said."""
    plain = ReadOptions()
    names = [field.name for field in fields(said)]
    return [name for name in names if (value := getattr(said, name)) is not None and _differs(value, plain, name)]


def _differs(value: object, plain: ReadOptions, name: str) -> bool:
    usual = getattr(plain, name)
    return usual is None or value != usual
