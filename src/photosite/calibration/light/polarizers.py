"""Angle and extinction ratio of the polarizers of a sensor, from flat fields of polarized light."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_mask
from photosite.values.shown import Shown
from photosite.values.uncertain import COVERAGE_95, Measured

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Polarizer(Shown):
    """Measured polarizer of a channel.

    Parameters
    ----------
    angle_deg
        Angle of the electric field that it passes, 0 to below 180.
    leakage
        1 / extinction ratio; noise may make it negative.
    """

    angle_deg: Measured
    leakage: Measured

    @property
    def extinction_ratio(self) -> float:
        """Response along the angle over that across it; infinite where no light leaks through."""
        return 1.0 / self.leakage.value if self.leakage.value > 0 else math.inf

    @property
    def extinction_ratio_95(self) -> tuple[float, float]:
        """95 % interval of the extinction ratio; its upper end is infinite where the leakage is within the noise."""
        reach = COVERAGE_95 * self.leakage.standard_uncertainty
        low, high = self.leakage.value - reach, self.leakage.value + reach
        return (1.0 / high if high > 0 else math.inf), (1.0 / low if low > 0 else math.inf)


def measure_polarizers(
    flats: Mapping[float, Sequence[RawFrame]], darks: Sequence[RawFrame] = ()
) -> dict[str, Polarizer]:
    """Return the polarizer of each channel, from flat fields behind a linear polarizer at several angles.

    The mean signal of a channel is a + b cos 2 psi + c sin 2 psi, with psi the angle of the light: its angle is
    atan2(c, b) / 2, and the leakage (1 - d) / (1 + d) with d = sqrt(b^2 + c^2) / a. The uncertainty is the temporal
    noise, from the differences of frames of one angle. Errors of the stated angles, a drift of the light, and the
    leakage of the polarizer in front are not part of it: use one with an extinction ratio far above the sensor's.

    Parameters
    ----------
    flats
        Two frames or more at each angle of the polarizer in front, in degrees counterclockwise from the rows as the
        picture is seen; three angles or more, all at one exposure, none saturated.
    darks
        Frames of the same exposure time without light, whose mean is subtracted, two or more. Default: the frames'
        black level.

    Raises
    ------
    InputError
        If there are fewer than three different angles or two frames of one, frames differ or are saturated, or a
        channel receives no light.

    References
    ----------
    EMVA 1288 release 4.1 describes polarization sensors by the same three parameters of each pixel; D. H. Goldstein,
    Polarized Light, 3rd ed., 2011, chapter 5.

    Examples
    --------
    >>> noise = np.random.default_rng(1)
    >>> def behind(angle_deg):  # of pixels with an extinction ratio of 9: 1000 DN along their angle
    ...     along = np.cos(np.radians([[90 - angle_deg, 45 - angle_deg], [135 - angle_deg, -angle_deg]])) ** 2
    ...     mean = np.tile(1000 * (along + (1 - along) / 9), (8, 8))
    ...     return [RawFrame(noise.poisson(mean).astype(np.uint16), 12, (("P90", "P45"), ("P135", "P0"))) for _ in "ab"]
    >>> found = measure_polarizers({angle: behind(angle) for angle in (0, 60, 120)})["P45"]
    >>> round(found.angle_deg.value), found.angle_deg.standard_uncertainty < 0.3, round(found.extinction_ratio)
    (45, True, 9)
    """
    first = next((frames[0] for frames in flats.values() if frames), None)
    if first is None or len({angle % 180.0 for angle in flats}) < 3:
        raise InputError("flats", value=sorted(flats), expected="frames of three different angles or more")
    for frame in (*(frame for frames in flats.values() for frame in frames), *darks):
        if (frame.shape, frame.cfa, frame.bits) != (first.shape, first.cfa, first.bits):
            raise InputError("flats", expected="of one size, color filter array and bit depth")
    design, means, variances = [], [], []
    masks = {name: channel_mask(first.cfa, name, first.shape) for name in first.channels}
    dark_means, dark_variances = np.full(len(masks), first.black_level_dn), np.zeros(len(masks))
    if darks:
        dark_means, dark_variances = _means(darks, masks)
    for angle_deg, frames in flats.items():
        turn = math.radians(2.0 * angle_deg)
        design.append((1.0, math.cos(turn), math.sin(turn)))
        found, variance = _means(frames, masks)
        means.append(found - dark_means)
        variances.append(variance)
    return {
        name: _fitted(np.array(design), np.array(means)[:, k], np.array(variances)[:, k], float(dark_variances[k]))
        for k, name in enumerate(masks)
    }


def with_polarizers(sensor: Sensor, found: Mapping[str, Polarizer]) -> Sensor:
    """Return the sensor with measured polarizers; a leakage that is not above 0 is an ideal polarizer's."""
    channels = {
        name: channel.model_copy(
            update={
                "polarization_angle_deg": found[name].angle_deg.value,
                "extinction_ratio": found[name].extinction_ratio if found[name].leakage.value > 0 else None,
            }
        )
        if name in found
        else channel
        for name, channel in sensor.channels.items()
    }
    return sensor.with_(channels=channels)


def _means(frames: Sequence[RawFrame], masks: Mapping[str, NDArray[np.bool_]]) -> tuple[Array, Array]:
    """Return the mean of each channel over all frames, and the variance of this mean by temporal noise."""
    if len(frames) < 2:
        raise InputError("frames", value=len(frames), expected="two or more of each angle, and two or more dark")
    stack = np.stack([frame.dn for frame in frames]).astype(np.float64)
    if stack.max() >= min(frame.white_level_dn for frame in frames):
        raise InputError("frames", value=float(stack.max()), expected="below saturation")
    temporal = stack.var(axis=0, ddof=1)
    means = [float(stack[:, mask].mean()) for mask in masks.values()]
    return np.array(means), np.array([temporal[mask].mean() / (mask.sum() * len(frames)) for mask in masks.values()])


def _fitted(design: Array, mean: Array, variance: Array, dark_variance: float) -> Polarizer:
    """Fit a channel by weighted least squares, and propagate the noise to first order."""
    weights = 1.0 / variance
    covariance = np.linalg.inv(design.T @ (weights[:, None] * design))
    a, b, c = covariance @ (design.T @ (weights * mean))
    covariance[0, 0] += dark_variance  # a dark level off by some amount moves a alone
    if not a > 0:
        raise InputError("flats", value=float(a), expected="brighter than the darks")
    swing = math.hypot(b, c)
    d = swing / a
    turn = np.array([0.0, -c, b]) / (2.0 * swing**2)
    leak = np.array([-d, b / swing, c / swing]) / a * (-2.0 / (1.0 + d) ** 2)
    angle_u, leak_u = (math.sqrt(float(slope @ covariance @ slope)) for slope in (turn, leak))
    angle_deg = math.degrees(0.5 * math.atan2(c, b)) % 180.0
    return Polarizer(Measured(angle_deg, math.degrees(angle_u)), Measured((1.0 - d) / (1.0 + d), leak_u))
