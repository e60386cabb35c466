"""What one may say of a scene's file beside its name; every reader takes the same."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.scene.bands import within_range
from photosite.scene.picture_colors import OutOfGamut, check_out_of_gamut
from photosite.scene.pictures import Method, check_method
from photosite.scene.scene import Scene
from photosite.scene.values import check_flag, check_luminance, check_number, check_numbers

_FINEST = 1e-6
"""Tolerance. Weights in single precision make errors up to 6e-8 themselves."""

_BLOCK_SAMPLES = 1 << 22

Amend = Literal["refuse", "zero"]


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadOptions:
    """How a scene's file is to be understood; None leaves it to the file.

    Parameters
    ----------
    distance_m, width_m
        Of the scene. Where neither this nor the file says them: 1.2 m, and a scene that fills the sensor.
    tolerance
        Largest RMS error of the radiance relative to its RMS that the reduction to few spectra may make; 1e-6 or more.
    illuminant
        Light on reflectances, as `photosite.color.illuminants.illuminant` has it.
    mean_luminance_cd_m2
        To scale the scene to: the mean of a chart's patches (`Scene.patches`: measured charts, and charts in
        photosite's own file), of all samples of anything else. `Scene.said_luminance_cd_m2` gives it back;
        `Scene.mean_luminance_cd_m2` counts a chart's gaps too. Needed where the file's values are relative, or its
        light has no absolute scale.
    units
        Of the values: see `photosite.scene.units.parse_units`. Where the file says others, these are taken, with a
        warning.
    wavelength_nm
        (bands,) of the file's bands.
    band_range_nm
        (first, last) wavelength of the bands to be taken, both included; the file's others are left out. None: all.
    no_data
        What becomes of values that are missing (NaN, or the file's own mark): "refuse" the file, or make them "zero",
        with a warning that says how many.
    negative
        What becomes of values below 0: "refuse" the file, or make them "zero", with such a warning.
    sort_bands
        Put bands in order of wavelength where the file has them in another; False refuses that.
    interleave
        Which axes of an HDF5 cube are rows, columns and bands, where the file does not say: "bip" (rows, columns,
        bands), "bsq" (bands, rows, columns) or "bil" (rows, bands, columns). Other files say it themselves.
    variable
        Name of the data set or variable, where a file has several.
    patch_cols
        Patches across a measured chart, whose file lists them in order.
    method
        How the colours of a display picture (PNG, JPEG, TIFF) become spectra, as for `photosite.pictures.from_rgb`;
        None: "mallett-yuksel". With "jakob-hanika" the tolerance is that of its reduction.
    out_of_gamut
        What becomes of its colours that the method cannot raise, as for `photosite.pictures.from_rgb`; None: "refuse".

    Raises
    ------
    InputError
        If a value cannot be.
    """

    distance_m: float | None = None
    width_m: float | None = None
    tolerance: float = 1e-3
    illuminant: str | float | Spectrum | None = None
    mean_luminance_cd_m2: float | None = None
    units: str | None = None
    wavelength_nm: ArrayLike | None = None
    band_range_nm: ArrayLike | None = None
    no_data: Amend = "refuse"
    negative: Amend = "refuse"
    sort_bands: bool = False
    interleave: str | None = None
    variable: str | None = None
    patch_cols: int | None = None
    method: Method | None = None
    out_of_gamut: OutOfGamut | None = None

    def __post_init__(self) -> None:
        for name in ("tolerance", "distance_m", "width_m", "mean_luminance_cd_m2", "patch_cols"):
            check_number(name, getattr(self, name), whole=name == "patch_cols")
        check_flag("sort_bands", self.sort_bands)
        for name in ("units", "variable"):
            if not isinstance(value := getattr(self, name), str | None):
                raise InputError(f"{name} is text, not {value!r:.40}")
        if self.wavelength_nm is not None:
            check_numbers("wavelength_nm", self.wavelength_nm)
        if self.band_range_nm is not None:
            _check_range(self.band_range_nm)
        if not _FINEST <= self.tolerance < 1:
            raise InputError(
                f"the tolerance is a fraction of the RMS radiance, from 1e-6 to below 1, not {self.tolerance}; "
                "a scene's weights are in single precision"
            )
        if self.mean_luminance_cd_m2 is not None:
            check_luminance("mean_luminance_cd_m2", self.mean_luminance_cd_m2)
        for name in ("distance_m", "width_m"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"{name} must be above 0, not {value}")
        if self.patch_cols is not None and self.patch_cols < 1:
            raise InputError(f"a chart is 1 patch across or more, not {self.patch_cols}")
        if self.interleave not in (None, "bip", "bsq", "bil"):
            raise InputError(f"interleave is 'bip', 'bsq' or 'bil', not {self.interleave!r:.40}")
        if self.method is not None:
            check_method(self.method)
        if self.out_of_gamut is not None:
            check_out_of_gamut(self.out_of_gamut)
        for name in ("no_data", "negative"):
            if getattr(self, name) not in get_args(Amend):
                raise InputError(f"{name} is 'refuse' or 'zero', not {getattr(self, name)!r}")

    def applied_to(self, scene: Scene) -> Scene:
        """A scene that came with its own radiance, put where and under the light that these say.

        Raises
        ------
        InputError
            If the light is to be changed and the scene's reflectance is not known, or there is no band in the range.
        """
        if self.band_range_nm is not None:
            scene = _of_bands(scene, within_range(scene.wavelength_nm, self.band_range_nm))
        if self.distance_m is not None or self.width_m is not None:
            scene = replace(
                scene, distance_m=self.distance_m or scene.distance_m, width_m=self.width_m or scene.width_m
            )
        if self.illuminant is not None:
            scene = scene.with_illuminant(self.illuminant)
        return scene if self.mean_luminance_cd_m2 is None else scene.with_said_luminance(self.mean_luminance_cd_m2)


def _check_range(band_range_nm: ArrayLike) -> None:
    try:
        ends = np.asarray(band_range_nm, np.float64)
    except (TypeError, ValueError):
        ends = np.empty(0)
    if ends.shape != (2,) or not 0 < ends[0] <= ends[1] < math.inf:
        raise InputError(f"band_range_nm is two wavelengths, first and last: (400, 780), not {band_range_nm!r:.40}")


def _of_bands(scene: Scene, wanted: NDArray[np.bool_]) -> Scene:
    """The scene at some of its wavelengths; its error is the most that it can be there."""
    if wanted.all():
        return scene
    if not wanted.any():
        first, last = scene.wavelength_nm[[0, -1]]
        raise InputError(
            f"there is no band in band_range_nm of those from {first:g} to {last:g} nm; choose another range"
        )
    basis, reflectance, error = scene.basis[:, wanted], scene.reflectance, scene.relative_error
    if error > 0:
        rows, cols = scene.shape
        step = max(1, _BLOCK_SAMPLES // (cols * len(basis)))
        gram = np.zeros((len(basis), len(basis)))
        for first in range(0, rows, step):
            part = scene.weights[:, first : first + step].astype(np.float64).reshape(len(basis), -1)
            gram += part @ part.T
        whole, left = (float(np.einsum("kl,kw,lw->", gram, spectra, spectra)) for spectra in (scene.basis, basis))
        error = error * math.sqrt(whole / left) if left > 0 else 0.0
    reflectance = None if reflectance is None else reflectance[:, wanted]
    grid = scene.wavelength_nm[wanted]
    return replace(scene, basis=basis, wavelength_nm=grid, reflectance=reflectance, relative_error=error)
