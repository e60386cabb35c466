"""How well the spectral sensitivities of a sensor can tell colors apart as the eye does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import adaptation_to_d65, color_matching_functions, lab
from photosite.color.illuminants import illuminant as light_of
from photosite.color.tables import spectra
from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]

_GRID_NM = np.arange(380.0, 781.0, 5.0)
_CHROMATIC_PATCHES = 18
_SLOPE = 5.5
_ROUNDED = 1e-4
"""Square of the color difference below which the optimized mean is smooth."""


def _measure(image: ChartImage, chart: PlacedChart, *, illuminant: str = "D55", preserve_white: bool = False) -> Result:
    sensitivity, spread = _sensitivities(image.sensor)
    setup = _Colors(illuminant, preserve_white)
    values: dict[tuple[str, str], Estimate] = {}
    best = setup.best_matrix(sensitivity)

    def mean_difference(at: Array, matrix: Callable[[Array], Array]) -> Array:
        return np.asarray(setup.differences(at, matrix(at)).mean(axis=-1))

    figures: dict[str, Callable[[Array], Array]] = {
        # The matrix is at a minimum: to first order the figure changes as if it stayed.
        "smi": lambda at: 100.0 - _SLOPE * mean_difference(at, lambda _: best),
        "smi_least_squares": lambda at: 100.0 - _SLOPE * mean_difference(at, setup.least_squares),
        "vora_value": vora_value,
        "luther_residual_percent": lambda at: 100.0 * luther_residual(at),
    }
    for name, figure in figures.items():
        values[name, ""] = _propagated(figure, sensitivity, spread)
    differences = setup.differences(sensitivity, best)
    values["delta_e_76_max", ""] = Estimate(float(differences.max()))
    number = np.arange(1.0, _CHROMATIC_PATCHES + 1.0)
    curves = []
    bars = color_matching_functions(_GRID_NM)
    fit = projector(sensitivity) @ bars.T
    for name, bar, fitted in zip("xyz", bars, fit.T, strict=True):
        axes = "wavelength (nm)", "color matching and its fit"
        curves.append(Curve(f"{name} bar", *axes, _GRID_NM, bar))
        curves.append(Curve(f"{name} bar, fit", *axes, _GRID_NM, fitted))
    curves.append(
        Curve("", "patch, in the order of the chart", "CIE 1976 difference, best matrix", number, differences)
    )
    return Result(values, tuple(curves))


def _sensitivities(sensor: Sensor | None) -> tuple[Array, Array]:
    """Return the (channels, wavelengths) responses to energy and their standard uncertainties."""
    if sensor is None:
        raise InputError("sensor", expected="given, for its spectral sensitivities")
    channels = list(sensor.channels.values())
    if len(channels) < 3:
        raise InputError("channels of the sensor", value=len(channels), expected="three or more")
    efficiency = np.array([channel.quantum_efficiency_at(_GRID_NM) for channel in channels])
    spread = np.zeros_like(efficiency)
    for i, channel in enumerate(channels):
        if channel.standard_uncertainty is not None:
            grid = channel.wavelength_nm
            spread[i] = np.interp(_GRID_NM, grid, channel.standard_uncertainty, left=0.0, right=0.0)
    scale = _GRID_NM / efficiency.max() / _GRID_NM.max()  # photons to energy; the unit is free
    return efficiency * scale, spread * scale


class _Colors:
    """The chromatic patches of the ColorChecker under a light, for the eye and for sensors.

    Their reflectances are those of the standard, which colour-science tabulates under its name.
    """

    def __init__(self, illuminant: str, preserve_white: bool) -> None:
        patches = list(spectra("color_checker").values())[:_CHROMATIC_PATCHES]
        reflectance = np.array([patch.at(_GRID_NM) for patch in patches])
        light = light_of(illuminant, _GRID_NM)
        bars = color_matching_functions(_GRID_NM)
        self._light = light * np.vstack([reflectance, np.ones_like(light)])  # the last is a perfect diffuser
        xyz = self._light @ bars.T
        self._xyz = xyz @ adaptation_to_d65(xyz[-1]).T
        self._lab = lab(self._xyz[:-1])
        self._white = preserve_white

    def least_squares(self, sensitivity: Array) -> Array:
        """Return the (..., channels, 3) matrix that fits XYZ best, and white exactly if that is asked."""
        camera = self._light @ np.swapaxes(sensitivity, -1, -2)
        patches, white = camera[..., :-1, :], camera[..., -1:, :]
        matrix = np.linalg.pinv(patches) @ self._xyz[:-1]
        if not self._white:
            return np.asarray(matrix)
        inverse = np.linalg.inv(np.swapaxes(patches, -1, -2) @ patches)
        reach = inverse @ np.swapaxes(white, -1, -2)
        return np.asarray(matrix + reach @ (self._xyz[-1:] - white @ matrix) / (white @ reach))

    def best_matrix(self, sensitivity: Array) -> Array:
        """Return the (channels, 3) matrix with the smallest mean CIE 1976 difference."""
        from scipy.optimize import minimize

        start = self.least_squares(sensitivity)
        camera = self._light @ sensitivity.T
        # Changes of the matrix in directions that leave white as it is, in units of the patches' spread.
        basis = np.eye(len(sensitivity))
        if self._white:
            basis = np.linalg.svd(camera[-1:])[2][1:].T
        _, sizes, right = np.linalg.svd(camera[:-1] @ basis, full_matrices=False)
        basis = basis @ right.T / sizes

        def matrix(change: Array) -> Array:
            return np.asarray(start + basis @ change.reshape(-1, 3))

        def error(change: Array) -> float:
            return float(np.sqrt(self.differences(sensitivity, matrix(change)) ** 2 + _ROUNDED).mean())

        found = minimize(error, np.zeros(basis.shape[1] * 3), method="BFGS", options={"gtol": 1e-4})
        return matrix(found.x) if found.fun < error(np.zeros(basis.shape[1] * 3)) else start

    def differences(self, sensitivity: Array, matrix: Array) -> Array:
        """Return the (..., patches) CIE 1976 differences."""
        camera = self._light[:-1] @ np.swapaxes(sensitivity, -1, -2)
        return np.asarray(np.linalg.norm(lab(camera @ matrix) - self._lab, axis=-1))


def projector(sensitivity: Array) -> Array:
    """Return the (..., wavelengths, wavelengths) projector on the space of (..., channels, wavelengths)."""
    return np.asarray(np.linalg.pinv(sensitivity) @ sensitivity)


def vora_value(sensitivity: Array) -> Array:
    """Return the Vora value: 1 where (..., channels, wavelengths) span the color-matching functions on the grid.

    References
    ----------
    P. L. Vora and H. J. Trussell, "Measure of goodness of a set of color-scanning filters", J. Opt. Soc. Am. A 10
    (1993) 1499.
    """
    eye = projector(color_matching_functions(_GRID_NM))
    return np.asarray(np.sum(projector(sensitivity) * eye, axis=(-1, -2)) / 3.0)


def luther_residual(sensitivity: Array) -> Array:
    """Return the RMS of what the best linear fit leaves of the color-matching functions, over their RMS."""
    bars = color_matching_functions(_GRID_NM)
    rest = bars.T - projector(sensitivity) @ bars.T
    return np.asarray(np.sqrt(np.sum(rest**2, axis=(-1, -2)) / np.sum(bars**2)))


def _propagated(figure: Callable[[Array], Array], sensitivity: Array, spread: Array) -> Estimate:
    """Return a figure with its uncertainty to first order, from sensitivities with independent errors."""
    value = float(figure(sensitivity))
    places = np.argwhere(spread > 0)
    if not len(places):
        return Estimate(value)
    steps = np.zeros((len(places), *sensitivity.shape))
    for step, (channel, line) in zip(steps, places, strict=True):
        step[channel, line] = 0.1 * spread[channel, line]
    slopes = (figure(sensitivity + steps) - figure(sensitivity - steps)) / 0.2
    return Estimate.of(Uncertain.of(value, float(np.linalg.norm(slopes))), "")


MEASUREMENT = Measurement(
    title="Sensitivity metamerism",
    standard="ISO 17321-1:2012, sensitivity metamerism index, as published descriptions give it",
    charts=("macbeth",),
    measure=_measure,
    quantities={
        "smi": Quantity(
            "sensitivity metamerism index",
            "",
            "100 - 5.5 times the mean CIE 1976 difference of 18 chromatic patches, by the matrix that minimizes it.",
        ),
        "smi_least_squares": Quantity("SMI, least squares", "", "The same with the matrix that fits XYZ best."),
        "delta_e_76_max": Quantity("max CIE 1976", "", "Largest difference of the patches with the best matrix."),
        "vora_value": Quantity("Vora value", "", "Overlap of the sensitivities' space with that of the eye, 0 to 1."),
        "luther_residual_percent": Quantity(
            "Luther residual", "%", "RMS error of the best linear fit to the color-matching functions, over their RMS."
        ),
    },
    oracle="100, 1 and 0 for color-matching functions; channels that are orthogonal to them",
    left_out=(
        "The text and the example of the standard were not at hand: patches, light (D55) and slope are from "
        "published descriptions, reflectances from colour-science. Sensitivities are those of the sensor alone."
    ),
    order=310,
    headline=("smi",),
    figure="curves",
)
