"""Charts: reflectances without a light, and the call that puts them under one."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Generic, ParamSpec, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, create_model

from photosite.color.colorimetry import luminance_cd_m2 as luminance_of
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum, photons_from_energy, wavelength_grid
from photosite.errors import InputError, did_you_mean
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene, light_title
from photosite.values.region import Region
from photosite.values.shown import Shown
from photosite.values.validated import Validated

P = ParamSpec("P")

DEFAULT_LUMINANCE_CD_M2 = 40.0
"""The 2008 paper's."""

MOST_SAMPLES = 1 << 28

Samples = Annotated[int, Field(ge=1, le=MOST_SAMPLES)]
Contrast = Annotated[float, Field(gt=1)]
"""Radiance of the brightest over that of the darkest; `math.inf` for black."""
Degrees = Annotated[float, Field(allow_inf_nan=False)]
Frequency = Annotated[float, Field(gt=0, le=0.5)]
"""Cycles per sample; 0.5 is the highest that samples can show."""


@dataclass(frozen=True, eq=False)
class Chart(Shown):
    """Reflectances on a plane, without a light.

    Parameters
    ----------
    weights
        (K, rows, cols) float32; a sample is the mean over its own rectangle.
    name
        Name of the chart.
    wavelength_nm, reflectance
        (wavelengths,) and (K, wavelengths): the reflectance is `weights` times these spectra. None: gray, 1 at all
        wavelengths.
    regions
        Named rectangles of samples, such as patches.
    patches
        Whether the luminance is the mean of the patches, the regions, without the black between them.
    patch_reflectance
        (patches, wavelengths), patches of equal area whose mean has the luminance. None: it is the mean of all samples,
        times `luminance_factor`.
    luminance_factor
        Mean luminance of all samples over the chart's luminance.
    relative_error
        RMS error of the reflectances relative to their RMS, where they were reduced to few spectra.
    transmissive
        Whether it is film in front of a light: its reflectances are transmittances.

    Examples
    --------
    >>> from photosite.scene import charts
    >>> charts.ramp.chart(contrast=100, cols=64).under("D65", 100).shape
    (64, 64)
    """

    weights: NDArray[np.float32]
    name: str
    wavelength_nm: NDArray[np.float64] | None = None
    reflectance: NDArray[np.float64] | None = None
    regions: tuple[Region, ...] = ()
    patches: bool = False
    patch_reflectance: NDArray[np.float64] | None = None
    luminance_factor: float = 1.0
    relative_error: float = 0.0
    transmissive: bool = False

    def under(
        self,
        illuminant: str | float | Spectrum,
        mean_luminance_cd_m2: float = DEFAULT_LUMINANCE_CD_M2,
        *,
        wavelength_nm: ArrayLike | None = None,
        distance_m: float = DEFAULT_DISTANCE_M,
        width_m: float | None = None,
        rule: Rule = "trapezoid",
    ) -> Scene:
        """Return the scene of the chart under a light.

        Parameters
        ----------
        illuminant
            As for `photosite.color.illuminants.illuminant`.
        mean_luminance_cd_m2
            Mean luminance of the patches of a chart of patches, of all samples of any other chart.
        wavelength_nm
            (wavelengths,) of the scene, for gray charts; a colored chart has its own.
        distance_m
            From the lens to the chart.
        width_m
            Width of the chart with its border; None fills the sensor.
        rule
            Integration rule of the luminance.

        Raises
        ------
        InputError
            If the illuminant is unknown or does not cover the wavelengths, or the luminance is negative.
        """
        if self.wavelength_nm is not None and wavelength_nm is not None:
            raise InputError(f"the wavelengths of '{self.name}' are fixed", hint="Omit wavelength_nm")
        grid = wavelength_grid(DEFAULT_WAVELENGTH_NM if wavelength_nm is None else wavelength_nm)
        if self.wavelength_nm is not None:
            grid = self.wavelength_nm
        light = photons_from_energy(relative_energy(illuminant, grid), grid)
        reflectance = np.ones((1, grid.size)) if self.reflectance is None else self.reflectance
        scene = Scene(
            *(self.weights, reflectance * light, grid, distance_m, width_m, self.regions),
            name=f"{self.name}, illuminant {light_title(illuminant)}",
            reflectance=reflectance,
            relative_error=self.relative_error,
            patches=self.patches,
        )
        if self.patch_reflectance is None:
            return scene.with_sample_luminance(mean_luminance_cd_m2 * self.luminance_factor, rule)
        if not (math.isfinite(mean_luminance_cd_m2) and mean_luminance_cd_m2 >= 0):
            raise InputError("mean_luminance_cd_m2", value=mean_luminance_cd_m2, expected="0 or more")
        # The patches have equal areas, so their mean luminance is that of the mean spectrum.
        mean = float(luminance_of((self.patch_reflectance * light).mean(axis=0), grid, rule))
        if not mean > 0:
            raise InputError(f"'{self.name}' under this light has no luminance, so it cannot be scaled to one")
        return scene.scaled(mean_luminance_cd_m2 / mean)


def gray_chart(pattern: NDArray[np.floating], name: str, **fields: Any) -> Chart:
    """Return a chart of grays from (rows, cols) reflectances from 0 to 1."""
    return Chart(pattern[None].astype(np.float32, copy=False), name, **fields)


def between(fraction: NDArray[np.float64], contrast: float) -> NDArray[np.float64]:
    """Return reflectances from fractions of bright, 0 to 1: dark is 1 / contrast and bright is 1."""
    dark = dark_fraction(contrast)
    return dark + (1.0 - dark) * fraction


def dark_fraction(contrast: float) -> float:
    """Return the reflectance of the dark over that of the bright."""
    return 0.0 if math.isinf(contrast) else 1.0 / contrast


class LitChart(Generic[P]):
    """A function that makes a chart, called with a light: `macbeth("D65")` is `macbeth.chart().under("D65")`.

    The chart's own options are validated by their annotations. `illuminant` is the light where none is given.
    """

    __name__: str

    def __init__(self, function: Callable[P, Chart], illuminant: str) -> None:
        functools.update_wrapper(self, function)
        self._function, self._illuminant = function, illuminant
        own = inspect.signature(function).parameters
        self._colored = "wavelength_nm" in own
        shared = inspect.signature(self.__call__).parameters
        keyword = {name: entry for name, entry in (own | shared).items() if entry.kind is entry.KEYWORD_ONLY}
        positional = [shared["illuminant"].replace(default=illuminant), shared["mean_luminance_cd_m2"]]
        self.__signature__ = inspect.Signature([*positional, *keyword.values()], return_annotation=Scene)

    def __reduce__(self) -> str:
        return self.__name__

    @functools.cached_property
    def options(self) -> type[Validated]:
        """The model of the chart's own options."""
        function, title = self._function, self.__name__.replace("_", "-")

        class Options(Validated):
            @classmethod
            def unknown(cls, name: str) -> InputError:
                known = list(cls.model_fields)
                hint = did_you_mean(name, known) if known else "It has no options"
                return InputError(f"the chart '{title}' has no option '{name}'", hint=hint)

        hints = get_type_hints(function, include_extras=True)
        own: dict[str, Any] = {
            name: (hints[name], entry.default)
            for name, entry in inspect.signature(function).parameters.items()
            if name != "wavelength_nm"
        }
        return create_model(f"{title} options", __base__=Options, **own)

    def chart(self, *args: P.args, **options: P.kwargs) -> Chart:
        """Return the chart, without a light."""
        grid = {"wavelength_nm": options.pop("wavelength_nm")} if "wavelength_nm" in options else {}
        values = self.options(**options)
        given = {name: getattr(values, name) for name in self.options.model_fields}
        if given.get("rows", 1) * given.get("cols", 1) > MOST_SAMPLES:
            raise InputError(f"{given['rows']} x {given['cols']} samples are too many", hint="Use fewer rows or cols")
        return self._function(*args, **given, **grid)  # type: ignore[arg-type]

    def __call__(
        self,
        illuminant: str | float | Spectrum | None = None,
        mean_luminance_cd_m2: float = DEFAULT_LUMINANCE_CD_M2,
        *,
        wavelength_nm: ArrayLike | None = None,
        distance_m: float = DEFAULT_DISTANCE_M,
        width_m: float | None = None,
        rule: Rule = "trapezoid",
        **options: Any,
    ) -> Scene:
        grid = {} if wavelength_nm is None else {"wavelength_nm": wavelength_nm}
        chart: Callable[..., Chart] = self.chart
        return chart(**options, **(grid if self._colored else {})).under(
            self._illuminant if illuminant is None else illuminant,
            mean_luminance_cd_m2,
            distance_m=distance_m,
            width_m=width_m,
            rule=rule,
            **({} if self._colored else grid),
        )


def lit(illuminant: str = "D65") -> Callable[[Callable[P, Chart]], LitChart[P]]:
    """Let a function that returns a `Chart` be called with a light, to return a scene."""
    return lambda function: LitChart(function, illuminant)
