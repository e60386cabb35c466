"""The response map: per-pixel slopes of the flat fields in the linear range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps import defects
from photosite.calibration.chip_maps.pixel_gain import GainSums
from photosite.calibration.evidence import Evidence
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import Level
from photosite.calibration.spatial.pixel_slopes import PixelSlopes, slope_coefficients
from photosite.engine.lazy_maps import row_strips
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.values.cfa import channel_names


@dataclass(frozen=True)
class ResponseMap:
    """Per-pixel slopes against the light axis.

    Parameters
    ----------
    slopes
        (rows, cols) float32, DN per unit of the light axis.
    variance, seconds
        (channels,) variance of a slope due to temporal noise; seconds of dark current per unit of the light axis.
    """

    slopes: NDArray[np.float32]
    variance: NDArray[np.float64]
    seconds: NDArray[np.float64]

    def relative(
        self, dark_rate: NDArray[np.float32], dark_uncertainty: NDArray[np.float32], tile: NDArray[np.int64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return each pixel's relative deviation from its channel's mean response, and its standard uncertainty.

        The dark rate and its uncertainty are (rows, cols) in DN/s, or (1, 1) zeros if unknown. The deviations take over
        the memory of the slopes, which are lost.
        """
        value, uncertainty = self.slopes, np.empty(self.slopes.shape, np.float32)
        strips = [slice(*strip) for strip in row_strips(value, tile.shape[0])]
        for k, (variance, seconds) in enumerate(zip(self.variance, self.seconds, strict=True)):
            parts = [(rows, part) for rows in strips for part in defects.sites(tile, k)]
            for rows, part in parts:
                rate, rate_uncertainty = (
                    m if m.shape == (1, 1) else m[rows][part] for m in (dark_rate, dark_uncertainty)
                )
                value[rows][part] -= seconds * rate
                uncertainty[rows][part] = np.sqrt(variance + (seconds * rate_uncertainty) ** 2)
            mean = float(np.mean(defects.channel_values(value, tile, k), dtype=np.float64))
            for rows, part in parts:
                value[rows][part] = value[rows][part] / np.float32(mean) - np.float32(1.0)
                uncertainty[rows][part] /= np.float32(mean)
        return value, uncertainty


def light_in_range(channel: Channel) -> dict[int, float]:
    """Return the light, by the index of the group, of the levels in a channel's linear range."""
    levels, used = channel.levels, channel.used & channel.levels.trusted
    return dict(zip(levels.group[used].tolist(), levels.x[used].tolist(), strict=True))


def light_groups_in_range(frames: FrameSet, channels: Sequence[Channel]) -> tuple[FrameGroup, ...]:
    """Return the light groups in any channel's linear range; none unless each channel has two levels in its range."""
    inside = [light_in_range(channel) for channel in channels]
    if not inside or min(len(set(light.values())) for light in inside) < 2:
        return ()
    lights = frames.of_kind("light")
    return tuple(lights[i] for i in sorted(set().union(*inside)))


def read_response_map(
    reader: FrameReader, evidence: Evidence, dark_variance: float, gains: GainSums | None = None
) -> ResponseMap:
    """Read the light groups once and accumulate the map of slopes.

    Levels are weighted by their expected noise, from the response and gain that the calibration found, because weights
    must be known before the first frame is read. Other weights would change the precision, not the expected value. The
    uncertainty uses the measured noise of levels with at least two frames. `gains` are the sums for the gains of the
    pixels, to which the levels are added.
    """
    names, groups = channel_names(reader.frames.cfa), reader.frames.of_kind("light")
    inside = [light_in_range(channel) for channel in evidence.light.channels]
    indexes = sorted(set().union(*inside))
    count = np.array([float(len(group)) for group in groups])
    exposure = np.array([group.exposure_s for group in groups])
    curves, gain = evidence.curves, evidence.parameters.system_gain_dn_per_e.value or 0.0
    coefficients, expected = np.zeros((len(names), len(groups))), np.zeros((len(names), len(groups)))
    for k, name in enumerate(names):
        light = inside[k]
        taken = np.array([i in light for i in indexes])
        x = np.array([light.get(i, 0.0) for i in indexes])
        response = curves[name].get("response")  # none against the signal itself
        slope = 1.0 if response is None else response.slope or 0.0
        expected[k] = dark_variance + gain * slope * x
        coefficients[k, taken] = slope_coefficients(x[taken], (count / expected[k])[taken])
    slopes = PixelSlopes((reader.frames.rows, reader.frames.cols), reader.tile)
    variance = np.zeros(len(names))
    for i, group in enumerate(groups):
        sums = reader.sums(group, variance=gains is not None)
        mean = sums.mean_frame()
        slopes.add(mean, coefficients[:, i].tolist())
        if gains is not None and len(group) > 1:
            gains.add(indexes[i], mean, sums)
        for k, totals in enumerate(sums.label_totals()):
            level = Level.of(totals)
            frame_variance = level.variance if level.repeated else expected[k, i]
            variance[k] += coefficients[k, i] ** 2 * frame_variance / level.frames
    return ResponseMap(slopes.slopes.astype(np.float32), variance, coefficients @ exposure)
