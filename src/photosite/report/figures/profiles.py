"""Profiles of mean frames: mean, extremes and the middle line, across and down."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.calibration.spatial.spatial_analysis import Profile, SpatialAnalysis
from photosite.report.figures.marks import thinned
from photosite.report.style import BLACK, BLUE, GREEN, VERMILION, WIDTH_IN, styled
from photosite.values.uncertain import Missing

_LOOKS = (
    ("highest", "maximum", VERMILION, 0.8),
    ("lowest", "minimum", BLUE, 0.8),
    ("middle", "middle line", GREEN, 0.6),
    ("mean", "mean", BLACK, 1.2),
)


@styled()
def profiles_figure(spatial: SpatialAnalysis) -> Figure:
    """Horizontal and vertical profiles of one channel, in the light and in the dark.

    Parameters
    ----------
    spatial
        The channel's patterns.

    Returns
    -------
    matplotlib.figure.Figure
        Above, the mean frame near half saturation less the dark, where there is one; below, the mean dark frame. Left,
        along rows: over each column the mean, maximum and minimum, and the middle row. Right, along columns.

    Notes
    -----
    EMVA 1288 R4.0, 8.7.
    """
    patterns = [spatial.dark] if isinstance(spatial.light, Missing) else [spatial.light, spatial.dark]
    figure = Figure(figsize=(WIDTH_IN, 0.6 + 2.5 * len(patterns)))
    panels = figure.subplots(len(patterns), 2, squeeze=False, sharey="row", sharex="col")
    for row, pattern in zip(panels, patterns, strict=True):
        for axes, profile in ((row[0], pattern.along_columns), (row[1], pattern.along_rows)):
            _draw(axes, profile)
        row[0].set_ylabel("signal (DN)" if pattern.kind == "light" else "dark (DN)")
        row[0].set_title("light less dark" if pattern.kind == "light" else "dark", loc="left")
    panels[-1][0].set_xlabel("column")
    panels[-1][1].set_xlabel("row")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(handles))
    return figure


def _draw(axes: Axes, profile: Profile) -> None:
    place = np.arange(len(profile.mean), dtype=np.float64)
    for name, label, color, width in _LOOKS:
        axes.plot(*thinned(place, getattr(profile, name)), color=color, linewidth=width, label=label)
    axes.set_xlim(0, len(place) - 1)
