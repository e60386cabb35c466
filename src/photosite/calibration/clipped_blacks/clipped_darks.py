"""Clipped darks in a calibration: where they are, and what takes the place of what was read.

`censored_likelihood.py` has the likelihood and `clipping_correction.py` the levels; here they meet the frames, and
what the clipped mean frame
tells of rows and columns is brought back to scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photosite.calibration.clipped_blacks.censored_likelihood import CensoredDark, count_clipped, fit_censored
from photosite.calibration.clipped_blacks.clipping_correction import correct_clipping, moment_slopes
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import CLIPPED_DARK_SHARE, GroupStatistics
from photosite.calibration.spatial.parts import Parts
from photosite.errors import CalibrationError
from photosite.values.cfa import channel_names
from photosite.values.uncertain import Missing, Uncertain, correlated, weighted_mean

NO_PIXEL_SLOPES = Missing(
    "the darks are clipped at 0, and pixels below it do not show their dark current; raise the camera's black level "
    "(pedestal)"
)

METHOD = "censored maximum likelihood (normal DSNU, normal noise, rounded, clipped at 0)"


def are_clipped(darks: Sequence[GroupStatistics]) -> bool:
    """Whether more is clipped in some dark level than a calibration can pass over."""
    return any(level.low_fraction > CLIPPED_DARK_SHARE for entry in darks for level in entry.levels)


@dataclass(frozen=True)
class ClippedDarks:
    """What stands for clipped darks, per channel.

    Parameters
    ----------
    as_read
        The dark groups with their clipping.
    groups
        The same without it.
    censored
        The censored estimate from the reference group.
    estimates
        Black level, DSNU variance and read variance, with what they share. The black level's uncertainty is without
        the share of the chip's pixels (DSNU^2 / pixels), as that of a mean dark level is.
    """

    as_read: tuple[GroupStatistics, ...]
    groups: tuple[GroupStatistics, ...]
    censored: tuple[CensoredDark, ...]
    estimates: tuple[tuple[Uncertain, Uncertain, Uncertain], ...]

    def together(self) -> tuple[Uncertain, Uncertain, Uncertain]:
        """The estimates of all channels as one, weighted by their pixels."""
        weights = [float(dark.pixels) for dark in self.censored]
        black, dsnu, read = (weighted_mean(entries, weights) for entries in zip(*self.estimates, strict=True))
        return black, dsnu, read

    def scale(self, channel: int) -> float:
        """What the variance of something that moves all pixels' levels alike is multiplied by to be as unclipped."""
        dark = self.censored[channel]
        theta = np.array([dark.black_level, max(dark.dsnu_variance, 0.0), dark.read_variance])
        return 1.0 / float(moment_slopes(theta)[0, 0]) ** 2

    def parts(
        self, channel: int, plain: Parts | Missing, filtered: Parts | Missing
    ) -> tuple[Parts | Missing, Parts | Missing]:
        """Row, column and pixel parts of the fixed pattern, plain and high-passed, from those of the clipped mean.

        A row's offset moves the mean of its clipped pixels by the share that the mean of all moves by; the
        total is the censored DSNU. The high-pass takes the same share of the pixels' part, clipped or not.
        """
        _, dsnu, _ = self.estimates[channel]
        if isinstance(plain, Missing):
            return plain, filtered
        gain = self.scale(channel)
        row, column = plain.row * gain, plain.column * gain
        pixel = dsnu - row - column
        whole = Parts(total=dsnu, row=row, column=column, pixel=pixel)
        if isinstance(filtered, Missing):
            return whole, filtered
        row, column = filtered.row * gain, filtered.column * gain
        if plain.pixel.value > 2.0 * plain.pixel.standard_uncertainty:
            pixel = pixel * (filtered.pixel.value / plain.pixel.value)
        else:
            pixel = filtered.pixel * gain
        return whole, Parts(total=pixel + row + column, row=row, column=column, pixel=pixel)

    def warning(self, names: Sequence[str]) -> str:
        """What was done, and where the model does not describe the darks."""
        share = max(dark.zero_share for dark in self.censored)
        text = (
            f"the darks are clipped at 0 (up to {100 * share:.3g} % of their numbers): read noise, DSNU and black "
            f"level are by {METHOD}; dark levels were turned back by the same model, and light levels with more than a "
            f"few numbers at 0 were left out"
        )
        if odd := [n for n, dark in zip(names, self.censored, strict=True) if not dark.misfit_is_chance]:
            worst = max(dark.misfit for dark in self.censored)
            where = f" of channel{'s' * (len(odd) > 1)} {', '.join(odd)}" if len(names) > 1 else ""
            text += (
                f"; the darks{where} are not as that model has them (hot pixels, shading, tails; chi square "
                f"{worst:.2g} per degree of freedom), and uncertainties were widened accordingly"
            )
        return text


def correct_clipped_darks(reader: FrameReader, darks: Sequence[GroupStatistics], reference: int) -> ClippedDarks:
    """Read the reference group again for its zeros, fit it, and turn the levels of all groups back.

    Raises
    ------
    CalibrationError
        If too little is left above zero, with the group and the channel.
    FileError
        If a frame cannot be read again.
    """
    names = channel_names(reader.frames.cfa)
    group = darks[reference].group
    there = {id(source) for source in group.frames}
    sources = [entry.source for entry in reader.used_frames if id(entry.source) in there]
    counts = count_clipped((source.read() for source in sources), (reader.frames.rows, reader.frames.cols), reader.tile)
    censored = []
    for name, channel in zip(names, counts, strict=True):
        found = fit_censored(channel)
        if isinstance(found, Missing):
            raise _refusal(reader, darks[reference], name, found)
        censored.append(found)
    groups = []
    for entry in darks:
        levels = []
        for name, level, dark in zip(names, entry.levels, censored, strict=True):
            whole = correct_clipping(level, dark)
            if isinstance(whole, Missing):
                raise _refusal(reader, entry, name, whole)
            levels.append(whole)
        groups.append(replace(entry, levels=tuple(levels)))
    return ClippedDarks(tuple(darks), tuple(groups), tuple(censored), tuple(_estimates(dark) for dark in censored))


def _estimates(dark: CensoredDark) -> tuple[Uncertain, Uncertain, Uncertain]:
    covariance = dark.covariance.copy()
    covariance[0, 0] -= max(dark.dsnu_variance, 0.0) / dark.pixels
    values = np.array([dark.black_level, dark.dsnu_variance, dark.read_variance])
    black, dsnu, read = correlated(values, covariance)
    return black, dsnu, read


def _refusal(reader: FrameReader, group: GroupStatistics, name: str, why: Missing) -> CalibrationError:
    of_channel = f", channel {name}" if len(reader.frames.cfa) * len(reader.frames.cfa[0]) > 1 else ""
    return CalibrationError(
        f"{reader.frames.source}: {group.label}{of_channel}: clipped at 0 DN: {why.reason}; raise the camera's black "
        f"level (pedestal) and take the darks again"
    )
