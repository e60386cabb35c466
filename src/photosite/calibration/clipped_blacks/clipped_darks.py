"""Dark groups clipped at 0: fit of the reference group, correction of all levels, and of row and column parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from photosite.calibration.clipped_blacks.censored_likelihood import CensoredDark, count_clipped, fit_censored
from photosite.calibration.clipped_blacks.clipping_correction import correct_clipping, moment_slopes
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import CLIPPED_DARK_SHARE, GroupStatistics
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.spatial.parts import Parts
from photosite.errors import CalibrationError
from photosite.values.uncertain import Missing, Uncertain, correlated, weighted_mean

NO_PIXEL_SLOPES = Missing(
    "the dark frames are clipped at 0, and clipped pixels do not show their dark current; raise the camera's black "
    "level (pedestal)"
)

METHOD = "censored maximum likelihood (normal DSNU, normal noise, rounded, clipped at 0)"

DarkEstimates = tuple[Uncertain, Uncertain, Uncertain]
"""Black level (DN), DSNU variance and read variance (DN^2), correlated.

The black level's uncertainty does not include DSNU^2 / pixels, like that of a mean dark level."""


@dataclass(frozen=True)
class ClippedDarks:
    """Dark groups corrected for clipping at 0."""

    groups: tuple[GroupStatistics, ...]
    censored: tuple[CensoredDark, ...]  # fit of the reference group, per channel
    estimates: tuple[DarkEstimates, ...]  # its estimates with their covariance, per channel

    def together(self) -> DarkEstimates:
        """Return the estimates of all channels together, weighted by their pixels."""
        weights = [float(dark.pixels) for dark in self.censored]
        black, dsnu, read = (weighted_mean(entries, weights) for entries in zip(*self.estimates, strict=True))
        return black, dsnu, read

    def scale(self, channel: int) -> float:
        """Return the factor that undoes the clipping of the variance of shifts common to all pixels."""
        theta = self.censored[channel].theta
        theta[1] = max(theta[1], 0.0)
        return 1.0 / float(moment_slopes(theta)[0, 0]) ** 2

    def parts(
        self, channel: int, plain: Parts | Missing, filtered: Parts | Missing
    ) -> tuple[Parts | Missing, Parts | Missing]:
        """Return row, column and pixel parts of the fixed pattern, from those of the clipped mean frame.

        A row's offset shifts the mean of its clipped pixels as a common shift does. The total is the DSNU of the
        censored fit. The high-pass takes the same share of the pixel part with and without clipping.
        """
        if isinstance(plain, Missing):
            return plain, filtered
        _, dsnu, _ = self.estimates[channel]
        scale = self.scale(channel)
        row, column = plain.row * scale, plain.column * scale
        pixel = dsnu - row - column
        whole = Parts(total=dsnu, row=row, column=column, pixel=pixel)
        if isinstance(filtered, Missing):
            return whole, filtered
        row, column = filtered.row * scale, filtered.column * scale
        if plain.pixel.value > 2.0 * plain.pixel.standard_uncertainty:
            pixel = pixel * (filtered.pixel.value / plain.pixel.value)
        else:
            pixel = filtered.pixel * scale
        return whole, Parts(total=pixel + row + column, row=row, column=column, pixel=pixel)

    def warning(self, names: Sequence[str]) -> str:
        """Return the warning of a calibration with clipped dark frames."""
        share = max(dark.zero_share for dark in self.censored)
        text = (
            f"the dark frames are clipped at 0 (up to {100 * share:.3g} % of their numbers): read noise, DSNU and "
            f"black level come from {METHOD}; the same model corrects the dark levels, and light levels with more than "
            f"a few numbers at 0 were left out"
        )
        if odd := [name for name, dark in zip(names, self.censored, strict=True) if not dark.misfit_is_chance]:
            worst = max(dark.misfit for dark in self.censored)
            where = f" of channel{'s' * (len(odd) > 1)} {', '.join(odd)}" if len(names) > 1 else ""
            text += (
                f"; the model does not describe the dark frames{where} (hot pixels, shading, tails; chi square "
                f"{worst:.2g} per degree of freedom), and uncertainties were widened accordingly"
            )
        return text


def correct_clipped_darks(reduction: Reduction, reader: FrameReader) -> ClippedDarks | None:
    """Read the reference group again for its zeros, fit it, and correct all dark levels; None where none is clipped.

    Raises
    ------
    CalibrationError
        If too little of a level is above 0.
    """
    darks, reference = reduction.darks, reduction.reference_group
    if not any(level.low_fraction > CLIPPED_DARK_SHARE for entry in darks for level in entry.levels):
        return None
    of_group = {id(source) for source in reference.group.frames}
    sources = [entry.source for entry in reduction.used if id(entry.source) in of_group]
    shape = reduction.frames.rows, reduction.frames.cols
    counts = count_clipped((source.read() for source in sources), shape, reader.tile)
    censored = []
    for name, channel in zip(reduction.names, counts, strict=True):
        found = fit_censored(channel)
        if isinstance(found, Missing):
            raise _error(reduction, reference, name, found)
        censored.append(found)
    groups = []
    for entry in darks:
        levels = []
        for name, level, dark in zip(reduction.names, entry.levels, censored, strict=True):
            corrected = correct_clipping(level, dark)
            if isinstance(corrected, Missing):
                raise _error(reduction, entry, name, corrected)
            levels.append(corrected)
        groups.append(replace(entry, levels=tuple(levels)))
    return ClippedDarks(tuple(groups), tuple(censored), tuple(_estimates(dark) for dark in censored))


def _error(reduction: Reduction, group: GroupStatistics, name: str, why: Missing) -> CalibrationError:
    hint = "Raise the camera's black level (pedestal) and take the dark frames again"
    return reduction.error(f"the dark frames are clipped at 0 DN: {why.reason}", hint, group, name)


def _estimates(dark: CensoredDark) -> DarkEstimates:
    covariance = dark.covariance.copy()
    covariance[0, 0] -= max(dark.dsnu_variance, 0.0) / dark.pixels
    black, dsnu, read = correlated(dark.theta, covariance)
    return black, dsnu, read
