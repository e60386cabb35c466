"""OpenEXR pictures of red, green and blue as scenes: linear light of any range, raised to spectra."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.scene.io.light_picture import scene_of_light
from photosite.scene.io.openexr import ExrPart
from photosite.scene.io.picture import check_said
from photosite.scene.options import ReadOptions
from photosite.scene.picture_colors import primaries_to_srgb
from photosite.scene.scene import Scene

_BLOCK_ROWS = 256
SRGB_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""Rec. ITU-R BT.709: red, green, blue, white (x, y); what a file without the attribute has."""


def colour_channels(names: Sequence[str]) -> tuple[str, str, str] | None:
    """The names of red, green and blue, of the file itself or of its only layer that has them.

    Examples
    --------
    >>> colour_channels(["A", "B", "G", "R"]), colour_channels(["beauty.B", "beauty.G", "beauty.R", "depth.Z"])
    (('R', 'G', 'B'), ('beauty.R', 'beauty.G', 'beauty.B'))
    >>> colour_channels(["Y"]) is None
    True
    """
    layers = [name[:-1] for name in names if name == "R" or name.endswith(".R")]
    whole = [layer for layer in layers if f"{layer}G" in names and f"{layer}B" in names]
    if "" in whole:
        whole = [""]
    if len(whole) != 1:
        return None
    return f"{whole[0]}R", f"{whole[0]}G", f"{whole[0]}B"


def picture_scene(part: ExrPart, names: tuple[str, str, str], options: ReadOptions) -> Scene:
    """The light that a picture shows, its range kept: values above 1 are brighter than white.

    Red, green and blue are those of the attribute `chromaticities`. What is 1 in all three has the attribute
    `whiteLuminance`, in cd/m2, unless the options say the mean.

    Raises
    ------
    FileError
        If neither says how bright it is, the options say what a picture has no place for, or colours lie outside sRGB.
    """
    check_said(part.path, options)
    mean, white = options.mean_luminance_cd_m2, part.number("whiteLuminance")
    if mean is None and white is None:
        raise FileError(
            part.path,
            "does not say how bright its white is (whiteLuminance); say how bright the scene is "
            "(mean_luminance_cd_m2=100)",
        )
    linear = np.moveaxis(_light(part, names, options), 0, 2)
    return scene_of_light(part.path, linear, options, white if mean is None else None)


def _light(part: ExrPart, names: tuple[str, str, str], options: ReadOptions) -> NDArray[np.float32]:
    """(3, rows, cols) linear sRGB, below 0 where sRGB has no such colour."""
    to_srgb = _to_srgb(part)
    linear = np.empty((3, part.rows, part.cols), np.float32)
    for first, planes in part.blocks(names, _BLOCK_ROWS):
        if np.isinf(planes).any():
            raise FileError(part.path, "has values that are infinite; mend them, since no light is")
        block = np.tensordot(to_srgb, planes.astype(np.float64), axes=1)
        if np.isnan(block).any():
            if options.no_data != "zero":
                raise FileError(part.path, "has values that are no numbers; mend them, or say no_data='zero'")
            block[:, np.isnan(block).any(axis=0)] = 0.0
        with np.errstate(over="ignore"):  # refused with the whole picture
            linear[:, first : first + block.shape[1]] = block
    return linear


def _to_srgb(part: ExrPart) -> NDArray[np.float64]:
    """(3, 3) from the file's primaries to sRGB's, whites matched by Bradford's transform."""
    said: Any = part.attributes.get("chromaticities", SRGB_CHROMATICITIES)
    try:
        values = np.asarray(said, np.float64).ravel()
    except (TypeError, ValueError):
        raise FileError(part.path, "has chromaticities that are no numbers; mend its head") from None
    if values.shape != (8,) or not np.isfinite(values).all() or values[7] <= 0:
        raise FileError(part.path, f"has chromaticities that cannot be: {np.round(values, 4).tolist()}; mend its head")
    if np.allclose(values, SRGB_CHROMATICITIES, atol=1e-4):
        return np.eye(3)
    try:
        return primaries_to_srgb(values[:6], values[6:])
    except InputError as error:
        raise FileError(part.path, f"{error}; mend its head") from None
