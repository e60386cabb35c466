"""Noise power spectrum of an even field: how noise is distributed over spatial frequencies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, FieldMap, Measurement, Quantity, Result
from photosite.metrics.noise_power import NoisePower, noise_power
from photosite.metrics.tone.oecf import unit_of
from photosite.values.cfa import channel_sites, shifted
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate

Array = NDArray[np.float64]

SMOOTHED_NOISE = DiagnosticKind(
    "smoothed-noise",
    "warning",
    "The noise of an even field has less power at high spatial frequencies than at low ones.",
    "Noise reduction or interpolation averaged pixels: noise and fine detail are smaller than those of the sensor.",
    "Switch noise reduction off, or measure raw frames.",
    ("snr_*", "dynamic_range_*", "high_over_low", "density"),
    "Power of the highest quarter of the frequencies over that of the lowest.",
    "Of fields with independent noise, fewer than 1 in 10 000.",
)
SHARPENED_NOISE = DiagnosticKind(
    "sharpened-noise",
    "warning",
    "The noise of an even field has more power at middle or high spatial frequencies than at low ones.",
    "The picture was sharpened: responses and noise tell of the processing.",
    "Switch sharpening off, or measure raw frames.",
    ("snr_*", "mtf*", "acutance", "high_over_low", "density"),
    "Largest power of a quarter of the frequencies over that of the lowest.",
    "Of fields with independent noise, fewer than 1 in 10 000.",
)
LINES_IN_NOISE = DiagnosticKind(
    "lines-in-field",
    "warning",
    "What the samples of rows or columns share varies more than the noise of single samples.",
    "Bands of flickering light, strong row noise, or a frame that shows no even field: its spectrum is not of noise.",
    "Check that the frame shows an even field in steady light.",
    ("density", "high_over_low", "noise_area"),
    "Variance of rows and columns over that of the noise.",
    "Of fields with independent noise, fewer than 1 in 10 000.",
)
_QUARTERS = (0.1, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 1.0)
"""Bands of radial frequencies, over Nyquist's."""
_MATTERS, _SIGNIFICANT = 0.15, 4.0
"""Deviation of a band from the lowest that is named, and its least size in standard uncertainties."""
_CLIPPED_FRACTION = 1e-3


def _measure(image: ChartImage, chart: PlacedChart, *, size: Annotated[int, Field(ge=16, le=512)] = 64) -> Result:
    values: dict[tuple[str, str], Estimate] = {}
    curves: list[Curve] = []
    maps: list[FieldMap] = []
    diagnostics: list[Diagnostic] = []
    unit = unit_of(image)
    for channel in image.channels:
        for kind, found in _spectra(image, chart, channel, size).items():
            part = f"{channel}, {kind}" if kind else channel
            density, low = found.mean(), found.mean(*_QUARTERS[0])
            if density.value <= 0.0 or low.value <= 0.0:
                raise InputError(f"noise of channel {channel}", value=density.value, expected="above 0")
            bands = [found.mean(*band) / low for band in _QUARTERS[1:]]
            values["density", part] = Estimate.of(density, "")
            values["high_over_low", part] = Estimate.of(bands[-1], "")
            values["noise_area", part] = Estimate.of(low / density * float(found.period**2), "")
            lines = [found.line_variance(axis) for axis in (0, 1)]
            values["row_noise", part], values["column_noise", part] = (Estimate.of_variance(v, "") for v in lines)
            shared = (lines[0].value + lines[1].value) * found.period**2 / density.value
            if shared > 1.0:
                text = f"{part}: what rows and columns share has {shared:.3g} times the variance of the noise"
                diagnostics.append(LINES_IN_NOISE(text, shared))
            label = f"noise power ({unit} squared, pixel squared)"
            curves.append(Curve(part, "spatial frequency (cycles/pixel)", label, *found.radial()))
            axes = "frequency down (cycles/pixel)", "frequency across (cycles/pixel)"
            maps.append(FieldMap(part, label, found.frequency, found.frequency, found.power, axes))
            if kind == "fixed":
                continue
            named = f"{part}: the noise at the highest frequencies has {bands[-1].value:.2g} times the power"
            for kind_of, ratio, sign in (
                (SMOOTHED_NOISE, bands[-1], -1.0),
                (SHARPENED_NOISE, max(bands, key=lambda band: band.value), 1.0),
            ):
                away = sign * (ratio.value - 1.0)
                if away > max(_MATTERS, _SIGNIFICANT * ratio.standard_uncertainty):
                    if kind_of is SHARPENED_NOISE:
                        named = f"{part}: the noise of a band of frequencies has {ratio.value:.3g} times the power"
                    diagnostics.append(kind_of(f"{named} of that at the lowest", ratio.value))
    return Result(values, tuple(curves), tuple(maps), tuple(diagnostics))


def _spectra(image: ChartImage, chart: PlacedChart, channel: str, size: int) -> dict[str, NoisePower]:
    """Return the spectra of temporal noise and of the fixed pattern; of one frame, that of its noise."""
    frames = len(image.frames)
    period = 1 if image.origin == "picture" else max(len(image.cfa), len(image.cfa[0]))
    lattices = [list(_lattices(image, chart, channel, number, period)) for number in range(frames)]
    if frames == 1:
        return {"": noise_power(lattices[0], period, size)}
    means = [np.mean([lattice[site] for lattice in lattices], axis=0) for site in range(len(lattices[0]))]
    apart = (plane - mean for lattice in lattices for plane, mean in zip(lattice, means, strict=True))
    temporal = noise_power(apart, period, size, (frames - 1) / frames)
    both = noise_power(means, period, size)
    found = {"temporal": temporal}
    fixed = both.power - temporal.power / frames
    if float(np.nanmean(fixed)) > _LEAST_FIXED * float(np.nanmean(both.power)):
        share = temporal.power / frames * np.sqrt(both.periodograms / temporal.periodograms)
        found["fixed"] = replace(both, power=fixed, scatter=np.hypot(both.power, share))
    return found


_LEAST_FIXED = 0.5
"""Part of the power of the mean frame from which the fixed pattern has a spectrum of its own."""


def _lattices(image: ChartImage, chart: PlacedChart, channel: str, number: int, period: int) -> Iterator[Array]:
    """Yield the samples of each site of a channel in a frame."""
    region = chart.region
    one = replace(image, frames=(image.frames[number],))
    plane = one.plane(channel, region)[0]
    full = image.white - image.black
    sites = [(0, 0)] if image.origin == "picture" else channel_sites(shifted(image.cfa, region.r0, region.c0), channel)
    for r, c in sites:
        site = plane[r::period, c::period]
        clipped = float(((site >= full) | ((site <= -image.black) & (image.origin != "electrons"))).mean())
        if clipped > _CLIPPED_FRACTION:
            hint = "Take frames of an even field between black and white"
            what = f"fraction of {channel} pixels at 0 or white"
            raise InputError(what, value=clipped, expected=f"at most {_CLIPPED_FRACTION}", hint=hint)
        yield site


MEASUREMENT = Measurement(
    title="Noise power spectrum",
    standard="IEC 62220-1:2003, 6.3; ISO 15739:2023, annex on noise frequency components",
    charts=("uniform",),
    measure=_measure,
    quantities={
        "density": Quantity(
            "noise power",
            "signal squared, pixel squared",
            "Mean variance per unit area of frequencies in cycles/pixel.",
        ),
        "high_over_low": Quantity(
            "high over low",
            "",
            "Power in the highest quarter of frequencies over that in the lowest: 1 for white noise.",
        ),
        "noise_area": Quantity(
            "noise-equivalent area",
            "pixels squared",
            "Power at low frequencies over the variance: the area of the pixels that share their noise.",
        ),
        "row_noise": Quantity("row noise", "as frames", "Standard deviation of what all samples of a row share."),
        "column_noise": Quantity("column noise", "as frames", "The same of columns."),
    },
    oracle="white noise and noise filtered by a known kernel, in closed form",
    left_out=(
        "The text of IEC 62220-1 was not at hand: polynomials of degree 2 and rings without the axes follow its "
        "published descriptions. Blocks have a Hann window, and do not overlap. A mosaic has the spectrum of the "
        "samples of a channel, up to their Nyquist frequency. Noise is that of the signal, not of the log of exposure."
    ),
    order=25,
    headline=("high_over_low",),
    figure="curves",
)
