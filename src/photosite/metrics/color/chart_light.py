"""The light of a chart: color temperature, and similarity of its spectrum to daylight or a blackbody."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import colour_science, xyz
from photosite.color.illuminants import blackbody, daylight
from photosite.color.spectrum import energy_from_photons
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.values.estimate import Estimate

Array = NDArray[np.float64]

_DAYLIGHT_FROM_K = 4000.0
_SSI_NM = np.arange(375.0, 676.0)
"""Wavelengths of the similarity index."""


def _measure(image: ChartImage, chart: PlacedChart) -> Result:
    grid = chart.scene.wavelength_nm
    light = chart.scene.light()
    temperature_k, duv = color_temperature(light, grid)
    name, reference = _reference(temperature_k)
    energy = energy_from_photons(light, grid)
    seen = np.interp(_SSI_NM, grid, energy)
    values = {
        ("cct_k", ""): Estimate(temperature_k),
        ("duv", ""): Estimate(duv),
        ("ssi", name): Estimate(spectral_similarity(seen, reference)),
    }
    axes = "wavelength (nm)", "relative energy"
    curves = (
        Curve("light", *axes, _SSI_NM, seen / seen.mean()),
        Curve(name, *axes, _SSI_NM, reference / reference.mean()),
    )
    return Result(values, curves)


def color_temperature(photons: Array, wavelength_nm: Array) -> tuple[float, float]:
    """Return the correlated color temperature in kelvin and the distance from the Planckian locus, Duv.

    References
    ----------
    Y. Ohno, "Practical use and calculation of CCT and Duv", LEUKOS 10 (2014) 47.

    Examples
    --------
    >>> from photosite.color.spectrum import photons_from_energy
    >>> grid = np.arange(380.0, 781.0, 5.0)
    >>> temperature_k, duv = color_temperature(photons_from_energy(blackbody(3000.0, grid), grid), grid)
    >>> round(temperature_k), abs(round(duv, 4))
    (3000, 0.0)
    """
    colour = colour_science()
    temperature_k, duv = colour.uv_to_CCT(colour.UCS_to_uv(colour.XYZ_to_UCS(xyz(photons, wavelength_nm))))
    return float(temperature_k), float(duv)


def _reference(temperature_k: float) -> tuple[str, Array]:
    """Return name and energy of the blackbody or, from 4000 K on, the phase of daylight of a color temperature."""
    if temperature_k < _DAYLIGHT_FROM_K:
        return f"P{temperature_k:.0f}", blackbody(temperature_k, _SSI_NM)
    if temperature_k > 25000.0:
        raise InputError("color temperature of the light in K", value=temperature_k, expected="at most 25000")
    return f"D{temperature_k:.0f}", daylight(temperature_k).at(_SSI_NM)


def spectral_similarity(energy: Array, reference: Array) -> float:
    """Return the spectral similarity index of energies at 375 to 675 nm in steps of 1 nm, not rounded.

    References
    ----------
    Academy of Motion Picture Arts and Sciences, TB-2020-001; computed by colour-science.
    """
    colour = colour_science()
    one, other = (colour.SpectralDistribution(each, _SSI_NM) for each in (energy, reference))
    return float(colour.spectral_similarity_index(one, other, round_result=False))


MEASUREMENT = Measurement(
    title="Light of the chart",
    standard="CIE 015:2018 (CCT), ANSI C78.377 (Duv), Academy TB-2020-001 (SSI)",
    charts=("macbeth", "color-checker-sg"),
    measure=_measure,
    quantities={
        "cct_k": Quantity("color temperature", "K", "Correlated color temperature of the stated light."),
        "duv": Quantity("Duv", "", "Distance from the Planckian locus in CIE 1960 u, v; positive above it."),
        "ssi": Quantity(
            "spectral similarity index",
            "",
            "100 for the spectrum of the blackbody (below 4000 K) or the phase of daylight of that color temperature.",
        ),
    },
    oracle="illuminants by definition; colour-science on its own tables of lamps",
    left_out="The light is the one that is stated for the chart; frames do not show its spectrum.",
    order=320,
    headline=("cct_k",),
    of_photograph=("cct_k", "duv", "ssi"),
)
