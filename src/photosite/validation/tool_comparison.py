"""Comparison of another simulator's patches or mosaics with photosite's simulation or a second file."""

from __future__ import annotations

from dataclasses import replace

from photosite.errors import InputError
from photosite.metrics.patches import patch_statistics
from photosite.validation.charts import chart_regions
from photosite.validation.frame_validation import MOST_SIMULATED
from photosite.validation.patch_values import PatchComparison, PatchValues, compare_values
from photosite.validation.result import Validation
from photosite.validation.set_up import SetUp
from photosite.validation.tool_files import Content, Mosaic
from photosite.validation.validate import validate
from photosite.values.cfa import tile_text


def compare(
    other: Content,
    reference: Content | SetUp,
    *,
    chart: str = "macbeth",
    tolerance_percent: float = 0.1,
    level: float = 0.05,
    seed: int = 0,
) -> PatchComparison | Validation:
    """Compare the output of another simulator with a reference.

    Raw frames are compared by `photosite.validation.validate.validate`, noise included. Patch values and mosaics in
    electrons are compared by their means.

    Parameters
    ----------
    other
        Patch values, a mosaic in electrons, or raw frames, from `photosite.validation.tool_files.read_tool_file`.
    reference
        The same of a second tool, or a set-up. A set-up is simulated in the form of `other`: patches without noise,
        mean electrons of a mosaic, or raw frames with noise.
    chart
        Chart that fills mosaics.
    tolerance_percent
        Relative tolerance of means, and of the noise of raw frames, in percent.
    level
        False-alarm rate of the verdict where there is noise.
    seed
        Seed of the noise of simulated raw frames.

    Returns
    -------
    PatchComparison or Validation
        `Validation` where both are raw frames, with `other` as measured.

    Examples
    --------
    >>> import photosite as ps
    >>> camera = ps.Camera(ps.DiffractionLimited(8, 50), ps.load_sensor("nikon-d200"))
    >>> set_up = SetUp.from_chart(camera, ps.charts.macbeth("A", 40), 1 / 3)
    >>> theirs = set_up.patch_values("e")
    >>> brighter = replace(theirs, mean=1.02 * theirs.mean)
    >>> compare(theirs, set_up).agrees, compare(brighter, set_up).agrees
    (True, False)
    """
    made = _simulated(other, reference, seed) if isinstance(reference, SetUp) else reference
    if isinstance(other, list) and isinstance(made, list):
        return validate(other, made, chart, level=level, tolerance_percent=tolerance_percent)
    values, base = _values(other, chart), _values(made, chart)
    if isinstance(reference, SetUp) and isinstance(other, Mosaic):
        # Another tool clips a mosaic at the well capacity; photosite's mean is not clipped.
        well_e = reference.camera.sensor.pixel.well_capacity_e.value
        base = replace(base, saturated=base.mean >= well_e)
    return compare_values(values, base, tolerance_percent=tolerance_percent, level=level)


def _simulated(other: Content, set_up: SetUp, seed: int) -> Content:
    if isinstance(other, PatchValues):
        return set_up.patch_values(other.unit)
    tile = set_up.camera.sensor.array.cfa
    cfa = other.cfa if isinstance(other, Mosaic) else other[0].cfa
    if cfa != tile:
        raise InputError("cfa", value=tile_text(cfa), expected=f"that of the set-up, {tile_text(tile)}")
    if isinstance(other, Mosaic):
        rows, cols = other.electrons.shape
        return Mosaic(set_up.mean_electrons((rows, cols)).astype(float), tile)
    return list(set_up.frames(other[0].shape, seed=seed, count=min(len(other), MOST_SIMULATED)))


def _values(content: Content, chart: str) -> PatchValues:
    if isinstance(content, PatchValues):
        return content
    if isinstance(content, Mosaic):
        rows, cols = content.electrons.shape
        return content.patch_values(chart_regions(chart, rows, cols))
    return PatchValues.from_statistics(patch_statistics(content, chart_regions(chart, *content[0].shape)))
