"""Figures of spectral sensitivities that were measured with errors."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.measure import measure
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy

Array = NDArray[np.float64]

GRID = np.arange(380.0, 781.0, 5.0)
_NAMES = "smi_least_squares", "vora_value", "luther_residual_percent"


@cache
def camera() -> Sensor:
    """Return a camera whose sensitivities are exact."""
    return load_sensor("nikon-d200")


def with_sensitivities(energy: Array, spread: Array | None = None) -> Sensor:
    """Return the camera with (3, n) sensitivities to energy on the grid, with relative uncertainties."""
    efficiency = energy / GRID
    efficiency = 0.5 * efficiency / efficiency.max()
    channels = {
        name: channel.model_copy(
            update={
                "wavelength_nm": tuple(GRID),
                "quantum_efficiency": tuple(values),
                "standard_uncertainty": None if spread is None else tuple(spread * values),
            }
        )
        for (name, channel), values in zip(camera().channels.items(), efficiency, strict=True)
    }
    return camera().with_(channels=channels)


def image_of(sensor: Sensor) -> ChartImage:
    """Return a frame of a sensor; its values do not matter."""
    return ChartImage((np.full((96, 144), 100.0),), "electrons", sensor.array.cfa, sensor=sensor)


@cache
def _exact() -> tuple[Array, dict[tuple[str, str], float]]:
    """Return the sensitivities to energy, and the figures without errors."""
    energy = np.array([channel.quantum_efficiency_at(GRID) for channel in camera().channels.values()]) * GRID
    exact = measure(image_of(with_sensitivities(energy)), "macbeth", only=["sensitivity-metamerism"])
    found = exact["sensitivity-metamerism"]
    return energy, {(name, ""): float(found[name].value or 0.0) for name in _NAMES}


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    relative = random.uniform(0.002, 0.02)
    energy, truth = _exact()
    measured = with_sensitivities(
        energy * (1.0 + random.normal(0.0, relative, energy.shape)), np.full(GRID.size, relative)
    )
    return HiddenChart(image_of(measured), "macbeth", truth)


STUDY = MeasurementStudy(_draw, "errors of 0.2 to 2 % at each wavelength")
