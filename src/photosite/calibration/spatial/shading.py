"""Shading: the slow part of the per-pixel response, from uneven light and vignetting."""

from __future__ import annotations

import math

from photosite.calibration.spatial.line_noise import TemporalParts
from photosite.calibration.spatial.parts import channel_parts
from photosite.calibration.spatial.pixel_slopes import PixelSlopes, SlopeSpread
from photosite.values.uncertain import Missing, Uncertain, Value

SHARE = 0.1
"""Shading, as a share of PRNU, above which a warning is given."""

SIGNIFICANCE = 3.29
"""Standard uncertainties of its variance below which shading is chance: fewer than 1 in 1000."""


def shading_variance(
    slopes: PixelSlopes, channel: int, spread: SlopeSpread, noise: Uncertain, response: float
) -> Value:
    """Return the relative variance of a channel's slopes that the high-pass filter of EMVA 1288 removes.

    The filtered parts of pixels, rows and columns are free of the filter's gain (`split_parts`), so independent pixels
    have no shading. The uncertainty is that of the filtered variance, which is larger than that of the difference, and
    that of the chance covariance of shading with pixels, rows and columns.

    Parameters
    ----------
    slopes, channel
        Map of slopes, and the index of the channel.
    spread, noise
        Statistics of the channel's slopes, and the temporal noise that was subtracted from their variance.
    response
        Mean slope, without dark current.
    """
    none = Uncertain(0.0)
    parts = channel_parts(slopes.slopes, slopes.tile, channel, TemporalParts(noise, none, none), filtered=True)
    if isinstance(parts, Missing):
        return parts
    left = spread.variance.value - parts.total.value
    lengths = (length // of_tile for length, of_tile in zip(slopes.slopes.shape, slopes.tile.shape, strict=True))
    samples = spread.pixels, *lengths
    fine = parts.pixel.value + noise.value, parts.row.value, parts.column.value
    by_chance = sum(max(variance, 0.0) / count for variance, count in zip(fine, samples, strict=True))
    together = 2.0 * math.sqrt(max(left, 0.0) * by_chance)
    uncertainty = math.hypot(parts.total.standard_uncertainty, together)
    return Uncertain.of(left / response**2, uncertainty / response**2)


def is_large(shading: Value, prnu: Value) -> bool:
    """Return whether shading is beyond chance, and more than a tenth of PRNU; both are variances."""
    if isinstance(shading, Missing) or isinstance(prnu, Missing):
        return False
    return shading.value > max(SIGNIFICANCE * shading.standard_uncertainty, SHARE**2 * prnu.value)
