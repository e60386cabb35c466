"""Flicker of the light under a rolling shutter: noise that rows share, and that grows with the light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from photosite.calibration.photon_transfer.summed_covariance import BY_CHANCE, NoiseCovariance


@dataclass(frozen=True)
class Flicker:
    """Bands in the light.

    Parameters
    ----------
    share
        Standard deviation of the rows over the signal, the mean over the channels.
    period_rows
        Period of the bands in rows; None where the rows vary without a period.
    """

    share: float
    period_rows: float | None

    def __str__(self) -> str:
        period = "" if self.period_rows is None else f", with a period of {self.period_rows:.3g} rows"
        return (
            f"the light flickers: rows vary by {100 * self.share:.2g} % of the signal from frame to frame{period}, as "
            f"under a rolling shutter"
        )


def find_flicker(
    light: Sequence[NoiseCovariance], dark: Sequence[NoiseCovariance], signal_dn: Sequence[float]
) -> Flicker | None:
    """Return the flicker of the light; None where rows vary no more than in dark frames.

    Parameters
    ----------
    light, dark
        Noise covariances of the channels in flat fields and in dark frames.
    signal_dn
        Signal of the flat fields in each channel, DN.
    """
    extra = [a - b for a, b in zip(light, dark, strict=True)]
    scores = [entry.row / entry.row_uncertainty for entry in extra]
    if max(scores) < NormalDist().inv_cdf(1.0 - BY_CHANCE / len(extra)):
        return None
    shares = [max(entry.row, 0.0) / signal**2 for entry, signal in zip(extra, signal_dn, strict=True)]
    return Flicker(math.sqrt(float(np.mean(shares))), light[int(np.argmax(scores))].row_period)
