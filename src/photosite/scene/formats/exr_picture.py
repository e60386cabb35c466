"""OpenEXR pictures of red, green and blue as scenes: linear light of any range, raised to spectra."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.cie import colour_science
from photosite.errors import FileError, InputError
from photosite.scene.formats.openexr import ExrPart
from photosite.scene.formats.picture import check_said
from photosite.scene.options import ReadOptions
from photosite.scene.pictures import from_hdr
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene

_BLOCK_ROWS = 256
_ROUNDING = 1e-4
"""Below 0 by this part of the brightest value is the rounding of 16-bit floats and of a change of primaries."""

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
    try:
        return from_hdr(
            np.moveaxis(_linear_srgb(part, names, options), 0, 2),
            white if mean is None else None,
            mean_luminance_cd_m2=mean,
            white="D65" if options.illuminant is None else options.illuminant,
            distance_m=options.distance_m or DEFAULT_DISTANCE_M,
            width_m=options.width_m,
            name=part.path.stem,
        )
    except InputError as error:
        raise FileError(part.path, str(error)) from None


def _linear_srgb(part: ExrPart, names: tuple[str, str, str], options: ReadOptions) -> NDArray[np.float32]:
    """(3, rows, cols) linear sRGB, none below 0."""
    to_srgb = _to_srgb(part)
    linear = np.empty((3, part.rows, part.cols), np.float32)
    for first, planes in part.blocks(names, _BLOCK_ROWS):
        block = np.tensordot(to_srgb, planes.astype(np.float64), axes=1)
        if not np.isfinite(block).all():
            if options.no_data != "zero":
                raise FileError(
                    part.path, "has values that are infinite or no numbers; mend them, or say no_data='zero'"
                )
            block[:, ~np.isfinite(block).all(axis=0)] = 0.0
        linear[:, first : first + block.shape[1]] = block
    outside = (linear < -_ROUNDING * float(linear.max())).any(axis=0)
    if outside.any() and options.negative != "zero":
        raise FileError(
            part.path,
            f"{outside.sum()} of {outside.size} pixels have colours outside sRGB, whose spectra are not known; bring "
            "them into it, or make what is below 0 zero (negative='zero')",
        )
    return np.maximum(linear, 0.0, out=linear)


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
    colour = colour_science()
    xyz = _primaries_matrix(part, values)
    white = [colour.xy_to_XYZ(np.asarray(pair)) for pair in (values[6:], SRGB_CHROMATICITIES[6:])]
    adapt = colour.adaptation.matrix_chromatic_adaptation_VonKries(white[0], white[1], transform="Bradford")
    matrix: NDArray[np.float64] = np.linalg.inv(_primaries_matrix(part, np.asarray(SRGB_CHROMATICITIES))) @ adapt @ xyz
    return matrix


def _primaries_matrix(part: ExrPart, values: NDArray[np.float64]) -> NDArray[np.float64]:
    try:
        return np.asarray(colour_science().normalised_primary_matrix(values[:6], values[6:]), np.float64)
    except np.linalg.LinAlgError:
        raise FileError(part.path, "has chromaticities on one line, which make no colours; mend its head") from None
