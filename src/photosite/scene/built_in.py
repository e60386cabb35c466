"""Built-in scenes by name: the charts and patterns of `photosite.scene.charts`."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import SkipValidation

from photosite.color.spectrum import Spectrum
from photosite.scene import charts
from photosite.scene.charts.chart import DEFAULT_LUMINANCE_CD_M2, LitChart
from photosite.scene.options import Luminance
from photosite.scene.scene import Scene
from photosite.values.validated import PositiveNumber, Validated

BUILT_IN_SCENES = (
    *("macbeth", "color-checker-sg", "uniform", "slanted-edge", "edge-star", "siemens-star", "sinusoid"),
    *("frequency-sweep", "zone-plate", "dead-leaves", "point-grid", "checkerboard", "ramp", "hdr-patches"),
)
"""Each is the function of `photosite.scene.charts` of that name."""

DEFAULT_ILLUMINANT = "A"
"""Light of the built-in scenes where none is given: the 2008 paper's."""


class LightAndPlace(Validated):
    """The light on a built-in scene, and its place; see `photosite.scene.charts.chart.Chart.under`."""

    illuminant: Annotated[str | float | Spectrum, SkipValidation] = DEFAULT_ILLUMINANT
    mean_luminance_cd_m2: Luminance = DEFAULT_LUMINANCE_CD_M2
    wavelength_nm: Any = None
    distance_m: PositiveNumber | None = None
    width_m: PositiveNumber | None = None


def chart_function(name: str) -> LitChart[...]:
    """Return the function that makes a built-in scene."""
    function: LitChart[...] = getattr(charts, name.replace("-", "_"))
    return function


def chart_options(name: str) -> dict[str, Any]:
    """Return a built-in scene's own options with their defaults.

    Examples
    --------
    >>> chart_options("slanted-edge")
    {'angle_deg': 5.0, 'contrast': 4.0, 'rows': 400, 'cols': 400}
    """
    return {option: field.default for option, field in chart_function(name).options.model_fields.items()}


def check_built_in(name: str, **options: Any) -> dict[str, Any]:
    """Return the arguments of a built-in scene, its light included, once they are valid."""
    shared = {option: value for option, value in options.items() if option in LightAndPlace.model_fields}
    light = LightAndPlace(**shared)
    own = chart_function(name).options(**{option: options[option] for option in options.keys() - shared.keys()})
    defaults = {"illuminant": light.illuminant, "mean_luminance_cd_m2": light.mean_luminance_cd_m2}
    return {**defaults, **light.given(), **own.given()}


def built_in_scene(name: str, **options: Any) -> Scene:
    """Return a built-in scene, by default under the 2008 paper's light.

    Examples
    --------
    >>> built_in_scene("slanted-edge", contrast=10, rows=20, cols=30).shape
    (20, 30)
    """
    return chart_function(name)(**check_built_in(name, **options))
