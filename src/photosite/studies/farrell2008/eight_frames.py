"""What eight dark frames can and cannot say about a DSNU beside read noise of its size."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameGroup
from photosite.sensor.chip import draw_chip
from photosite.sensor.noise_profile import QUANTISATION_DN2
from photosite.studies.virtual_lab import VirtualLab

_SHARE = 0.1
"""Of the DSNU: to how much of it a pixel's own offset would have to be known to be called known."""

_FALSE_ALARM = 1e-3


@dataclass(frozen=True)
class EightFrames:
    """Computed from the frames, beside what is expected of them; volts at the pixel, in mV.

    Parameters
    ----------
    frames, pixels, exposure_s
        Of the repeated darks.
    read_noise_mv, read_noise_uncertainty_mv, dsnu_mv, dsnu_uncertainty_mv
        As calibrated.
    naive_dsnu_mv, naive_expected_mv
        Spread of the mean frame, with what is left of the read noise in it; measured and expected.
    noise_left_share
        Of the mean frame's variance: read noise that averaging has left.
    many_frames_uncertainty_mv
        Of the DSNU, were the frames without number: what the number of pixels leaves.
    smallest_dsnu_mv
        The least DSNU that these frames would tell apart from none, 95 %.
    chip_spread_mv
        Spread of the offsets of the chip that was shot, which only a virtual chip tells.
    pixel_offset_error_mv, pixel_offset_expected_mv
        Root mean square error of one pixel's offset; measured against the chip, and expected.
    map_correlation, map_correlation_expected
        Of the mean frame with the chip's offsets; measured, and expected.
    frames_for_a_tenth
        Frames after which a pixel's offset is known to a tenth of the DSNU.
    pixel_variance_scatter, pixel_variance_scatter_expected
        Spread over pixels of each pixel's temporal variance, relative to its mean: chance alone; measured, expected.
    noisy_pixel_factor
        Times the read noise that a pixel must show before chance explains it in fewer than one of 1000.
    frame_level_low, frame_level_high
        Ends of the 95 % interval of a noise common to all pixels of a frame, relative to what was found.
    pixel_slope_error_mv_per_s
        Standard error of one pixel's dark voltage from the series of darks.
    slope_error_at_exposure_mv
        The same, over the exposure of the eight: how much of a pixel's offset may be dark voltage.
    can, cannot
        The same in words.
    """

    frames: int
    pixels: int
    exposure_s: float
    read_noise_mv: float
    read_noise_uncertainty_mv: float
    dsnu_mv: float
    dsnu_uncertainty_mv: float
    naive_dsnu_mv: float
    naive_expected_mv: float
    noise_left_share: float
    many_frames_uncertainty_mv: float
    smallest_dsnu_mv: float
    chip_spread_mv: float
    pixel_offset_error_mv: float
    pixel_offset_expected_mv: float
    map_correlation: float
    map_correlation_expected: float
    frames_for_a_tenth: int
    pixel_variance_scatter: float
    pixel_variance_scatter_expected: float
    noisy_pixel_factor: float
    frame_level_low: float
    frame_level_high: float
    pixel_slope_error_mv_per_s: float
    slope_error_at_exposure_mv: float

    def to_dict(self) -> dict[str, Any]:
        """All numbers by name, and the words."""
        numbers = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {**numbers, "can": list(self.can), "cannot": list(self.cannot)}

    @property
    def can(self) -> tuple[str, ...]:
        """What these frames say, with numbers."""
        return (
            f"How large the DSNU is, over the chip: {self.dsnu_mv:.4f} ± {self.dsnu_uncertainty_mv:.4f} mV. "
            f"{self.pixels} pixels stand behind it; frames without number would leave ± "
            f"{self.many_frames_uncertainty_mv:.4f} mV, because the pixels are a sample of all such chips’.",
            f"That it is not read noise in disguise. The mean of {self.frames} frames spreads by "
            f"{self.naive_dsnu_mv:.3f} mV, {100 * (self.naive_dsnu_mv / self.dsnu_mv - 1):.1f} % too much, because "
            f"{100 * self.noise_left_share:.1f} % of its variance is read noise that averaging has left "
            f"(read noise² / {self.frames}). That part is known from the same frames and is taken off.",
            f"That there is DSNU at all, were it as small as {self.smallest_dsnu_mv:.2f} mV.",
            f"How large the read noise is, on average over the pixels: {self.read_noise_mv:.4f} ± "
            f"{self.read_noise_uncertainty_mv:.4f} mV.",
        )

    @property
    def cannot(self) -> tuple[str, ...]:
        """What they leave open, with numbers."""
        low, high = self.frame_level_low, self.frame_level_high
        return (
            f"What one pixel’s offset is. It is off by {self.pixel_offset_error_mv:.2f} mV (root mean square; read "
            f"noise / √{self.frames} is {self.pixel_offset_expected_mv:.2f}), "
            f"{100 * self.pixel_offset_error_mv / self.dsnu_mv:.0f} % of the DSNU: the mean frame is the chip’s "
            f"pattern with a correlation of {self.map_correlation:.3f}. To know each pixel to a tenth of the DSNU "
            f"takes {self.frames_for_a_tenth} frames.",
            f"Which pixels are noisy. Chance alone spreads the variances of equal pixels by "
            f"{100 * self.pixel_variance_scatter:.0f} % of their mean, and of 1000 such pixels one shows more than "
            f"{self.noisy_pixel_factor:.1f} times the read noise: only what lies beyond stands out.",
            f"How much the level wanders from frame to frame. {self.frames} levels tell the size of such a noise to "
            f"between {low:.2f} and {high:.2f} times what is found, however many pixels there are. The virtual sensor "
            f"has none; a real one may.",
            f"What part of it is dark current. At one exposure, offset and dark voltage × {1e3 * self.exposure_s:g} ms "
            f"are one. The darks at other exposures tell a pixel’s dark voltage to ± "
            f"{self.pixel_slope_error_mv_per_s:.1f} mV/s, ± {self.slope_error_at_exposure_mv:.2f} mV in that time: "
            f"enough to call the pattern an offset, not to map the dark current.",
            "Whether another chip of the design has the same. One chip was measured.",
        )


def eight_frames(lab: VirtualLab, calibration: Calibration) -> EightFrames:
    """Look at the most often repeated darks of a measurement.

    Parameters
    ----------
    lab
        The measurement: its frames, and the chip that shot them.
    calibration
        What was estimated from them.

    Raises
    ------
    CalibrationError
        If read noise or DSNU could not be estimated.
    """
    from scipy.stats import chi2

    frames = lab.frame_set()
    group = max(frames.of_kind("dark"), key=len)
    sensor, count = lab.camera.sensor, len(group)
    mean, variance = _pixel_moments(group, sensor.mv_per_dn)
    pattern = draw_chip(sensor).offset_e.map().astype(np.float64) * sensor.pixel.conversion_gain_uv_per_e.value * 1e-3
    read, dsnu = calibration.read_noise_mv.measured("darks"), calibration.dsnu_mv.measured("darks")
    pixels, freedom = mean.size, count - 1
    # One frame's temporal variance has the rounding's in it; so has what averaging leaves.
    once = read.value**2 + QUANTISATION_DN2 * sensor.mv_per_dn**2
    left = once / count
    error = mean - pattern
    times = np.repeat([g.exposure_s for g in frames.of_kind("dark")], [len(g) for g in frames.of_kind("dark")])
    slope_error = math.sqrt(once / float(((times - times.mean()) ** 2).sum()))
    return EightFrames(
        frames=count,
        pixels=pixels,
        exposure_s=group.exposure_s,
        read_noise_mv=read.value,
        read_noise_uncertainty_mv=read.standard_uncertainty,
        dsnu_mv=dsnu.value,
        dsnu_uncertainty_mv=dsnu.standard_uncertainty,
        naive_dsnu_mv=float(mean.std(ddof=1)),
        naive_expected_mv=math.sqrt(dsnu.value**2 + left),
        noise_left_share=left / (dsnu.value**2 + left),
        many_frames_uncertainty_mv=dsnu.value / math.sqrt(2 * pixels),
        smallest_dsnu_mv=math.sqrt(1.645 * left * math.sqrt(2 / pixels)),
        chip_spread_mv=float(pattern.std(ddof=1)),
        pixel_offset_error_mv=float(error.std(ddof=1)),
        pixel_offset_expected_mv=math.sqrt(left),
        map_correlation=float(np.corrcoef(mean.ravel(), pattern.ravel())[0, 1]),
        map_correlation_expected=dsnu.value / math.sqrt(dsnu.value**2 + left),
        frames_for_a_tenth=math.ceil(once / (_SHARE * dsnu.value) ** 2),
        pixel_variance_scatter=float(variance.std() / variance.mean()),
        pixel_variance_scatter_expected=math.sqrt(2 / freedom),
        noisy_pixel_factor=math.sqrt(float(chi2.isf(_FALSE_ALARM, freedom)) / freedom),
        frame_level_low=math.sqrt(freedom / float(chi2.isf(0.025, freedom))),
        frame_level_high=math.sqrt(freedom / float(chi2.isf(0.975, freedom))),
        pixel_slope_error_mv_per_s=slope_error,
        slope_error_at_exposure_mv=slope_error * group.exposure_s,
    )


def _pixel_moments(group: FrameGroup, mv_per_dn: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(rows, cols) mean over the frames and unbiased variance, in mV and mV^2."""
    frames = np.stack(list(group)) * np.float64(mv_per_dn)
    return frames.mean(axis=0), frames.var(axis=0, ddof=1)
