"""A moving edge in the frames of a clip: skew of a rolling shutter, motion blur, exposure time and frame jitter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Curve, Measurement, Quantity, Result
from photosite.metrics.motion.time_stamps import STAMP_QUANTITIES, stamp_values
from photosite.values.estimate import Estimate
from photosite.values.region import Region
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Uncertain, Value, combined, correlated, derive

Array = NDArray[np.float64]

_REACH_PX, _LEAST_ROWS = 40, 50
_LEAST_SIGMAS = 8.0
"""Contrast of the edge over the noise of a pixel times the root of the number of rows."""
_LEAST_BLUR = 2.0
"""Width of motion over the standard deviation of the other blur, from which the two are distinguished."""
_MOST_ROWS = 400


@dataclass(frozen=True)
class _Edge(Shown):
    """Position in the middle row, columns to a row, width of the motion and standard deviation of the other blur."""

    position: Uncertain
    slope: Uncertain
    width: Uncertain
    sigma: Uncertain


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    fps: Annotated[float, Field(gt=0)] | None = None,
    velocity_px_per_s: float | None = None,
    static_slope: float | None = None,
) -> Result:
    if fps is None and velocity_px_per_s is None:
        hint = "Give fps of a clip of a vertical edge that moves along the rows"
        raise InputError("one of the options fps and velocity_px_per_s", expected="given", hint=hint)
    if static_slope is None:
        static_slope = math.tan(math.radians(float(chart.options["angle_deg"])))
    channel = image.sharp_channel
    region = _rows(chart.region)
    mask = image.mask(channel, region)
    edges = [_fitted(plane, mask, image.white - image.black) for plane in image.planes(channel, region)]
    count = len(edges)
    equal = [1.0 / count] * count
    skew = combined([edge.slope for edge in edges], equal) - static_slope
    width = combined([edge.width for edge in edges], equal)
    sigma = combined([edge.sigma for edge in edges], equal)
    blur: Value = width
    if width.value < _LEAST_BLUR * sigma.value:
        blur = Missing("the edge moves less than twice its other blur in the exposure")
    velocity, jitter = _motion(edges, fps)
    if velocity_px_per_s is not None:
        velocity = Uncertain(velocity_px_per_s)
    found: dict[str, Value] = {
        "skew": skew,
        "blur": blur,
        "velocity": velocity,
        "line_time_us": _ratio(skew, velocity, 1e6),
        "exposure_ms": _ratio(blur, derive(lambda v: v * math.copysign(1.0, v.value), velocity), 1e3),
    }
    values = {(name, ""): Estimate.of(value, "") for name, value in found.items()}
    values |= {(name, ""): estimate for name, estimate in stamp_values(image.stamps).items()}
    values["jitter_ms", ""] = (
        Estimate.of_variance(jitter, "") if isinstance(jitter, Uncertain) else Estimate.of(jitter, "")
    )
    place = np.array([edge.position.value for edge in edges])
    spread = np.array([edge.position.standard_uncertainty for edge in edges])
    frames = np.arange(1.0, count + 1)
    curve = Curve(channel, "frame", "position of the edge in the middle row (pixels)", frames, place, spread)
    return Result(values, (curve,))


def _rows(region: Region) -> Region:
    height = region.r1 - region.r0
    if height < _LEAST_ROWS:
        raise InputError("rows of the edge", value=height, expected=f"{_LEAST_ROWS} or more")
    first = region.r0 + max(height - _MOST_ROWS, 0) // 2
    return Region(region.name, first, min(first + _MOST_ROWS, region.r1), region.c0, region.c1)


def _profile(distance: Array, width: float, sigma: float) -> Array:
    """Return the profile of an edge from 0 to 1 under a uniform motion and a Gaussian blur."""
    from scipy.special import ndtr

    def integral(at: Array) -> Array:
        z = at / sigma
        return np.asarray(at * ndtr(z) + sigma * np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi))

    return (integral(distance + 0.5 * width) - integral(distance - 0.5 * width)) / width


def _fitted(plane: Array, mask: NDArray[np.bool_], white: float) -> _Edge:
    """Return the edge in a frame, by least squares of its profile."""
    from scipy.optimize import least_squares

    rows, cols = plane.shape
    row, col = np.nonzero(mask)
    value = plane[row, col]
    sums = np.bincount(col, value, cols) / np.maximum(np.bincount(col, minlength=cols), 1)
    known = np.flatnonzero(np.bincount(col, minlength=cols))
    profile = sums[known]
    low, high = float(np.median(profile[: profile.size // 8])), float(np.median(profile[-(profile.size // 8) :]))
    middle = 0.5 * (low + high)
    sign = 1.0 if high > low else -1.0
    step = np.flatnonzero(sign * (profile - middle) > 0)
    start = float(known[step[0]]) if step.size else 0.5 * cols
    x, y = col + 0.5 - start, row + 0.5 - 0.5 * rows
    near = np.abs(x) < _REACH_PX
    x, y, value = x[near], y[near], value[near]
    if value.size < 10 * _LEAST_ROWS:
        raise InputError("pixels near the edge", value=value.size, expected=f"{10 * _LEAST_ROWS} or more")
    if float((value >= white).mean()) > 1e-3:
        raise InputError("edge", expected="below saturation")

    def model(p: Array) -> Array:
        distance = x - p[2] - p[3] * y
        return np.asarray(p[0] + (p[1] - p[0]) * _profile(distance, math.exp(p[4]), math.exp(p[5])))

    first = np.array([low, high, 0.0, 0.0, math.log(4.0), 0.0])
    scale = np.array([abs(high - low) or 1.0] * 2 + [1.0, 0.01, 0.5, 0.5])
    bounds = (np.array([-np.inf] * 4 + [math.log(0.05), math.log(0.2)]), np.array([np.inf] * 4 + [math.log(60.0), 3.0]))
    found = least_squares(lambda p: model(p) - value, first, x_scale=scale, bounds=bounds)
    rest, slope = found.fun, found.jac
    noise = float(rest.std())
    if abs(found.x[1] - found.x[0]) * math.sqrt(rows) < _LEAST_SIGMAS * noise:
        hint = "Check the chart, its corners and the direction of the edge"
        raise InputError("contrast of a vertical edge", expected="above its noise", hint=hint)
    # Noise differs between the sides: the covariance takes it from the residuals.
    inverse = np.linalg.pinv(slope.T @ slope)
    covariance = inverse @ (slope.T @ (rest[:, None] ** 2 * slope)) @ inverse
    place, tilt, width, sigma = correlated(found.x[2:], covariance[2:, 2:])
    width, sigma = (_exponential(each) for each in (width, sigma))
    return _Edge(place + start, tilt, width, sigma)


def _exponential(value: Uncertain) -> Uncertain:
    scale = math.exp(value.value)
    return (value - value.value) * scale + scale


def _motion(edges: list[_Edge], fps: float | None) -> tuple[Value, Value]:
    """Return velocity in pixels/s, and the variance of the times of the frames in ms^2."""
    if fps is None:
        return (Missing("fps is not given"),) * 2
    if len(edges) < 2:
        return (Missing("there is one frame"),) * 2
    time = (np.arange(len(edges)) - 0.5 * (len(edges) - 1)) / fps
    weights = time / float(time @ time)
    velocity = combined([edge.position for edge in edges], list(weights))
    freedom = len(edges) - 2
    if freedom < 3 or velocity.value == 0.0:
        return velocity, Missing("five frames or more of a moving edge are needed")
    place = np.array([edge.position.value for edge in edges])
    rest = place - place.mean() - velocity.value * time
    square = float(rest @ rest) / freedom
    own = float(np.mean([edge.position.standard_uncertainty**2 for edge in edges]))
    scatter = math.sqrt(max(square, own) * float(weights @ weights))
    velocity = Uncertain.of(velocity.value, max(scatter, velocity.standard_uncertainty))
    excess = Uncertain.of_variance(square, square * math.sqrt(2.0 / freedom)) - own
    scaled = excess * (1e3 / velocity.value) ** 2
    if scaled.value <= 0.0 or not scaled.beyond(2.0):
        return velocity, Missing("the times of the frames differ by less than noise")
    return velocity, scaled


def _ratio(one: Value, velocity: Value, scale: float) -> Value:
    for each in (one, velocity):
        if isinstance(each, Missing):
            return each
    assert isinstance(one, Uncertain)
    assert isinstance(velocity, Uncertain)
    if not velocity.beyond(4.0):
        return Missing("the edge does not move")
    return one / velocity * scale


_QUANTITIES = {
    "skew": Quantity("skew", "pixels/row", "Displacement of the edge from one row to the next."),
    "blur": Quantity("motion blur", "pixels", "Displacement of the edge during the exposure."),
    "velocity": Quantity("velocity", "pixels/s", "Of the edge along the rows, with `fps`, or as given."),
    "line_time_us": Quantity("line time", "us", "Skew over velocity: from the exposure of a row to the next one's."),
    "exposure_ms": Quantity("exposure time", "ms", "Motion blur over velocity."),
    "jitter_ms": Quantity("frame jitter", "ms", "Standard deviation of the times of frames about a constant rate."),
    **STAMP_QUANTITIES,
}
MEASUREMENT = Measurement(
    title="Moving edge: rolling shutter, motion blur and timing",
    standard="no standard; a vertical edge that moves at constant velocity along the rows",
    charts=("slanted-edge",),
    measure=_measure,
    quantities=_QUANTITIES,
    oracle="closed forms of an edge that moves in front of a rolling shutter",
    left_out=(
        "The velocity is taken as constant. Blur other than motion, the pixel's included, is taken as Gaussian. Rows "
        "in the middle of the frame are measured, at most 400."
    ),
    order=450,
    view="middle",
    headline=("skew", "exposure_ms"),
    figure="curves",
    of_photograph=tuple(_QUANTITIES),
)
