"""What eight dark frames determine, and what they do not, if DSNU and read noise have similar size."""

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
"""Precision at which the offset of a pixel counts as known, relative to the DSNU."""

_FALSE_ALARM = 1e-3


@dataclass(frozen=True)
class EightFrames:
    """Values computed from the frames, and their expectation; in mV at the pixel.

    Parameters
    ----------
    frames, pixels, exposure_s
        Of the repeated dark frames.
    read_noise_mv, read_noise_uncertainty_mv, dsnu_mv, dsnu_uncertainty_mv
        As calibrated.
    naive_dsnu_mv, naive_expected_mv
        Standard deviation of the mean frame, which includes residual read noise; measured and expected.
    noise_left_share
        Share of residual read noise in the variance of the mean frame.
    many_frames_uncertainty_mv
        Uncertainty of the DSNU with infinitely many frames, due to the number of pixels.
    smallest_dsnu_mv
        Smallest DSNU that these frames detect, 95 %.
    chip_spread_mv
        Standard deviation of the true offsets of this chip.
    pixel_offset_error_mv, pixel_offset_expected_mv
        RMS error of one pixel's offset; measured against the true chip, and expected.
    map_correlation, map_correlation_expected
        Correlation of the mean frame with the true offsets; measured and expected.
    frames_for_a_tenth
        Frames that give a pixel's offset to a tenth of the DSNU.
    pixel_variance_scatter, pixel_variance_scatter_expected
        Standard deviation over pixels of the temporal variance relative to its mean; measured, and expected by chance.
    noisy_pixel_factor
        Multiple of the read noise that fewer than one of 1000 equal pixels exceed by chance.
    frame_level_low, frame_level_high
        95 % interval of a noise common to all pixels of a frame, relative to its estimate.
    pixel_slope_error_mv_per_s
        Standard error of one pixel's dark voltage from the dark series.
    slope_error_at_exposure_mv
        The same over the exposure time of the eight frames.
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
        """Return all numbers by name, and the words."""
        numbers = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {**numbers, "can": list(self.can), "cannot": list(self.cannot)}

    @property
    def can(self) -> tuple[str, ...]:
        """What these frames determine."""
        return (
            f"The size of the DSNU over the chip: {self.dsnu_mv:.4f} ± {self.dsnu_uncertainty_mv:.4f} mV, from "
            f"{self.pixels} pixels. Infinitely many frames would leave ± {self.many_frames_uncertainty_mv:.4f} mV, "
            "because the pixels are a sample of all such chips.",
            f"That the DSNU is not residual read noise. The standard deviation of the mean of {self.frames} frames is "
            f"{self.naive_dsnu_mv:.3f} mV, {100 * (self.naive_dsnu_mv / self.dsnu_mv - 1):.1f} % too large, because "
            f"{100 * self.noise_left_share:.1f} % of its variance is residual read noise (read noise² / "
            f"{self.frames}). This part is known from the same frames and is subtracted.",
            f"That there is DSNU, down to {self.smallest_dsnu_mv:.2f} mV.",
            f"The read noise, averaged over the pixels: {self.read_noise_mv:.4f} ± "
            f"{self.read_noise_uncertainty_mv:.4f} mV.",
        )

    @property
    def cannot(self) -> tuple[str, ...]:
        """What these frames do not determine."""
        low, high = self.frame_level_low, self.frame_level_high
        return (
            f"The offset of a single pixel. Its RMS error is {self.pixel_offset_error_mv:.2f} mV (read noise / "
            f"√{self.frames} is {self.pixel_offset_expected_mv:.2f}), "
            f"{100 * self.pixel_offset_error_mv / self.dsnu_mv:.0f} % of the DSNU; the mean frame and the pattern of "
            f"the chip have a correlation of {self.map_correlation:.3f}. Each pixel to a tenth of the DSNU takes "
            f"{self.frames_for_a_tenth} frames.",
            f"Which pixels are noisy. By chance the variances of equal pixels differ by "
            f"{100 * self.pixel_variance_scatter:.0f} % of their mean, and one of 1000 such pixels exceeds "
            f"{self.noisy_pixel_factor:.1f} times the read noise.",
            f"The variation of the level from frame to frame. {self.frames} levels give such a noise to between "
            f"{low:.2f} and {high:.2f} times its estimate, however many pixels there are. The virtual sensor has none; "
            "a real one may have some.",
            f"How much of the pattern is dark current. At one exposure time, offset and dark voltage × "
            f"{1e3 * self.exposure_s:g} ms cannot be separated. The dark frames at other exposure times give the dark "
            f"voltage of a pixel to ± {self.pixel_slope_error_mv_per_s:.1f} mV/s, ± "
            f"{self.slope_error_at_exposure_mv:.2f} mV in that time: enough to identify the pattern as offset, not "
            "enough to map the dark current.",
            "Whether another chip of the same design has the same values. One chip was measured.",
        )


def eight_frames(lab: VirtualLab, calibration: Calibration) -> EightFrames:
    """Evaluate the exposure time with the most dark frames of a measurement.

    Parameters
    ----------
    lab
        Laboratory that made the frames, with the true chip.
    calibration
        Result of their calibration.

    Raises
    ------
    CalibrationError
        If read noise or DSNU was not estimated.
    """
    from scipy.stats import chi2

    frames = lab.frame_set()
    group = max(frames.of_kind("dark"), key=len)
    sensor, count = lab.camera.sensor, len(group)
    mean, variance = _pixel_moments(group, sensor.mv_per_dn)
    pattern = draw_chip(sensor).offset_e.map().astype(np.float64) * sensor.pixel.conversion_gain_uv_per_e.value * 1e-3
    read, dsnu = calibration.read_noise_mv.measured("darks"), calibration.dsnu_mv.measured("darks")
    pixels, freedom = mean.size, count - 1
    # The temporal variance of a frame includes that of rounding.
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
    """Return (rows, cols) mean and unbiased variance over the frames, in mV and mV^2."""
    frames = np.stack(list(group)) * np.float64(mv_per_dn)
    return frames.mean(axis=0), frames.var(axis=0, ddof=1)
