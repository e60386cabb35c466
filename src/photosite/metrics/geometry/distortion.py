"""Geometric distortion: how far the dots of a grid are from where a lens without distortion images them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.geometry.dots import find_dots
from photosite.metrics.measurement import Curve, FieldMap, Measurement, Quantity, Result
from photosite.scene.placement import Homography
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain, combined, correlated

Array = NDArray[np.float64]

NOT_RADIAL = DiagnosticKind(
    "distortion-not-radial",
    "warning",
    "The dots are farther from the fitted radial distortion than centroids of sharp dots are.",
    "The chart may not be flat, the lens decentered, or dots were mistaken for each other. Intervals are wide.",
    "Look at the map, flatten the chart, and use dots of several pixels.",
    ("distortion_*", "tv_*", "line_*"),
    "Standard deviation of the dots, in pixels.",
)
_SCATTER_PX = 1.0
_CENTER_PRIOR = 0.01
"""Standard uncertainty of the center of distortion before it is measured, in half diagonals from the frame's middle."""
_HEIGHTS = 101
_TERMS = 3


@dataclass(frozen=True, eq=False)
class RadialFit:
    """A flat chart in perspective, distorted around a center: real = ideal (1 + k1 r^2 + k2 r^4 + k3 r^6).

    Parameters
    ----------
    view
        From rows and columns of dots to ideal image points, in half diagonals from the middle of the frame.
    center
        Of distortion, in the same unit.
    coefficients
        k1, k2, k3, for the ideal image height r in half diagonals.
    scatter
        Standard deviation of a coordinate of the dots, in half diagonals.
    """

    view: Homography
    center: Array
    coefficients: tuple[Uncertain, ...]
    scatter: float

    def percent(self, height: Array) -> list[Uncertain]:
        """Return real over ideal image height less one, in percent, at ideal heights."""
        powers = height[:, None] ** (2 * np.arange(1, _TERMS + 1))
        return [combined(self.coefficients, 100.0 * row) for row in powers]


def _measure(image: ChartImage, chart: PlacedChart) -> Result:
    channel = image.sharp_channel
    dots = find_dots(image, chart, (channel,))
    points = dots.from_center(channel)
    fit = _fit(dots.index, points)
    height = np.hypot(*(fit.view(dots.index.astype(np.float64)) - fit.center).T)
    heights = np.linspace(0.0, float(height.max()), _HEIGHTS)
    local = fit.percent(heights)
    sizes = np.array([each.value for each in local])
    at_dots = fit.percent(height)
    values = {
        "distortion_percent": local[int(np.argmax(np.abs(sizes)))],
        "distortion_mean_percent": combined(at_dots, [math.copysign(1 / height.size, each.value) for each in at_dots]),
        **_lines(fit, image.shape, float(height.max())),
    }
    scatter_px = fit.scatter * dots.half_diagonal
    known = {"dots": float(height.size), "dot_scatter_px": scatter_px, **_pose(fit, image.shape)}
    found = {(name, ""): Estimate.of(value, "") for name, value in values.items()}
    found |= {(name, ""): Estimate(value) for name, value in known.items()}
    spread = np.array([each.standard_uncertainty for each in local])
    curve = Curve("", "ideal image height (of half the diagonal)", "distortion (%)", heights, sizes, spread)
    real = np.hypot(*(points - fit.center).T)
    percent = np.where(height > 0.1, 100.0 * (real / np.maximum(height, 1e-9) - 1.0), np.nan)
    field = FieldMap("", "local geometric distortion (%)", *dots.grid(percent, channel))
    diagnostics = []
    if scatter_px > _SCATTER_PX:
        text = f"the standard deviation of dots from the fitted distortion is {scatter_px:.2g} pixels"
        diagnostics.append(NOT_RADIAL(text, scatter_px))
    return Result(found, (curve,), (field,), tuple(diagnostics))


def _fit(index: NDArray[np.int_], points: Array) -> RadialFit:
    """Fit pose, center and coefficients to the dots by least squares."""
    from scipy.optimize import least_squares

    scale = np.diag([*(1.0 / np.maximum(np.abs(index).max(axis=0), 1)), 1.0])
    grid = index @ scale[:2, :2]
    inner = np.argsort(np.hypot(*points.T))[: max(12, len(points) // 3)]
    view = Homography.between(grid[inner], points[inner]).matrix
    start = np.concatenate([(view / view[2, 2]).ravel()[:8], np.zeros(_TERMS + 2)])
    freedom = points.size - start.size + 2

    def residual(parameters: Array, spread: float) -> Array:
        center = parameters[-2:]
        apart = Homography(np.append(parameters[:8], 1.0).reshape(3, 3))(grid) - center
        square = (apart**2).sum(axis=1)[:, None]
        stretch = 1.0 + square ** np.arange(1, _TERMS + 1) @ parameters[8 : 8 + _TERMS]
        rest = (center + apart * stretch[:, None] - points).ravel()
        return np.concatenate([rest, center * (spread / _CENTER_PRIOR)])

    spread = 1e-4
    for _ in range(3):
        found = least_squares(residual, start, args=(spread,), method="lm", x_scale="jac")
        spread = max(math.sqrt(float((found.fun[:-2] ** 2).sum()) / freedom), 1e-12)
        start = found.x
    covariance = spread**2 * np.linalg.inv(found.jac.T @ found.jac)
    own = slice(8, 8 + _TERMS)
    coefficients = correlated(found.x[own], covariance[own, own], float(freedom))
    matrix = np.append(found.x[:8], 1.0).reshape(3, 3) @ scale
    return RadialFit(Homography(matrix), found.x[-2:], coefficients, spread)


def _lines(fit: RadialFit, shape: tuple[int, int], height: float) -> dict[str, Uncertain]:
    """Return the bend of the sides of a rectangle of the frame's proportions whose corners are at an image height."""
    rows, cols = np.array(shape) / math.hypot(*shape)
    top, side = height * rows, height * cols
    corner, middle, beside = (each * 0.01 for each in fit.percent(np.array([height, top, side])))
    return {
        "tv_distortion_percent": (corner - middle) / (middle + 1.0) * 100.0,
        "line_distortion_horizontal_percent": (corner - middle) * (100.0 * top / (2.0 * rows)),
        "line_distortion_vertical_percent": (corner - beside) * (100.0 * side / (2.0 * rows)),
    }


def _pose(fit: RadialFit, shape: tuple[int, int]) -> dict[str, float]:
    """Return the rotation of the chart in the frame, and the change of its scale over the frame."""
    rows, cols = np.array(shape) / math.hypot(*shape)
    back = fit.view.inverse

    def across(row: float, col: float) -> Array:
        """Return the step to the next dot of a line at a point of the frame, in half diagonals."""
        at, half = back(np.array([row, col])), np.array([0.0, 0.5])
        return np.asarray(fit.view(at + half) - fit.view(at - half))

    def down(row: float, col: float) -> Array:
        at, half = back(np.array([row, col])), np.array([0.5, 0.0])
        return np.asarray(fit.view(at + half) - fit.view(at - half))

    middle = across(0.0, 0.0)
    vertical = np.hypot(*across(rows, 0.0)) / np.hypot(*across(-rows, 0.0))
    horizontal = np.hypot(*down(0.0, cols)) / np.hypot(*down(0.0, -cols))
    return {
        "rotation_deg": math.degrees(math.atan2(middle[0], middle[1])),
        "keystone_vertical_percent": 100.0 * (float(vertical) - 1.0),
        "keystone_horizontal_percent": 100.0 * (float(horizontal) - 1.0),
    }


MEASUREMENT = Measurement(
    title="Geometric distortion",
    standard="ISO 17850:2015, local geometric distortion and line distortion; SMIA TV distortion",
    charts=("point-grid",),
    measure=_measure,
    quantities={
        "distortion_percent": Quantity(
            "local distortion", "%", "Largest real over ideal image height less one, up to the farthest dot."
        ),
        "distortion_mean_percent": Quantity("mean distortion", "%", "Mean of its absolute value over the dots."),
        "tv_distortion_percent": Quantity(
            "SMIA TV distortion", "%", "Height of a rectangle at its sides less that in its middle, over the latter."
        ),
        "line_distortion_horizontal_percent": Quantity(
            "line distortion, horizontal", "%", "Bend of the upper side of the rectangle over the picture height."
        ),
        "line_distortion_vertical_percent": Quantity(
            "line distortion, vertical", "%", "Bend of the right side of the rectangle over the picture height."
        ),
        "dots": Quantity("dots", "", "Dots found."),
        "dot_scatter_px": Quantity("scatter of dots", "pixels", "Standard deviation of dots from the fitted model."),
        "rotation_deg": Quantity("rotation", "degrees", "Rotation of the chart in the frame, clockwise."),
        "keystone_vertical_percent": Quantity(
            "keystone, vertical", "%", "Scale of the chart at the bottom of the frame over that at the top, less one."
        ),
        "keystone_horizontal_percent": Quantity(
            "keystone, horizontal", "%", "Scale of the chart at the right of the frame over that at the left, less one."
        ),
    },
    oracle="distortion put into the lens of a simulated camera; drawn dots in closed form",
    left_out=(
        "The text of the standard was not at hand: definitions follow its published descriptions. The pose of the "
        "chart is fitted with the distortion, so that the camera need not be square to it. The rectangle of TV and "
        "line distortion has the frame's proportions; its corners are at the image height of the farthest dot."
    ),
    order=320,
    view="field",
    headline=("distortion_percent", "tv_distortion_percent"),
    figure="curves",
    of_photograph=("dots", "rotation_deg", "keystone_vertical_percent", "keystone_horizontal_percent"),
)
