"""How a scene file is read: one validated object that all readers take."""

from __future__ import annotations

import math
from os import PathLike
from typing import Annotated, Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, SkipValidation

from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError, did_you_mean
from photosite.scene.picture_colors import Method, OutOfGamut
from photosite.values.validated import PositiveNumber, Validated

BRIGHTEST_CD_M2 = 1e20
"""Above any light: the sun's disc has 1.6e9 cd/m2."""

Luminance = Annotated[float, Field(gt=0, le=BRIGHTEST_CD_M2)]
Replacement = Literal["refuse", "zero"]
Interleave = Literal["bip", "bsq", "bil"]

_ALIASES = {
    "luminance": "mean_luminance_cd_m2",
    "luminance_cd_m2": "mean_luminance_cd_m2",
    "wavelengths": "wavelength_nm",
    "bands": "band_range_nm",
    "distance": "distance_m",
    "width": "width_m",
}
"""Names of options in the command line and in camera files, for hints."""


def _numbers(values: Any) -> Any:
    if values is None:
        return None
    try:
        numbers = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.size == 0 or isinstance(values, str) or not np.isfinite(numbers).all():
        raise ValueError("a list of numbers, such as [400, 410, 420]")
    return tuple(numbers.ravel().tolist())


def _range(values: Any) -> Any:
    try:
        ends = _numbers(values)
    except ValueError:
        ends = ()
    if ends is not None and not (len(ends) == 2 and 0 < ends[0] <= ends[1] < math.inf):
        raise ValueError("the first and last wavelength in nm, such as (400, 780)")
    return ends


class ReadArguments(TypedDict, total=False):
    """The fields of `ReadOptions` as keyword arguments."""

    distance_m: float
    width_m: float
    tolerance: float
    illuminant: str | float | Spectrum
    mean_luminance_cd_m2: float
    units: str
    wavelength_nm: ArrayLike
    band_range_nm: ArrayLike
    no_data: Replacement
    negative: Replacement
    sort_bands: bool
    interleave: Interleave
    variable: str
    patch_cols: int
    method: Method
    out_of_gamut: OutOfGamut


class WriteArguments(TypedDict, total=False):
    """Keyword arguments of `photosite.write_scene`; each format has some of them."""

    cube: bool
    interleave: Interleave
    version: Literal["5", "7.3"]
    half: bool


class ReadOptions(Validated):
    """How a scene file is read. None leaves an option to the file.

    Parameters
    ----------
    distance_m, width_m
        Distance from the lens and width of the scene. Where neither this nor the file gives them: 1.2 m, and a scene
        that fills the sensor.
    tolerance
        Largest RMS error of the radiance, relative to its RMS, of the reduction to few basis spectra; from 1e-6 (the
        weights are in single precision) to below 1.
    illuminant
        Light on reflectances, as for `photosite.color.illuminants.illuminant`.
    mean_luminance_cd_m2
        Luminance to scale the scene to: the mean of a chart's patches (`Scene.patches`: measured charts, and charts in
        photosite's own file), of all samples of any other scene. `Scene.mean_luminance_cd_m2` returns it. Required
        where the values of the file are relative, or its light has no absolute scale.
    units
        Of the values: see `photosite.scene.units.parse_units`. They override the units of the file, with a warning.
    wavelength_nm
        (bands,) wavelengths of the file's bands.
    band_range_nm
        (first, last) wavelength of the bands to read, both included. None: all.
    no_data
        What to do with missing values (NaN, or the file's own mark): "refuse" the file, or replace them by "zero" with
        a warning that counts them.
    negative
        What to do with values below 0: "refuse" the file, or replace them by "zero" with a warning.
    sort_bands
        Sort bands by wavelength where the file has another order; False refuses such a file.
    interleave
        Order of the axes of an HDF5 cube, where the file does not state it: "bip" (rows, columns, bands), "bsq" (bands,
        rows, columns) or "bil" (rows, bands, columns). Other formats state it themselves.
    variable
        Name of the data set or variable, where a file has several.
    patch_cols
        Patches in a row of a measured chart, whose file lists them in order.
    method
        How the colors of a display picture (PNG, JPEG, TIFF) become spectra, as for `photosite.pictures.from_rgb`;
        None: "mallett-yuksel". With "jakob-hanika" the tolerance is that of its reduction.
    out_of_gamut
        What to do with its colors that the method cannot represent, as for `photosite.pictures.from_rgb`; None:
        "refuse".

    Examples
    --------
    >>> ReadOptions(tolerance=2)
    Traceback (most recent call last):
    photosite.errors.InputError: tolerance must be below 1, got 2
    """

    distance_m: PositiveNumber | None = None
    width_m: PositiveNumber | None = None
    tolerance: Annotated[float, Field(ge=1e-6, lt=1)] = 1e-3
    illuminant: Annotated[str | float | Spectrum | None, SkipValidation] = None
    mean_luminance_cd_m2: Luminance | None = None
    units: str | None = None
    wavelength_nm: Annotated[tuple[float, ...] | None, BeforeValidator(_numbers)] = None
    band_range_nm: Annotated[tuple[float, ...] | None, BeforeValidator(_range)] = None
    no_data: Replacement = "refuse"
    negative: Replacement = "refuse"
    sort_bands: bool = False
    interleave: Interleave | None = None
    variable: str | None = None
    patch_cols: Annotated[int, Field(ge=1)] | None = None
    method: Method | None = None
    out_of_gamut: OutOfGamut | None = None

    def require(self, path: str | PathLike[str], what: str, or_else: str = "", **examples: Any) -> None:
        """Raise `FileError`, with a statement about the file, for options that are missing; with example values."""
        missing = {name: value for name, value in examples.items() if getattr(self, name) is None}
        if missing:
            hint = f"Pass {' and '.join(f'{{{name}}}' for name in missing)}{or_else}"
            raise FileError(path, what, hint=hint, arguments=missing)

    @classmethod
    def unknown(cls, name: str) -> InputError:
        """Return the error for an option that does not exist."""
        similar = f"Did you mean '{_ALIASES[name]}'?" if name in _ALIASES else did_you_mean(name, cls.model_fields)
        return InputError(f"reading a scene has no option '{name}'", hint=similar)
