"""What eight dark frames determine, and what they do not, if DSNU and read noise have similar size."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from photosite.calibration.result import Calibration
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import Block, Column, Listing, Paragraph, Subheading, Table
from photosite.sensor.chip import draw_chip
from photosite.sensor.noise_profile import QUANTISATION_DN2
from photosite.studies.farrell2008.drawing import SummaryRow, listing, paragraph, text
from photosite.studies.virtual_lab import VirtualLab

_SHARE = 0.1
"""Precision at which the offset of a pixel counts as known, relative to the DSNU."""

_FALSE_ALARM = 1e-3


@dataclass(frozen=True)
class EightFrames:
    """Values computed from repeated dark frames, as measured and as expected; in mV at the pixel.

    "Expected" values follow from read noise and DSNU; "naive" ones are of the mean frame, which includes residual read
    noise.
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
    noise_left_share: float  # of residual read noise in the variance of the mean frame
    many_frames_uncertainty_mv: float  # of the DSNU with infinitely many frames, due to the number of pixels
    smallest_dsnu_mv: float  # that these frames detect, 95 %
    chip_spread_mv: float  # standard deviation of the true offsets of this chip
    pixel_offset_error_mv: float  # RMS error of one pixel's offset, against the true chip
    pixel_offset_expected_mv: float
    map_correlation: float  # of the mean frame with the true offsets
    map_correlation_expected: float
    frames_for_a_tenth: int  # that give a pixel's offset to a tenth of the DSNU
    pixel_variance_scatter: float  # over pixels, of the temporal variance relative to its mean
    pixel_variance_scatter_expected: float  # by chance
    noisy_pixel_factor: float  # multiple of the read noise that fewer than one of 1000 equal pixels exceed by chance
    frame_level_low: float  # 95 % interval of a noise common to all pixels of a frame, relative to its estimate
    frame_level_high: float
    pixel_slope_error_mv_per_s: float  # standard error of one pixel's dark voltage from the dark series
    slope_error_at_exposure_mv: float  # the same over the exposure time of the repeated frames

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers by name, and the words."""
        return {**asdict(self), "can": list(self.can), "cannot": list(self.cannot)}

    @property
    def can(self) -> tuple[str, ...]:
        """What these frames determine."""
        excess, left = 100 * (self.naive_dsnu_mv / self.dsnu_mv - 1), 100 * self.noise_left_share
        return listing("eight_frames_can", f=self, excess=excess, left=left).lines

    @property
    def cannot(self) -> tuple[str, ...]:
        """What these frames do not determine."""
        return listing(
            "eight_frames_cannot",
            f=self,
            share=100 * self.pixel_offset_error_mv / self.dsnu_mv,
            scatter=100 * self.pixel_variance_scatter,
            milliseconds=1e3 * self.exposure_s,
        ).lines

    def blocks(self) -> tuple[Block, ...]:
        """Return the section on the page: the words, and a table of measured and expected values."""

        def row(what: str, unit: str, measured: float, expected: float, digits: int) -> tuple[str, ...]:
            return what, unit, format_number(measured, digits), format_number(expected, digits)

        offset = self.pixel_offset_error_mv, self.pixel_offset_expected_mv
        correlation = self.map_correlation, self.map_correlation_expected
        scatter = self.pixel_variance_scatter, self.pixel_variance_scatter_expected
        rows = (
            row("Standard deviation of the mean frame", "mV", self.naive_dsnu_mv, self.naive_expected_mv, 5),
            ("DSNU, estimated; true value of this chip", "mV", self.dsnu_text, format_number(self.chip_spread_mv, 5)),
            row("RMS error of a pixel’s offset", "mV", *offset, 4),
            row("Correlation of the mean frame with the true offsets", "", *correlation, 4),
            row("Standard deviation of the pixel variances over their mean", "", *scatter, 3),
        )
        numeric = (Column("Measured", numeric=True), Column("Expected", numeric=True))
        caption = f"{self.frames} dark frames: measured and expected"
        return (
            Subheading(f"What {self.frames} dark frames determine"),
            paragraph("eight_frames", frames=self.frames, milliseconds=1e3 * self.exposure_s),
            Listing(self.can),
            Paragraph("They do not determine:"),
            Listing(self.cannot),
            Table(caption, (Column("Quantity"), Column("Unit"), *numeric), rows),
        )

    def summary(self) -> SummaryRow:
        """Return the line of the DSNU."""
        words = text("eight_frames_summary", offset_mv=self.pixel_offset_error_mv)
        title = f"DSNU from {self.frames} dark frames"
        return title, "6 mV, with a read noise of 4.58 mV", f"{self.dsnu_text} mV", words

    @property
    def dsnu_text(self) -> str:
        """DSNU with its uncertainty."""
        return format_uncertain(self.dsnu_mv, self.dsnu_uncertainty_mv)


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
    dark_mv = np.stack(list(group)) * np.float64(sensor.mv_per_dn)
    mean, variance = dark_mv.mean(axis=0), dark_mv.var(axis=0, ddof=1)
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
