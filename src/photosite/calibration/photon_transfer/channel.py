"""One colour channel of the light frames, analysed: saturation, linear range and gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.dark_lines import DarkLines
from photosite.calibration.photon_transfer.photon_transfer import (
    LightLevels,
    Saturation,
    find_saturation,
    fit_gain,
    fit_response,
    gain_value,
    light_levels,
    linear_levels,
)
from photosite.calibration.photon_transfer.response_curvature import ResponseCurvature
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.values.uncertain import Missing, Value

NO_PHOTONS = Missing("the photons per pixel are not known; give them in a descriptor or a protocol")


@dataclass(frozen=True)
class Channel:
    """One colour channel of the light frames.

    Parameters
    ----------
    index
        Index of the channel in `channel_names`.
    dark
        Its dark signal and dark variance against exposure time.
    levels
        Its light levels, dark subtracted.
    saturation
        Where it saturates.
    used
        (levels,) whether a level lies in the linear range.
    gain
        System gain of this channel alone, DN/e-.
    curvature
        Curvature of its response; None where the response is straight within the noise.
    """

    index: int
    dark: DarkLines
    levels: LightLevels
    saturation: Saturation
    used: NDArray[np.bool_]
    gain: Value
    curvature: ResponseCurvature | None = None

    @classmethod
    def of(cls, index: int, lights: Sequence[GroupStatistics], dark: DarkLines, white: int) -> Channel:
        """Analyse the light levels of a channel; `white` is the full scale of the converter, DN."""
        levels = light_levels(lights, index, dark)
        saturation = find_saturation(levels, white)
        used = linear_levels(levels, saturation)
        return cls(index, dark, levels, saturation, used, gain_value(fit_gain([levels], [used])))

    def responsivity(self) -> Value:
        """Return the responsivity in DN/photon, or the reason why it is missing."""
        if not self.levels.photons_known:
            return NO_PHOTONS
        fit = fit_response(self.levels, self.used)
        return Missing("no light level lies in the linear range") if fit is None else fit.uncertain[0]


def curvature_warnings(names: Sequence[str], channels: Sequence[Channel]) -> list[str]:
    """Return a warning where the curvature exceeds half of the gain's other uncertainties."""
    for name, channel in zip(names, channels, strict=False):  # no channels without light frames
        curvature, gain = channel.curvature, channel.gain
        if curvature is None or isinstance(gain, Missing) or abs(curvature.gain) < 0.5 * gain.relative:
            continue
        of_channel = f" of channel {name}" if len(names) > 1 else ""
        return [
            f"the response{of_channel} is not straight: at zero light the system gain differs by "
            f"{100 * curvature.gain:+.2g} % and the responsivity by {100 * curvature.responsivity:+.2g} % from the "
            f"standard's straight lines; the uncertainties include this difference"
        ]
    return []
