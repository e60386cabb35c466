"""Compare measured frames with simulated frames: patch means, noise, colors, and a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.charts.color_checker import Chart, chart_regions, chart_xyz_d65
from photosite.metrics.patches import PatchStatistics, patch_statistics
from photosite.validation.agreement import (
    SharedNoise,
    check_verdict_settings,
    chi_square_of_means,
    chi_square_of_noise,
    chi_square_of_temporal_noise,
    compared,
    dependence,
)
from photosite.validation.regression import regressions
from photosite.validation.result import Validation, compare_colors
from photosite.values.cfa import tile_text
from photosite.values.choice import check_choice
from photosite.values.region import Region

Frames = RawFrame | Sequence[RawFrame]


def validate(
    measured: Frames,
    simulated: Frames,
    chart: str | None = "macbeth",
    *,
    regions: Sequence[Region] | None = None,
    reference_xyz: ArrayLike | None = None,
    level: float = 0.05,
    tolerance_percent: float = 0.0,
) -> Validation:
    """Compare measured frames with simulated frames of the same chart, on the raw mosaic.

    The verdict is based on two chi-square tests, of patch means and of the noise over pixels. Where both sides are
    stacks of frames, a third tests the noise from frame to frame. The tests share the false-alarm rate evenly. Color
    differences are reported and have no test of their own. A fixed pattern that both share, as frames of one chip do,
    is taken into account. Saturated channels of patches are left out, and patches with a saturated channel have no
    color difference; `notes` lists them.

    Parameters
    ----------
    measured, simulated
        One frame, or several of the same scene and settings.
    chart
        "macbeth", or None for other patches.
    regions
        Regions of the patches, with the chart's patch names; None for a chart that fills the frame.
    reference_xyz
        (patches, 3) tristimulus values under D65, Y = 1 for the perfect white; None uses the chart's. Without a chart
        and without these there are no color differences.
    level
        False-alarm rate of the verdict, between 0 and 1.
    tolerance_percent
        Relative tolerance of means and noise, in percent. With 0, every difference beyond the noise counts; many pixels
        resolve a tenth of a percent.

    Raises
    ------
    InputError
        If the frames are not RawFrames; two measured frames are identical; sizes, CFAs or bit depths differ; the chart
        or a patch is unknown; regions are missing or outside the frame; every patch is saturated; or the level or
        tolerance is invalid.

    Warns
    -----
    PhotositeWarning
        If a simulated frame equals a measured one, or both were simulated with one seed; such frames are tested as
        independent ones.

    Notes
    -----
    The comparison of Farrell, Okincha and Parmar (2008), section 3, with the noise taken into account.

    Examples
    --------
    >>> rng = np.random.default_rng(3)
    >>> light = np.repeat(np.arange(1, 5) * 400.0, 20)[:, None] * np.ones(40)
    >>> frames = [RawFrame(rng.poisson(light).astype(np.uint16), bits=12) for _ in range(2)]
    >>> patches = [Region(f"gray {i}", 20 * i, 20 * i + 20, 0, 40) for i in range(4)]
    >>> result = validate(*frames, chart=None, regions=patches)
    >>> result.agrees, abs(result.regression.slope.value - 1) < 0.01
    (True, True)
    """
    first_measured, first_simulated = _first(measured, "measured"), _first(simulated, "simulated")
    _check_same_kind(first_measured, first_simulated)
    check_repeats([measured] if isinstance(measured, RawFrame) else measured)
    patches = _patches(chart, regions, first_measured)
    seen, made = patch_statistics(measured, patches), patch_statistics(simulated, patches)
    one, other = ([frames] if isinstance(frames, RawFrame) else frames for frames in (measured, simulated))
    shared, notes = dependence(one, other, patches)
    reference = _reference(chart, seen.names, reference_xyz)
    found = compare_patches(
        seen, made, reference, level=level, tolerance_percent=tolerance_percent, shared=shared, notes=notes
    )
    return replace(found, exposures_s=(first_measured.exposure_s, first_simulated.exposure_s))


def compare_patches(
    measured: PatchStatistics,
    simulated: PatchStatistics,
    reference_xyz: NDArray[np.float64] | None = None,
    *,
    level: float = 0.05,
    tolerance_percent: float = 0.0,
    fitted: int = 0,
    shared: SharedNoise | None = None,
    notes: Sequence[str] = (),
) -> Validation:
    """Compare the statistics of the same patches and channels, in the same order, as `validate` does.

    `fitted` is the number of parameters of the simulation that were fitted to the measured patch means; `shared` are
    the covariances of both, None for frames of two chips; `notes` come first in those of the result.
    """
    check_verdict_settings(level, tolerance_percent)
    notes = list(notes)
    used = compared(measured.saturated | simulated.saturated, measured.names, measured.channels, notes)
    means = measured.mean_dn, simulated.mean_dn
    variance = measured.standard_error_dn**2 + simulated.standard_error_dn**2
    regression, by_channel = regressions(simulated.mean_dn, measured.mean_dn, variance, used, measured.channels, notes)
    color = compare_colors(measured.names, measured.channels, means, used, reference_xyz, notes)
    tolerance = tolerance_percent / 100
    return Validation(
        level=level,
        tolerance_percent=tolerance_percent,
        measured=measured,
        simulated=simulated,
        used=used,
        means=chi_square_of_means(measured, simulated, used, tolerance, fitted, shared),
        noise=chi_square_of_noise(measured, simulated, used, tolerance, shared),
        temporal_noise=chi_square_of_temporal_noise(measured, simulated, used, tolerance, shared),
        regression=regression,
        regression_by_channel=by_channel,
        color=color,
        notes=tuple(notes),
    )


def _first(frames: Frames, what: str) -> RawFrame:
    if isinstance(frames, RawFrame):
        return frames
    if not isinstance(frames, Sequence) or not all(isinstance(frame, RawFrame) for frame in frames):
        hint = "read_raw and Camera.capture return them"
        raise InputError(what, value=type(frames).__name__, expected="a RawFrame or several", hint=hint)
    if not frames:
        raise InputError(what, value=0, expected="one frame or more")
    return frames[0]


def _check_same_kind(measured: RawFrame, simulated: RawFrame) -> None:
    facts = (
        ("size", *(f"{rows} x {cols}" for rows, cols in (measured.shape, simulated.shape))),
        ("color filter array", tile_text(measured.cfa), tile_text(simulated.cfa)),
        ("bit depth", str(measured.bits), str(simulated.bits)),
    )
    for what, one, other in facts:
        if one != other:
            raise InputError(
                f"measured and simulated frames differ in {what}: measured {one}, simulated {other}",
                hint="Simulate the sensor that was measured",
            )


def _patches(chart: str | None, regions: Sequence[Region] | None, frame: RawFrame) -> tuple[Region, ...]:
    if chart is not None:
        check_choice("chart", chart, Chart)
    if regions is not None:
        return tuple(regions)
    if chart is None:
        raise InputError("regions", value=None, expected="given where chart is None")
    return chart_regions(chart, *frame.shape)


def _reference(
    chart: str | None, names: tuple[str, ...], reference_xyz: ArrayLike | None
) -> NDArray[np.float64] | None:
    if reference_xyz is not None:
        reference = np.asarray(reference_xyz, dtype=np.float64)
        if reference.shape != (len(names), 3):
            raise InputError("reference_xyz", value=reference.shape, expected=f"of shape ({len(names)}, 3)")
        if not np.isfinite(reference).all():
            raise InputError("reference_xyz", expected="finite")
        return reference
    return None if chart is None else chart_xyz_d65(chart, names)


def check_repeats(frames: Sequence[RawFrame], names: Sequence[str] | None = None) -> None:
    """Raise `InputError` if two frames are identical: a stack's noise is estimated from differences between frames.

    Frames with one value everywhere (all black or all white) are accepted. The error names the frames, or counts them
    from 1.
    """
    seen: dict[tuple[tuple[int, ...], bytes], int] = {}
    for number, frame in enumerate(frames if len(frames) > 1 else ()):
        if frame.dn.min() == frame.dn.max():
            continue
        first = seen.setdefault((frame.dn.shape, sha256(np.ascontiguousarray(frame.dn).data).digest()), number)
        if first != number:
            one, other = (k + 1 if names is None else names[k] for k in (first, number))
            hint = "Pass each frame once"
            raise InputError(f"measured frames {one} and {other} are identical in every pixel", hint=hint)
