"""Measured frames against simulated ones: patch means, noise, colours, and a verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import PatchStatistics, patch_statistics
from photosite.validation.agreement import (
    chi_square_of_means,
    chi_square_of_noise,
    chi_square_of_temporal_noise,
)
from photosite.validation.charts import chart_regions, chart_xyz_d65, check_chart
from photosite.validation.color import ColorComparison, compare_colors
from photosite.validation.regression import Regression, regress
from photosite.validation.repeats import check_repeats
from photosite.validation.result import Validation
from photosite.values.cfa import tile_text
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

    The verdict rests on two chi-squares, of patch means and of the noise over pixels, and where both are stacks of
    frames on a third, of the noise from frame to frame. They share the level evenly: two cameras that are alike are
    said to differ in at most that share of comparisons. Colour differences are
    reported, and follow from the means. Patches with a saturated channel are left out of all but the table,
    channel by channel (of the colours, altogether), and `notes` says which.

    Parameters
    ----------
    measured, simulated
        A frame each, or several of one scene and setting.
    chart
        "macbeth", or None for patches of another kind.
    regions
        Where the patches lie, named as the chart names them; None for a chart that fills the frame.
    reference_xyz
        (patches, 3), the patches under D65, Y = 1 for the perfect white; None takes the chart's. Without a
        chart and without these there are no colour differences.
    level
        Share of false alarms allowed to the verdict, 0 to 1.
    tolerance_percent
        Relative difference of means and of noise that is let pass. With 0 any difference that the noise
        resolves counts; many pixels resolve a tenth of a percent.

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        If the frames are not RawFrames, two measured ones are identical,
        sizes, tiles or bits differ, the chart or a patch is unknown, there are no
        regions, a region does not lie in the frame, every patch is saturated, or the level or tolerance cannot
        be.

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
    return compare_patches(
        seen,
        made,
        _reference(chart, seen.names, reference_xyz),
        level=level,
        tolerance_percent=tolerance_percent,
        exposures_s=(first_measured.exposure_s, first_simulated.exposure_s),
    )


def compare_patches(
    measured: PatchStatistics,
    simulated: PatchStatistics,
    reference_xyz: NDArray[np.float64] | None = None,
    *,
    level: float = 0.05,
    tolerance_percent: float = 0.0,
    exposures_s: tuple[float | None, float | None] = (None, None),
    fitted: int = 0,
) -> Validation:
    """What `validate` does once the patches are read: compare the statistics of the same patches and channels.

    Parameters
    ----------
    measured, simulated
        The patches, in the same order, channels too.
    reference_xyz
        (patches, 3), as for `validate`; None leaves the colour differences out.
    level, tolerance_percent
        As for `validate`.
    exposures_s
        Of the measured and the simulated frames.
    fitted
        Parameters of the simulation that were fitted to the measured patch means.

    Raises
    ------
    InputError
        If every patch is saturated, or the level or tolerance cannot be.
    """
    if not 0 < level < 1:
        raise InputError(f"the level is a share of false alarms between 0 and 1, not {level}")
    if not (np.isfinite(tolerance_percent) and tolerance_percent >= 0):
        raise InputError(f"the tolerance is 0 percent or more, not {tolerance_percent}")
    used = ~(measured.saturated | simulated.saturated)
    if not used.any():
        raise InputError("every patch is saturated, so nothing can be compared; expose for less")
    notes = _saturation_notes(measured, used)
    regression, by_channel = _lines(measured, simulated, used, notes)
    tolerance = tolerance_percent / 100
    return Validation(
        level=level,
        tolerance_percent=tolerance_percent,
        measured=measured,
        simulated=simulated,
        used=used,
        means=chi_square_of_means(measured, simulated, used, tolerance, fitted),
        noise=chi_square_of_noise(measured, simulated, used, tolerance),
        temporal_noise=chi_square_of_temporal_noise(measured, simulated, used, tolerance),
        regression=regression,
        regression_by_channel=by_channel,
        color=_colors(measured, simulated, used, reference_xyz, notes),
        exposures_s=exposures_s,
        notes=tuple(notes),
    )


def _first(frames: Frames, what: str) -> RawFrame:
    if isinstance(frames, RawFrame):
        return frames
    if not isinstance(frames, Sequence) or not all(isinstance(frame, RawFrame) for frame in frames):
        raise InputError(
            f"validate takes a RawFrame or several as the {what} frames, not {type(frames).__name__}; "
            f"read_raw and Camera.capture make them"
        )
    if not frames:
        raise InputError(f"there is no {what} frame; give one or more")
    return frames[0]


def _check_same_kind(measured: RawFrame, simulated: RawFrame) -> None:
    facts = (
        ("size", *(f"{rows} x {cols}" for rows, cols in (measured.shape, simulated.shape))),
        ("colour filter array", tile_text(measured.cfa), tile_text(simulated.cfa)),
        ("bits", str(measured.bits), str(simulated.bits)),
    )
    for what, one, other in facts:
        if one != other:
            raise InputError(
                f"measured and simulated frames differ in {what}: measured {one}, simulated {other}; "
                "simulate the sensor that was measured"
            )


def _patches(chart: str | None, regions: Sequence[Region] | None, frame: RawFrame) -> tuple[Region, ...]:
    if chart is not None:
        check_chart(chart)
    if regions is not None:
        return tuple(regions)
    if chart is None:
        raise InputError("without a chart, give the patches as regions")
    return chart_regions(chart, *frame.shape)


def _reference(
    chart: str | None, names: tuple[str, ...], reference_xyz: ArrayLike | None
) -> NDArray[np.float64] | None:
    if reference_xyz is not None:
        reference = np.asarray(reference_xyz, dtype=np.float64)
        if reference.shape != (len(names), 3):
            raise InputError(f"reference_xyz must be ({len(names)}, 3), one row per patch, not {reference.shape}")
        if not np.isfinite(reference).all():
            raise InputError("reference_xyz must be finite")
        return reference
    return None if chart is None else chart_xyz_d65(chart, names)


def _saturation_notes(measured: PatchStatistics, used: NDArray[np.bool_]) -> list[str]:
    lost = [
        f"{name} ({', '.join(c for c, ok in zip(measured.channels, row, strict=True) if not ok)})"
        for name, row in zip(measured.names, np.asarray(used).tolist(), strict=True)
        if not all(row)
    ]
    return [f"left out as saturated: {'; '.join(lost)}"] if lost else []


def _lines(
    measured: PatchStatistics, simulated: PatchStatistics, used: NDArray[np.bool_], notes: list[str]
) -> tuple[Regression | None, dict[str, Regression | None]]:
    """The line through all points, and one per channel."""
    variance = measured.standard_error_dn**2 + simulated.standard_error_dn**2

    def line(which: NDArray[np.bool_], what: str) -> Regression | None:
        x = simulated.mean_dn[which]
        if x.size < 3 or np.ptp(x) == 0:
            notes.append(f"no regression of {what}: it takes three patches that differ")
            return None
        return regress(x, measured.mean_dn[which], variance[which])

    channels = enumerate(measured.channels)
    columns = {name: used & (np.arange(used.shape[1]) == k) for k, name in channels}
    return line(used, "all channels"), {name: line(which, f"channel {name}") for name, which in columns.items()}


def _colors(
    measured: PatchStatistics,
    simulated: PatchStatistics,
    used: NDArray[np.bool_],
    reference: NDArray[np.float64] | None,
    notes: list[str],
) -> ColorComparison | None:
    if set(measured.channels) != {"R", "G", "B"}:
        notes.append("no colour differences: the channels are not R, G and B")
        return None
    if reference is None:
        notes.append("no colour differences: the patches' colours are not known")
        return None
    order = [measured.channels.index(name) for name in "RGB"]
    whole = np.asarray(used.all(axis=1), dtype=np.bool_)
    try:
        return compare_colors(
            tuple(measured.names[patch] for patch in np.flatnonzero(whole)),
            measured.mean_dn[whole][:, order],
            simulated.mean_dn[whole][:, order],
            reference[whole],
        )
    except InputError as reason:
        notes.append(f"no colour differences: {reason}")
        return None
