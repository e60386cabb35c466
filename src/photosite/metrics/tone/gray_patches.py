"""Gray patches of a chart in an image: luminance, signal, temporal noise and fixed pattern of each channel."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.plane_fit import without_plane
from photosite.metrics.shared_noise import SharedNoise, inner_box
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.region import Patch
from photosite.values.shown import Shown
from photosite.values.uncertain import Uncertain, correlated

Array = NDArray[np.float64]

GRAY_CHARTS = ("macbeth", "color-checker-sg", "hdr-patches", "gray-steps", "siemens-star")
"""Charts with gray patches."""
_LEAST_PIXELS = 50
_LEAST_CORRELATION = 0.5
"""Of the signals of the patches with their luminance; less where the image does not show the chart."""
_LEAST_SIGMAS = 5.0
"""Difference of the brightest and the darkest patch over its standard uncertainty."""
_MOST_APART = 0.1
"""Part of the variance of the patches that a rising function of luminance leaves."""
_STRUCTURE, _BRIGHT = 0.01, 0.1
"""Spread of the means of the nine parts of a patch about a plane, over its signal; signal over that of the brightest
patch from which patches are judged. At 1 % blur has moved 2.6 % of the signal out of a patch."""
_CLIPPED_FRACTION = 1e-3
"""Fraction of saturated pixels, or of pixels at 0, from which a patch is left out."""


@dataclass(frozen=True, eq=False)
class GrayPatch(Shown):
    """A gray patch in one channel.

    Parameters
    ----------
    name, luminance
        The patch, and its luminance in cd/m2; relative to a perfect diffuser where the light is not known.
    mean
        Mean above black, as an estimate for the whole chip.
    temporal, fixed
        Variance of a pixel over frames, and over the pixels of an infinite number of frames after a plane is fitted to
        them; None for a single frame.
    total
        Variance over the pixels of one frame, after a plane is fitted to them.
    clipped
        Whether more than 0.1 % of the pixels are at the white level or at 0, so that mean and noise are biased.
    uneven
        Whether the patch is not even inside, as a diagnostic names it.
    light
        Light at the patch over that at the middle of the patches.
    """

    name: str
    luminance: float
    mean: Uncertain
    temporal: Uncertain | None
    fixed: Uncertain | None
    total: Uncertain
    clipped: bool
    uneven: bool = False
    light: Uncertain = field(default_factory=lambda: Uncertain(1.0))

    @property
    def sound(self) -> bool:
        """Whether mean and noise are those of the patch: it is neither clipped nor uneven."""
        return not (self.clipped or self.uneven)


def gray_patches(image: ChartImage, chart: PlacedChart, channel: str) -> list[GrayPatch]:
    """Return the gray patches of a chart in a channel, from the darkest to the brightest.

    Raises
    ------
    InputError
        If the chart has fewer than two gray patches, they are too small in the image, or the image does not show them.
    """
    return image.shared(("gray patches", chart, channel), lambda: _gray_patches(image, chart, channel))


def _gray_patches(image: ChartImage, chart: PlacedChart, channel: str) -> list[GrayPatch]:
    xyz = chart.patch_xyz
    if not len(xyz):
        raise InputError("chart", value=chart.name, expected="one with gray patches")
    scale = 1.0 if chart.known_light else chart.white_xyz[1]
    gray = [chart.patches[index] for index in np.flatnonzero(chart.gray)]
    shared = _shared_noise(image, gray, channel)
    uneven = _relative_structure(image, chart)
    light_at = _light(image, chart, channel, shared)
    found = [
        replace(
            _measured(image, patch, channel, float(y) / scale, shared),
            uneven=uneven.get(patch.name, 0.0) > _STRUCTURE,
            light=light_at(*_middle(patch)),
        )
        for patch, y in zip(gray, xyz[chart.gray, 1], strict=True)
    ]
    if len(found) < 2:
        raise InputError("gray patches of the chart", value=len(found), expected="two or more")
    check_structure(image, chart)
    signal, light = (np.array(each) for each in zip(*((p.mean.value, p.luminance) for p in found), strict=True))
    alike = float(np.corrcoef(signal, light)[0, 1]) if np.ptp(signal) > 0 else 0.0
    if alike < _LEAST_CORRELATION:
        hint = "Check the chart, its corners, and whether it is mirrored"
        expected = f"{_LEAST_CORRELATION} or more"
        raise InputError("correlation of gray patches with their luminance", value=alike, expected=expected, hint=hint)
    order = np.argsort(light, kind="stable")
    apart = 1.0 - float(np.var(_increasing(signal[order])) / np.var(signal))
    if apart > _MOST_APART:
        hint = "Focus the chart, light it evenly, and check its corners"
        expected = f"at most {_MOST_APART} of their variance"
        raise InputError("signals that no tone curve explains", value=apart, expected=expected, hint=hint)
    ordered = sorted(found, key=lambda patch: patch.luminance)
    if not (ordered[-1].mean - ordered[0].mean).beyond(_LEAST_SIGMAS):
        hint = "Give the chart more light"
        raise InputError("signal of the gray patches", expected="above their noise", hint=hint)
    return ordered


def _shared_noise(image: ChartImage, patches: Sequence[Patch], channel: str) -> SharedNoise:
    """Return how many pixels of even patches share their noise: developed pictures interpolate and filter them."""
    if image.origin != "picture":
        return SharedNoise()
    return SharedNoise.of(part for patch in patches for part in image.planes(channel, inner_box(patch)))


def _middle(patch: Patch) -> tuple[float, float]:
    return 0.5 * (patch.r0 + patch.r1), 0.5 * (patch.c0 + patch.c1)


def _light(
    image: ChartImage, chart: PlacedChart, channel: str, shared: SharedNoise
) -> Callable[[float, float], Uncertain]:
    """Return the light at a row and column over that at the middle of the chart's patches: a plane.

    It is the weighted mean of the relative slopes inside of all patches. Where they scatter by more than noise, their
    scatter is its uncertainty (R. T. Birge, Phys. Rev. 40 (1932) 207).
    """
    slopes, inverses, middles = [], [], []
    for patch in chart.patches:
        values = image.pixels(patch, channel)
        row, col = image.places(patch, channel)
        middles.append(_middle(patch))
        if values.shape[1] < _LEAST_PIXELS or _is_clipped(image, values):
            continue
        model = np.stack([np.ones(row.size), row - row.mean(), col - col.mean()], axis=1)
        inverse = np.linalg.inv(model.T @ model)
        mean_frame = values.mean(axis=0)
        fit = inverse @ (model.T @ mean_frame)
        variance = float(((mean_frame - model @ fit) ** 2).sum()) / (row.size - 3) * shared.of_mean
        if fit[0] <= _LEAST_SIGMAS * math.sqrt(variance / row.size) or variance <= 1e-24 * fit[0] ** 2:
            continue
        slopes.append(fit[1:] / fit[0])
        inverses.append(np.linalg.inv(variance * inverse[1:, 1:]) * fit[0] ** 2)
    if not slopes:
        return lambda row, col: Uncertain(1.0)
    weight = np.array(inverses)
    covariance = np.linalg.inv(weight.sum(axis=0))
    mean = covariance @ np.einsum("pij,pj->i", weight, slopes)
    apart = np.array(slopes) - mean
    freedom = 2 * len(slopes) - 2
    misfit = float(np.einsum("pi,pij,pj->", apart, weight, apart))
    down, along = correlated(mean, covariance * max(misfit / max(freedom, 1), 1.0))
    center = np.mean(middles, axis=0)
    return lambda row, col: down * (row - center[0]) + along * (col - center[1]) + 1.0


def _increasing(signal: Array) -> Array:
    from scipy.optimize import isotonic_regression

    return np.asarray(isotonic_regression(signal).x)


def check_structure(image: ChartImage, chart: PlacedChart) -> None:
    """Raise `InputError` where most bright gray patches are not even inside: blurred, or not where the corners say."""
    found = list(_relative_structure(image, chart).values())
    if found and (size := float(np.median(found))) > _STRUCTURE:
        expected = f"at most {_STRUCTURE} of their signal"
        hint = "Focus the chart, and check its corners"
        raise InputError("structure inside gray patches", value=size, expected=expected, hint=hint)


def patch_diagnostics(image: ChartImage, chart: PlacedChart) -> tuple[Diagnostic, ...]:
    """Return the diagnostic of gray patches that are not even inside, if any is."""
    uneven = {name: size for name, size in _relative_structure(image, chart).items() if size > _STRUCTURE}
    if not uneven:
        return ()
    worst = max(uneven.values())
    text = f"parts of patches differ by up to {100.0 * worst:.2g} % of the signal, beyond noise and a plane"
    return (UNEVEN_PATCHES(f"{text}: {', '.join(uneven)}", worst),)


UNEVEN_PATCHES = DiagnosticKind(
    "uneven-patches",
    "warning",
    "Gray patches are not even inside: parts of them differ by more than noise and a slope explain.",
    "A patch that holds part of its neighbor or dirt has another noise and mean: it is left out of fits over patches.",
    "Give the corners of the chart; with lens distortion, photograph it smaller, in the middle of the frame.",
    ("snr_*", "dynamic_range_db", "signal_snr_10", "fixed_pattern_percent", "exponent", "signal_per_luminance",
     "saturation", "noise_40", "noise_10", "probability"),
    "Spread of the means of nine parts of a patch over its signal.",
    "1 of 7000 patches.",
)  # fmt: skip


def _relative_structure(image: ChartImage, chart: PlacedChart) -> dict[str, float]:
    """Return the relative spread of nine parts about a plane of the bright gray patches, by name."""
    return image.shared(("structure", chart), lambda: _measured_structure(image, chart))


def _measured_structure(image: ChartImage, chart: PlacedChart) -> dict[str, float]:
    found = {}
    for patch in (patch for patch, gray in zip(chart.patches, chart.gray, strict=True) if gray):
        values = image.pixels(patch, image.sharp_channel).mean(axis=0)
        if values.size < _LEAST_PIXELS:
            continue
        row, col = image.places(patch, image.sharp_channel)
        rest = without_plane(values[None], row, col)[0]
        down, along = (np.minimum(3 * (at - at.min()) / (np.ptp(at) + 1.0), 2.0).astype(np.intp) for at in (row, col))
        cell = 3 * down + along
        count = np.maximum(np.bincount(cell, minlength=9), 1)
        excess = float(np.mean((np.bincount(cell, rest, 9) / count) ** 2 - 3.0 * rest.var() / count))  # beyond chance
        found[patch.name] = (float(values.mean()), math.sqrt(max(excess, 0.0)))
    brightest = max((mean for mean, _ in found.values()), default=0.0)
    return {name: spread / mean for name, (mean, spread) in found.items() if mean > _BRIGHT * brightest > 0.0}


def _is_clipped(image: ChartImage, values: Array) -> bool:
    ends = float((values >= image.white - image.black).mean()), float((values <= -image.black).mean())
    return image.origin != "electrons" and max(ends) > _CLIPPED_FRACTION


def _measured(image: ChartImage, patch: Patch, channel: str, luminance: float, shared: SharedNoise) -> GrayPatch:
    values = image.pixels(patch, channel)
    frames, pixels = values.shape
    if pixels < _LEAST_PIXELS:
        where = f"patch '{patch.name}'"
        raise InputError(f"pixels of channel {channel}", where=where, value=pixels, expected=f"{_LEAST_PIXELS} or more")
    row, col = image.places(patch, channel)
    freedom = pixels - 3.0 * shared.of_mean  # a plane takes the noise at low frequencies
    flat = without_plane(values, row, col)
    mean_frame = values.mean(axis=0)
    rounding = 1e-24 * float(mean_frame.mean()) ** 2  # frames without noise have a spread above 0
    spread = float((flat.mean(axis=0) ** 2).sum()) / freedom + rounding
    independent = freedom / shared.of_variance
    total_variance = _variance(float((flat**2).sum()) / frames / freedom + rounding, independent)
    temporal = fixed = None
    if frames > 1:
        size = float(values.var(axis=0, ddof=1).mean())
        temporal = _variance(size, (frames - 1) * pixels / shared.of_variance)
        fixed = _variance(spread, independent) - temporal / frames
    mean = Uncertain.of(float(mean_frame.mean()), math.sqrt(spread * shared.of_mean / pixels))
    clipped = _is_clipped(image, values)
    return GrayPatch(patch.name, luminance, mean, temporal, fixed, total_variance, clipped)


def _variance(value: float, freedom: float) -> Uncertain:
    return Uncertain.of_variance(value, value * math.sqrt(2.0 / freedom))
