"""What files state of their levels, held against the frames' own numbers."""

from __future__ import annotations

from collections.abc import Sequence

from photosite.calibration.reduction.groups import GroupStatistics, pooled_level
from photosite.frames.frame_set import FrameSet
from photosite.frames.levels import far_apart


def stated_level_warnings(
    frames: FrameSet, darks: Sequence[GroupStatistics], lights: Sequence[GroupStatistics]
) -> list[str]:
    """Lines about levels that cannot be as stated; no estimate goes by them, but whoever develops such frames does.

    Parameters
    ----------
    darks, lights
        By exposure, so that the first dark has the least dark signal.
    """
    white = frames.white_level_dn or float((1 << frames.bits) - 1)
    return _black_level(frames, darks[0], white) + _white_level(frames, lights, white)


def _black_level(frames: FrameSet, dark: GroupStatistics, white_dn: float) -> list[str]:
    stated, found = frames.black_level_dn, pooled_level(dark.levels).mean
    if stated is None or not far_apart(stated, found, white_dn):
        return []
    return [
        f"the black level is stated as {stated:g} DN, and the {dark.label} read {found:.2f} DN on average; correct it "
        f"where the frames are developed"
    ]


def _white_level(frames: FrameSet, lights: Sequence[GroupStatistics], white_dn: float) -> list[str]:
    if frames.white_level_dn is None or not lights:
        return []
    brightest, label = max((level.mean, entry.label) for entry in lights for level in entry.levels)
    if brightest <= white_dn or not far_apart(white_dn, brightest, 2 * white_dn):
        return []
    return [f"the white level is stated as {white_dn:g} DN, and {label} read {brightest:.1f} DN on average"]
