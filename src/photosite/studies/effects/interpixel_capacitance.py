"""Interpixel capacitance, with a tenth of the coupling to the diagonal neighbors; crosstalk of charge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.sensor.effects.interpixel_capacitance import InterpixelCapacitance
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import AT_SATURATION, Drawing, EffectStudy, Range, TrueTerms, log_uniform
from photosite.studies.plain_camera import Disturbance, convolved


def _draw(drawing: Drawing, percent: Range) -> dict[str, Any]:
    fraction = drawing.between(*percent)
    return {"interpixel_capacitance": {"coupling_percent": fraction, "diagonal_percent": 0.1 * fraction}}


def _terms(coupling: InterpixelCapacitance, sensor: Sensor, efficiencies: Sequence[float] | None) -> TrueTerms:
    """Return what the averaging of neighbors leaves of the nonuniformities."""
    percent = coupling.coupling_percent.value
    prnu_factor = averaged = math.sqrt(coupling.variance_factor)
    border = 0.0
    if efficiencies is not None:
        cfa = sensor.array.cfa
        signal = np.array([[efficiencies[sensor.channel_names.index(name)] for name in row] for row in cfa])
        prnu_factor, border = _averaged(coupling.kernel(), signal, (sensor.array.rows, sensor.array.cols))
    return TrueTerms(
        prnu_factor=prnu_factor,
        dcnu_factor=averaged,
        border_gain=border,
        parameters={"interpixel_coupling_percent": percent},
        undefined=AT_SATURATION if percent else (),  # the mean of coupled pixels clips in another way
    )


def _averaged(kernel: NDArray[np.float64], signal: NDArray[np.float64], shape: tuple[int, int]) -> tuple[float, float]:
    """Return what a 3 x 3 kernel leaves of a PRNU of 1, and the relative spread of the mean signal at the borders.

    Both are the root mean square over the pixels. `signal` is the mean signal of a tile before the kernel: a pixel
    receives signal and pattern of neighbors of other colors. Beyond the borders the outer pixels repeat, so that the
    outer pixels of a mosaic have neighbors of their own color.
    """
    tiles = [-(-size // step) for size, step in zip(shape, signal.shape, strict=True)]
    padded = np.pad(np.tile(signal, tiles)[: shape[0], : shape[1]], 1, "edge")
    mean, square = np.zeros(shape), np.zeros(shape)
    for (row, column), fraction in np.ndenumerate(kernel):
        part = fraction * padded[row : row + shape[0], column : column + shape[1]]
        mean += part
        square += part**2
    rows, columns = signal.shape
    sites = [mean[row::rows, column::columns] for row in range(rows) for column in range(columns)]
    border = np.mean([(site.std() / site.mean()) ** 2 for site in sites])
    return float(np.sqrt(np.mean(square / mean**2))), float(np.sqrt(border))


def _disturb(sensor: Sensor, rng: np.random.Generator) -> tuple[Disturbance, dict[str, float]]:
    """Draw crosstalk of 0.5 to 3 % of the charge to each next pixel."""
    a = log_uniform(rng, 0.005, 0.03)
    weights = ((0.0, a, 0.0), (a, 1.0 - 4.0 * a, a), (0.0, a, 0.0))
    spread = float(np.linalg.norm(weights))
    factors = dict.fromkeys(("prnu_percent", "prnu1288_percent", "dcnu_percent"), spread)
    return Disturbance(charge=convolved(weights)), factors | {"interpixel_coupling_percent": a}


STUDY = EffectStudy(draw=_draw, terms=_terms, disturb=_disturb, planned=False)
