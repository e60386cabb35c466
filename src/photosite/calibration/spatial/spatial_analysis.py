"""Where in the frame the fixed pattern is, and of what kind: spectrograms, profiles, histograms, far pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spatial.histograms import FarPixels, Histogram, far_pixels, histogram
from photosite.calibration.spatial.line_noise import TemporalParts
from photosite.calibration.spatial.profiles import Profile, profiles
from photosite.calibration.spatial.spatial import MARGIN, SMALLEST_SIDE, pixel_gain
from photosite.calibration.spatial.spectrogram import Spectrogram, spectrogram
from photosite.calibration.spatial.strips import Difference, Plane, high_passed, plane_mean
from photosite.values.uncertain import Missing


@dataclass(frozen=True)
class FarThresholds:
    """Deviations from the mean beyond which a pixel is a candidate for the list of defects; None: by the rule.

    Parameters
    ----------
    dark_dn
        In the mean dark frame.
    light_percent
        In the mean light frame, high-passed, in percent of the mean signal.
    """

    dark_dn: float | None = None
    light_percent: float | None = None


@dataclass(frozen=True, eq=False)
class FramePattern:
    """The pattern of one channel in one mean frame.

    Parameters
    ----------
    kind
        "dark": the mean dark frame; "light": the mean frame near half saturation less the dark.
    frames, exposure_s
        How many frames it is the mean of, and their exposure.
    unit
        "DN", or "%" of the mean signal: of spectrograms, histogram and far pixels.
    mean_dn
        The map's mean.
    horizontal, vertical
        Spectrograms of the map.
    horizontal_filtered, vertical_filtered
        Spectrograms after the standard's high-pass, which takes away uneven light.
    along_columns, along_rows
        Profiles in DN, from left to right and from top to bottom. In a mosaic, places are those of the channel.
    histogram
        Of the deviations from the mean; of light after the high-pass.
    far
        Pixels far out in the histogram.
    """

    kind: Literal["dark", "light"]
    frames: int
    exposure_s: float
    unit: Literal["DN", "%"]
    mean_dn: float
    horizontal: Spectrogram
    vertical: Spectrogram
    horizontal_filtered: Spectrogram
    vertical_filtered: Spectrogram
    along_columns: Profile
    along_rows: Profile
    histogram: Histogram
    far: FarPixels


@dataclass(frozen=True, eq=False)
class SpatialAnalysis:
    """One channel's patterns in the dark and near half saturation, for the plots of EMVA 1288 R4.0, 8.6 to 8.8."""

    dark: FramePattern
    light: FramePattern | Missing

    def to_dict(self) -> dict[str, Any]:
        """`dark` and `light`: the far pixels of each, or the reason why there is none."""
        light = self.light
        of_light = light.to_dict() if isinstance(light, Missing) else light.far.to_dict(light.unit)
        return {"dark": self.dark.far.to_dict(self.dark.unit), "light": of_light}


@dataclass(frozen=True, eq=False)
class MeanPlanes:
    """A channel's mean frame, cut into the planes of its sites in the tile.

    Parameters
    ----------
    planes, origins
        (rows, cols) each, in DN, and the row and column on the sensor of its first value.
    tile
        Rows and columns from one site to its next.
    frames, exposure_s
        How many frames it is the mean of, and their exposure.
    noise
        Temporal variance left in it, DN^2.
    """

    planes: Sequence[NDArray[np.float64]]
    origins: Sequence[tuple[int, int]]
    tile: tuple[int, int]
    frames: int
    exposure_s: float
    noise: TemporalParts

    @classmethod
    def of(
        cls,
        mean: NDArray[np.float64],
        tile: NDArray[np.int64],
        channel: int,
        frames: int,
        exposure_s: float,
        noise: TemporalParts,
    ) -> MeanPlanes:
        """Cut a mean frame."""
        origins = [(int(r), int(c)) for r, c in np.argwhere(tile == channel)]
        tile_rows, tile_cols = tile.shape
        planes = [mean[r::tile_rows, c::tile_cols] for r, c in origins]
        # Sensors whose size is no multiple of the tile have planes of different sizes; what they share is looked at.
        rows, cols = min(plane.shape[0] for plane in planes), min(plane.shape[1] for plane in planes)
        return cls(
            [plane[:rows, :cols] for plane in planes], origins, (tile_rows, tile_cols), frames, exposure_s, noise
        )

    def places(self, site: int, border: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns on the sensor of a plane's, without a border."""
        rows, cols = self.planes[site].shape
        row, col = self.origins[site]
        return (
            row + self.tile[0] * np.arange(border, rows - border),
            col + self.tile[1] * np.arange(border, cols - border),
        )


def spatial_analysis(
    dark: MeanPlanes, light: MeanPlanes | Missing, thresholds: FarThresholds | None = None
) -> SpatialAnalysis | Missing:
    """The patterns of a channel, from its mean dark frame and its mean frame near half saturation.

    Parameters
    ----------
    dark, light
        Mean frames; `light` has the dark in it.
    thresholds
        Of far pixels.

    Returns
    -------
    SpatialAnalysis or Missing
        Missing where the planes are too small for the high-pass.
    """
    smallest = min(dark.planes[0].shape)
    if smallest < SMALLEST_SIDE:
        return Missing(f"a colour plane has {smallest} pixels on its short side; the high-pass needs {SMALLEST_SIDE}")
    wanted = thresholds or FarThresholds()
    return SpatialAnalysis(
        _dark_pattern(dark, wanted.dark_dn),
        light if isinstance(light, Missing) else _light_pattern(light, dark, wanted.light_percent),
    )


def _dark_pattern(dark: MeanPlanes, threshold: float | None) -> FramePattern:
    means = [plane_mean(plane) for plane in dark.planes]
    found = histogram(dark.planes, means, grain=_grain(dark))
    far = far_pixels(dark.planes, means, [dark.places(site, 0) for site in range(len(means))], threshold)
    filtered = [high_passed(plane) for plane in dark.planes]
    return _pattern("dark", dark, dark.planes, means, filtered, dark.noise.total.value, found, far)


def _grain(frames: MeanPlanes) -> float | None:
    """Step of the mean's values; planes whose means differ by other steps share none."""
    return 1.0 / frames.frames if len(frames.planes) == 1 else None


def _light_pattern(light: MeanPlanes, dark: MeanPlanes, threshold: float | None) -> FramePattern:
    planes = [Difference(bright, black) for bright, black in zip(light.planes, dark.planes, strict=True)]
    means = [plane_mean(plane) for plane in planes]
    filtered = [high_passed(plane, 100.0 / float(np.mean(means))) for plane in planes]
    level = [plane_mean(plane) for plane in filtered]
    found = histogram(filtered, level)
    far = far_pixels(filtered, level, [light.places(site, MARGIN) for site in range(len(planes))], threshold)
    noise = light.noise.total.value + dark.noise.total.value
    return _pattern("light", light, planes, means, filtered, noise, found, far)


def _pattern(
    kind: Literal["dark", "light"],
    frames: MeanPlanes,
    planes: Sequence[Plane],
    means: Sequence[float],
    filtered: Sequence[Plane],
    noise: float,
    found: Histogram,
    far: FarPixels,
) -> FramePattern:
    mean = float(np.mean(means))
    scale = 1.0 if kind == "dark" else 100.0 / mean
    temporal = noise * scale**2
    horizontal, vertical = (spectrogram(planes, axis, scale=scale, temporal=temporal) for axis in (1, 0))
    passed = [spectrogram(filtered, axis, temporal=temporal * pixel_gain()) for axis in (1, 0)]
    along_columns, along_rows = profiles(planes)
    return FramePattern(
        kind=kind,
        frames=frames.frames,
        exposure_s=frames.exposure_s,
        unit="DN" if kind == "dark" else "%",
        mean_dn=mean,
        horizontal=horizontal,
        vertical=vertical,
        horizontal_filtered=passed[0],
        vertical_filtered=passed[1],
        along_columns=along_columns,
        along_rows=along_rows,
        histogram=found,
        far=far,
    )
