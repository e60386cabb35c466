"""Interpixel capacitance from the covariances of the shot noise between neighboring pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.finding import Finding, SensorChanges
from photosite.calibration.photon_transfer.noise_covariance import REACH, NoiseCovariance
from photosite.sensor.effects.interpixel_capacitance import InterpixelCapacitance
from photosite.sensor.model import Sensor
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured, Uncertain

_LAGS = [(dy, dx) for dy in range(REACH + 1) for dx in range(-REACH, REACH + 1) if dy > 0 or dx > 0]
"""Neighbors on one side: those on the other have the same products."""

_LARGEST_FRACTION = 0.06
"""Largest fraction that is fitted: half of the signal in all neighbors."""


@dataclass(frozen=True)
class PixelCoupling(Finding, Shown):
    """Fractions of a pixel's signal in each next and in each diagonal neighbor; negative within chance.

    Parameters
    ----------
    side, corner
        The fractions.
    seen
        Whether neighbors are correlated beyond chance.
    """

    side: Uncertain
    corner: Uncertain
    seen: bool

    @property
    def present(self) -> bool:
        """Whether neighbors are correlated beyond chance."""
        return self.seen

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the coupling for a sensor file; that of the base where it is not seen."""
        if not self.seen or self.side.value <= 0.0:
            return {}
        side, corner = (
            Measured(max(100.0 * fraction.value, 0.0), 100.0 * fraction.standard_uncertainty, source)
            for fraction in (self.side, self.corner)
        )
        return {"interpixel_capacitance": InterpixelCapacitance(coupling_percent=side, diagonal_percent=corner)}

    def subtract(self, changes: SensorChanges) -> dict[str, Any]:
        """Return the nonuniformities before the coupling, which averages the pixels after it."""
        coupling: InterpixelCapacitance | None = changes.fields.get("interpixel_capacitance")
        if coupling is None:
            return {}
        found = {}
        for field in ("prnu_percent", "dcnu_percent"):
            if (spread := changes.measured(field)) is not None:
                size = math.sqrt(coupling.variance_factor)
                note = f"{spread.source}, before the coupling of pixels"
                found[field] = Measured(spread.value / size, spread.standard_uncertainty / size, note)
        return found


def fit_coupling(
    shot: Sequence[NoiseCovariance], tile: NDArray[np.int64], signal: Sequence[float], *, seen: bool
) -> PixelCoupling:
    """Fit the coupling to the covariances of the shot noise, which are the autocorrelation of its kernel.

    The charge of pixels that are coupled by the kernel w has the covariances sum_k w(k) w(k - lag) N(k), where N is the
    shot noise of the pixel at k: that of its color.

    Parameters
    ----------
    shot
        Noise covariances of the channels in flat fields, less those of dark frames.
    tile
        The repeating tile of channel indices.
    signal
        Mean signal of each channel, in any unit.
    seen
        Whether neighbors are correlated beyond chance.
    """
    from scipy.optimize import least_squares

    places = [(REACH + dy, REACH + dx) for dy, dx in _LAGS]
    found = np.array([[entry.covariance[place] for place in places] for entry in shot])
    error = np.array([[entry.uncertainty[place] for place in places] for entry in shot])
    variance = np.array([entry.variance for entry in shot])[:, None]

    def misfit(fractions: NDArray[np.float64]) -> NDArray[np.float64]:
        expected = _correlations(fractions, tile, np.asarray(signal, float))
        return np.asarray(((found / variance - expected) / (error / variance)).ravel())

    fit = least_squares(misfit, np.zeros(2), bounds=(-_LARGEST_FRACTION, _LARGEST_FRACTION))
    spread = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    side, corner = (Uncertain.of(float(value), float(u)) for value, u in zip(fit.x, spread, strict=True))
    return PixelCoupling(side, corner, seen)


def _correlations(
    fractions: NDArray[np.float64], tile: NDArray[np.int64], signal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (channels, lags) covariances over the variance, for fractions of next and diagonal neighbors."""
    side, corner = fractions
    row = [corner, side, corner]
    kernel = np.zeros((2 * REACH + 3, 2 * REACH + 3))
    middle = slice(REACH, REACH + 3)
    kernel[middle, middle] = [row, [side, 1.0 - 4.0 * (side + corner), side], row]
    sites, neighbors, lagged = tile.ravel(), _neighbors(tile.shape), kernel.ravel()[_lagged_places()]
    site_weights = np.array([(sites == k) / np.count_nonzero(sites == k) for k in range(len(signal))])
    belongs = np.array([sites == k for k in range(len(signal))], float)
    mixing = site_weights @ (belongs[:, neighbors] @ kernel.ravel()).T
    charge = np.linalg.solve(mixing, signal).astype(np.float64)[sites]
    covariance = site_weights @ (charge[neighbors] @ (kernel.ravel() * lagged).T)
    return np.asarray(covariance[:, 1:] / covariance[:, :1])


@cache
def _neighbors(tile: tuple[int, int]) -> NDArray[np.int64]:
    """Return the (sites, places) sites of the tile that lie at the places of a kernel around each site."""
    away = np.arange(-REACH - 1, REACH + 2)
    rows, cols = (np.add.outer(np.arange(length), away) % length for length in tile)
    return np.asarray(tile[1] * rows[:, None, :, None] + cols[None, :, None, :]).reshape(tile[0] * tile[1], -1)


@cache
def _lagged_places() -> NDArray[np.int64]:
    """Return the (lags, places) places of a kernel that lie a lag away from each; the first lag is none."""
    side = 2 * REACH + 3
    places = np.arange(side**2).reshape(side, side)
    return np.stack([np.roll(places, lag, (0, 1)).ravel() for lag in [(0, 0), *_LAGS]])
