"""Pictures of light as scenes: what Radiance and OpenEXR files of red, green and blue have in common."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.scene.options import ReadOptions
from photosite.scene.picture_colors import OutsideSrgbError
from photosite.scene.pictures import from_hdr
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene


def scene_of_light(path: Path, values: NDArray[Any], said: ReadOptions, white_luminance_cd_m2: float | None) -> Scene:
    """The scene of (rows, cols, 3) linear sRGB of any range, below 0 where sRGB has no such colour.

    Parameters
    ----------
    path
        The file, for messages.
    values
        What it holds.
    said
        Its mean luminance, where white's is None; its light; and what becomes of what is below 0.
    white_luminance_cd_m2
        Of 1 in all three.

    Raises
    ------
    FileError
        If the picture is none, or has colours outside sRGB that are not to be made zero.
    """
    try:
        return from_hdr(
            values,
            white_luminance_cd_m2,
            mean_luminance_cd_m2=said.mean_luminance_cd_m2 if white_luminance_cd_m2 is None else None,
            white="D65" if said.illuminant is None else said.illuminant,
            out_of_gamut="clip" if said.negative == "zero" else "refuse",
            distance_m=said.distance_m or DEFAULT_DISTANCE_M,
            width_m=said.width_m,
            name=path.stem,
        )
    except OutsideSrgbError as error:
        raise FileError(
            path, f"{error.counted}; bring them into it, or make what is below 0 zero (negative='zero')"
        ) from None
    except InputError as error:
        raise FileError(path, str(error)) from None
