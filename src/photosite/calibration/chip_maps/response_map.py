"""The response map: per-pixel slopes of the flat fields in the linear range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps import defects
from photosite.calibration.evidence import Evidence
from photosite.calibration.photon_transfer.channel import LinearRange
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


def _abscissa(group: FrameGroup, range_: LinearRange) -> float:
    photons = group.photons_per_pixel
    return group.exposure_s if range_.abscissa == "exposure_s" or photons is None else photons


def _inside(group: FrameGroup, range_: LinearRange) -> bool:
    x, grain = _abscissa(group, range_), 1e-9 * range_.highest
    return range_.lowest - grain <= x <= range_.highest + grain and x not in range_.contradicting


def light_groups_in_range(frames: FrameSet, ranges: Mapping[str, LinearRange]) -> tuple[FrameGroup, ...]:
    """Return the light groups in any channel's linear range; none unless each channel has two levels in its range."""
    lights = frames.of_kind("light")
    for name in channel_names(frames.cfa):
        if name not in ranges or len({_abscissa(g, ranges[name]) for g in lights if _inside(g, ranges[name])}) < 2:
            return ()
    return tuple(group for group in lights if any(_inside(group, range_) for range_ in ranges.values()))


def read_response_map(reader: FrameReader, evidence: Evidence, dark_variance: float) -> ResponseMap:
    """Read the light groups once and accumulate the map of slopes.

    Levels are weighted by their expected noise, from the response and gain that the calibration found, because weights
    must be known before the first frame is read. Other weights would change the precision, not the expected value. The
    uncertainty uses the measured noise of levels with at least two frames.
    """
    names, groups = channel_names(reader.frames.cfa), reader.frames.of_kind("light")
    count = np.array([float(len(group)) for group in groups])
    exposure = np.array([group.exposure_s for group in groups])
    ranges, curves, gain = evidence.linear_range, evidence.curves, evidence.parameters.system_gain_dn_per_e.value or 0.0
    coefficients, expected = np.zeros((len(names), len(groups))), np.zeros((len(names), len(groups)))
    for k, name in enumerate(names):
        range_ = ranges[name]
        x = np.array([_abscissa(group, range_) for group in groups])
        inside = np.array([_inside(group, range_) for group in groups])
        slope = curves[name]["response"].slope or 0.0
        expected[k] = dark_variance + gain * slope * x
        coefficients[k, inside] = slope_coefficients(x[inside], (count / expected[k])[inside])
    slopes = PixelSlopes((reader.frames.rows, reader.frames.cols), reader.tile)
    variance = np.zeros(len(names))
    for i, group in enumerate(groups):
        sums = reader.sums(group)
        slopes.add(sums.mean_frame(), coefficients[:, i].tolist())
        for k, totals in enumerate(sums.label_totals()):
            level = Level.of(totals)
            frame_variance = level.variance if level.repeated else expected[k, i]
            variance[k] += coefficients[k, i] ** 2 * frame_variance / level.frames
    return ResponseMap(slopes.slopes.astype(np.float32), variance, coefficients @ exposure)
