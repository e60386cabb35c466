"""The tone curve of developed pictures: light from values, measured on the gray patches of a chart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.files.small_files import read_json_object
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.tone.gray_patches import gray_patches
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_CHANNELS = "R", "G", "B"
_LEAST_PATCHES = 4


@dataclass(frozen=True, eq=False)
class ToneCurve(Shown):
    """Light against the values of a picture that was decoded as sRGB, for red, green and blue.

    Logarithms are interpolated by monotone cubic polynomials (PCHIP), and continued as powers beyond the patches.

    Parameters
    ----------
    values, light
        By channel: increasing values of patches, and their light, in any unit.

    Examples
    --------
    >>> values = np.array([0.01, 0.1, 0.3, 0.9])
    >>> curve = ToneCurve(dict.fromkeys("RGB", values), dict.fromkeys("RGB", values**2))
    >>> curve.to_light(np.full((1, 1, 3), 0.5)).round(3)
    array([[[0.278, 0.278, 0.278]]])
    """

    values: Mapping[str, Array]
    light: Mapping[str, Array]

    def __post_init__(self) -> None:
        for channel in _CHANNELS:
            for what, given in (("values", self.values), ("light", self.light)):
                found = np.asarray(given.get(channel, ()), np.float64)
                if found.size < _LEAST_PATCHES or not (found > 0).all() or not (np.diff(found) > 0).all():
                    expected = f"{_LEAST_PATCHES} or more that are above 0 and increase"
                    raise InputError(what, where=f"channel {channel}", value=found.tolist(), expected=expected)

    @classmethod
    def of_chart(cls, image: ChartImage, chart: PlacedChart) -> ToneCurve:
        """Return the curve of the gray patches of a chart in a picture.

        Raises
        ------
        InputError
            If the image is not a picture, or too few patches differ.
        """
        if image.origin != "picture":
            raise InputError("tone_curve", value="chart", expected="omitted for frames that are not pictures")
        found = {}
        for channel in _CHANNELS:
            patches = [patch for patch in gray_patches(image, chart, channel) if patch.sound]
            pairs = [(patch.mean.value, patch.luminance) for patch in patches]
            found[channel] = _increasing([pair for pair in pairs if min(pair) > 0])
        return cls(*({channel: pairs[k] for channel, pairs in found.items()} for k in (0, 1)))

    @classmethod
    def load(cls, path: Path) -> ToneCurve:
        """Read the curve that `photosite measure GRAY --chart macbeth --only oecf --json` measured.

        Raises
        ------
        FileError
            If the file is not such a JSON object.
        """
        content: Any = read_json_object(path)
        try:
            curves = {each["part"]: each for each in content["results"]["oecf"]["curves"]}
            pairs = {
                channel: _increasing(list(zip(curves[channel]["y"], curves[channel]["x"], strict=True)))
                for channel in _CHANNELS
            }
        except (ValueError, KeyError, TypeError):
            pairs = {}
        if not pairs or content.get("tone_curve") not in ("assumed", "stated"):
            expected = "the JSON of `photosite measure` on gray patches of a picture, with the measurement oecf"
            raise FileError(path, "content", expected=expected) from None
        try:
            return cls(*({channel: each[k] for channel, each in pairs.items()} for k in (0, 1)))
        except InputError as error:
            raise error.in_file(path) from None

    def to_light(self, values: NDArray[Any]) -> Array:
        """Return light of (rows, cols, 3) values; brightest patches keep their values."""
        light = np.empty(values.shape, np.float64)
        for k, channel in enumerate(_CHANNELS):
            x, y = (np.asarray(given[channel], np.float64) for given in (self.values, self.light))
            light[..., k] = _continued(values[..., k], x, y * (x[-1] / y[-1]))
        return light

    def applied(self, image: ChartImage) -> ChartImage:
        """Return a picture whose values are proportional to light."""
        if image.origin != "picture":
            raise InputError("tone_curve", expected="omitted for frames that are not pictures")
        white = float(self.to_light(np.ones((1, 1, 3))).min())
        return replace(image, frames=tuple(self.to_light(each) for each in image.frames), white=white, tone="chart")


def _increasing(pairs: list[tuple[float, float]]) -> tuple[Array, Array]:
    """Return values and light of the patches whose value is above that of all darker ones."""
    kept: list[tuple[float, float]] = []
    for value, light in sorted(pairs, key=lambda pair: pair[1]):
        if not kept or (value > kept[-1][0] and light > kept[-1][1]):
            kept.append((value, light))
    return np.array([value for value, _ in kept]), np.array([light for _, light in kept])


def _continued(values: NDArray[Any], x: Array, y: Array) -> Array:
    """Return the interpolated curve at values; 0 for values of 0 and below."""
    from scipy.interpolate import PchipInterpolator

    at, level = np.log(x), np.log(y)
    inside = PchipInterpolator(at, level)
    wanted = np.log(np.maximum(values, 1e-300))
    ends = [float(level[k + 1] - level[k]) / float(at[k + 1] - at[k]) for k in (0, at.size - 2)]
    found = inside(np.clip(wanted, at[0], at[-1]))
    found += ends[0] * np.minimum(wanted - at[0], 0.0) + ends[1] * np.maximum(wanted - at[-1], 0.0)
    return np.where(values > 0, np.exp(found), 0.0)
