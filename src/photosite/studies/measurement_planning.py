"""Planning a measurement of image quality: charts, distance, light and frames for a wanted 95 % interval."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from photosite.camera.camera import Camera
from photosite.camera.mean_image import pitch_m
from photosite.errors import InputError
from photosite.metrics.measurement import Measured, Measurement, Quantity, Result
from photosite.metrics.registry import ValueName, measurement
from photosite.optics.lens import Optics
from photosite.studies.gray_surface import light_capacity_e
from photosite.studies.planning import MOST_FRAMES
from photosite.studies.simulated_charts import VIEWED_PX, ChartConditions, SeenChart, seen_chart
from photosite.values.estimate import Estimate
from photosite.values.exposure import format_exposure
from photosite.values.shown import Cell, ResultTable, Shown, Tabular

DEFAULT_WIDTH_MM = 200.0
"""Width of a chart, as `photosite scenes print` prints it."""
DRAWS = 3
"""Stacks of simulated frames whose intervals are averaged."""
_COUNTS = (1, 2, 16)
_MOST_SIMULATED, _MOST_SIMULATED_PX = 64, 80_000_000
"""Frames and pixels of a stack from which the interval is extrapolated."""
_MOST_CELLS = 20_000_000
"""Cells of a chart that is larger than the usual view."""
_SMALLER, _LARGER = 3, 2
"""How often the size of a chart is halved and doubled."""
_FRACTIONS = (0.5, 0.25)
"""Of the exposure time, with which the best setting is tried too."""
_REFINED = 2
"""Sizes between the smallest that reaches the interval and the next, which does not."""
_DOT_RESPONSE = 0.156
"""Width of a printed dot in pixels whose own response at 0.5 cycles/pixel is 0.99: sinc(0.5 x) = 0.99."""
_BRIGHT_PERCENTILE = 99.5
_NUMBER = re.compile(r"\s*(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


@dataclass(frozen=True)
class WantedInterval(Shown):
    """A value of image quality, and the largest acceptable half width of its 95 % interval.

    Parameters
    ----------
    name
        Which value; without a part, each part must reach the interval.
    half_width
        In the unit of the value, or relative to it.
    relative
        Whether the half width is relative.
    """

    name: ValueName
    half_width: float
    relative: bool = False

    @classmethod
    def parse(cls, text: str) -> WantedInterval:
        """Parse NAME=NUMBER, with the unit of the value or % of the value after the number.

        Raises
        ------
        InputError
            If the value is unknown, the number is not above 0, or the unit is another one.

        Examples
        --------
        >>> WantedInterval.parse("noise.snr_18_db.G=0.2dB").half_width
        0.2
        >>> WantedInterval.parse("noise.snr_18_db=1%").relative
        True
        """
        name, sign, number = text.partition("=")
        example = "such as edge-sfr.mtf50.G=0.01 or edge-sfr.mtf50=2%"
        if not sign:
            raise InputError("want", value=text, expected=f"NAME=HALF_WIDTH, {example}")
        value = ValueName.parse(name)
        match = _NUMBER.fullmatch(number)
        if match is None or not float(match[1]) > 0.0:
            raise InputError("want", value=text, expected=f"a number above 0 after =, {example}")
        unit = measurement(value.measurement).quantities[value.quantity].unit
        if match[2] not in ("", "%", unit):
            expected = f"in {unit}, or in % of the value" if unit else "without a unit, or in % of the value"
            raise InputError("want", value=text, expected=expected)
        relative = match[2] == "%"
        return cls(value, float(match[1]) / 100.0 if relative else float(match[1]), relative)

    def size(self, value: float) -> float:
        """Return the half width for a value, in its unit."""
        return self.half_width * abs(value) if self.relative else self.half_width

    @property
    def quantity(self) -> Quantity:
        """The quantity of the value."""
        return measurement(self.name.measurement).quantities[self.name.quantity]

    @property
    def text(self) -> str:
        """The wanted interval as text."""
        if self.relative:
            return f"±{100 * self.half_width:g} %"
        return f"±{self.half_width:g} {self.quantity.unit}".rstrip()


@dataclass(frozen=True)
class PlannedChart(Shown):
    """A chart in one setting, and the frames that it needs.

    Parameters
    ----------
    chart, rows, cols
        Built-in scene, and the pixels that it fills.
    magnification, distance_m
        Of the chart, and the distance from the lens at which it has that.
    print_dpi
        Dots per inch from which dots of a printed chart lower responses at 0.5 cycles/pixel by less than 1 %; None for
        values that are no responses.
    exposure_s, signal_percent
        Exposure time, and the brightest parts relative to saturation.
    frames
        Fewest frames that reach the wanted interval; None where no number does.
    half_width, systematic
        Half width of the 95 % interval of these frames (without such, of the most that were simulated), and of the part
        that more frames do not reduce. They are of the part that needs most frames.
    single
        Half width of the part of one frame that falls as 1 / sqrt(frames).
    value, part
        Mean of the simulated values, and the part of the quantity.
    extrapolated
        Whether the frames are more than were simulated.
    reason
        Why there is no number of frames.
    """

    chart: str
    rows: int
    cols: int
    magnification: float
    distance_m: float
    print_dpi: float | None
    exposure_s: float
    signal_percent: float
    frames: int | None = None
    half_width: float | None = None
    systematic: float | None = None
    single: float | None = None
    value: float | None = None
    part: str = ""
    extrapolated: bool = False
    reason: str = ""


@dataclass(frozen=True, eq=False)
class MeasurementPlan(Tabular):
    """How a value of image quality reaches a wanted interval.

    Parameters
    ----------
    want
        The value and its interval.
    measured_on
        All charts on which the value is measured, by name.
    settings
        The settings that were simulated.
    luminance_cd_m2, width_mm
        Mean luminance of the charts, and their width.
    advice
        What would reach the interval, where no setting does.
    """

    want: WantedInterval
    measured_on: tuple[str, ...]
    settings: tuple[PlannedChart, ...]
    luminance_cd_m2: float
    width_mm: float
    advice: str = ""

    @property
    def best(self) -> PlannedChart | None:
        """The setting with the fewest frames, of these the one with the fewest pixels; None if none reaches it."""
        reached = [each for each in self.settings if each.frames is not None]
        return min(reached, key=_cost, default=None)

    @property
    def farthest(self) -> PlannedChart | None:
        """The setting of the best chart at the largest distance that reaches the interval with any number of frames."""
        if (best := self.best) is None:
            return None
        same = (each for each in self.settings if each.chart == best.chart and each.frames is not None)
        return max(same, key=lambda each: (each.distance_m, each.signal_percent))

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        best = self.best
        return {
            "want": str(self.want.name),
            "half_width": self.want.half_width,
            "relative": self.want.relative,
            "unit": self.want.quantity.unit,
            "measured_on": list(self.measured_on),
            "luminance_cd_m2": self.luminance_cd_m2,
            "width_mm": self.width_mm,
            "best": None if best is None else asdict(best),
            "farthest": None if best is None else asdict(self.farthest or best),
            "advice": self.advice,
            "settings": [asdict(each) for each in self.settings],
        }

    def _table(self) -> ResultTable:
        columns = (
            "chart",
            "pixels",
            "distance (m)",
            "exposure (s)",
            "signal (%)",
            "frames",
            "half width",
            "systematic",
        )
        rows: list[tuple[Cell, ...]] = []
        for each in self.settings:
            frames = each.reason or ("none" if each.frames is None else each.frames)
            exposure = format_exposure(each.exposure_s)
            place = (each.chart, f"{each.rows} x {each.cols}", each.distance_m, exposure, each.signal_percent)
            rows.append((*place, frames, each.half_width, each.systematic))
        unit = f" ({self.want.quantity.unit})" if self.want.quantity.unit else ""
        return ResultTable(f"{self.want.name} to {self.want.text}: settings{unit}", columns, rows)


def plan_measurement(
    camera: Camera,
    want: str | WantedInterval,
    *,
    charts: Collection[str] = (),
    conditions: ChartConditions | None = None,
    width_mm: float = DEFAULT_WIDTH_MM,
    options: Mapping[str, Any] | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> MeasurementPlan:
    """Find chart, distance, light and frames with which a value of image quality reaches a 95 % interval.

    Charts are simulated in several sizes, three stacks of frames in each, and measured. The square of the half width of
    the interval is fitted by a part that does not depend on the number of frames and one that falls with it; the number
    of frames is that whose simulated interval is narrow enough. From 64 frames on it is extrapolated.

    Parameters
    ----------
    camera
        The camera.
    want
        Value and half width, such as "edge-sfr.mtf50.G=0.01" or "noise.snr_18_db=0.2dB"; "2%" is relative to the value.
    charts
        Charts to plan with; empty: all on which the value is measured.
    conditions
        Light of the charts, exposure time (None: just below saturation) and seed; the number of frames is not used.
    width_mm
        Width of the charts, for their distance.
    options
        Options of the measurement.
    on_progress
        Called with what is simulated.

    Raises
    ------
    InputError
        If the value or a chart is unknown, or no frames of the charts give the value an interval.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=100)
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    >>> plan = plan_measurement(camera, "noise.snr_18_db.G=0.4dB", charts=["macbeth"])
    >>> best = plan.best
    >>> best.chart, best.frames, round(best.distance_m, 1), best.half_width <= 0.4
    ('macbeth', 1, 4.7, True)
    """
    planner = Planner(camera, conditions or ChartConditions(), width_mm, on_progress or _silent)
    return planner.plan(want, charts, options or {})


def _silent(text: str) -> None:
    pass


def _cost(setting: PlannedChart) -> tuple[float, int]:
    return setting.frames or math.inf, setting.rows * setting.cols


@dataclass(frozen=True, eq=False)
class Planner(Shown):
    """Plans of values of one camera, which share their simulated charts.

    Parameters
    ----------
    camera, conditions, width_mm, on_progress
        As for `plan_measurement`.
    """

    camera: Camera
    conditions: ChartConditions
    width_mm: float = DEFAULT_WIDTH_MM
    on_progress: Callable[[str], None] = _silent
    _seen: dict[tuple[Any, ...], SeenChart | InputError] = field(default_factory=dict, repr=False)

    def plan(
        self, want: str | WantedInterval, charts: Collection[str] = (), options: Mapping[str, Any] | None = None
    ) -> MeasurementPlan:
        """Return a plan, as `plan_measurement`."""
        wanted = WantedInterval.parse(want) if isinstance(want, str) else want
        entry = measurement(wanted.name.measurement)
        for chart in charts:
            if chart not in entry.charts:
                raise InputError("charts", value=chart, expected=f"one of {', '.join(entry.charts)} for {entry.id}")
        search = _Search(self, wanted, entry, entry.options(**(options or {})).given())
        settings = [each for chart in charts or entry.charts for each in search.sizes(chart)]
        if all(each.value is None for each in settings):
            raise InputError(str(wanted.name), expected="measured on simulated charts", hint=settings[0].reason)
        plan = MeasurementPlan(wanted, entry.charts, tuple(settings), self.conditions.luminance_cd_m2, self.width_mm)
        if plan.best is None:
            return search.advised(plan)
        return search.with_light(search.with_limit(plan))

    def seen(self, entry: Measurement, chart: str, shape: tuple[int, int], exposure_s: float | None) -> SeenChart:
        """Return a chart that fills the middle (rows, cols) of the frame; InputError where it cannot."""
        key = chart, entry.view, shape, exposure_s
        if key not in self._seen:
            self.on_progress(f"{chart}, {shape[0]} x {shape[1]} pixels")
            conditions = replace(self.conditions, exposure_s=exposure_s)
            try:
                distance_m = distance_of(self.camera.optics, self.magnification(shape))
                self._seen[key] = seen_chart(
                    self.camera, chart, entry.view, conditions, shape=shape, distance_m=distance_m
                )
            except InputError as error:
                self._seen[key] = error
        found = self._seen[key]
        if isinstance(found, InputError):
            raise found
        return found

    def magnification(self, shape: tuple[int, int]) -> float:
        """Return the magnification at which the width of a chart fills a frame."""
        return shape[1] * pitch_m(self.camera.sensor)[1] / (self.width_mm * 1e-3)


def distance_of(optics: Optics, magnification: float) -> float:
    """Return the distance in m at which an object has a magnification.

    Raises
    ------
    InputError
        If the lens does not reach it.

    Examples
    --------
    >>> import photosite as ps
    >>> round(distance_of(ps.DiffractionLimited(f_number=8, focal_length_mm=50), 0.01), 4)   # f (1 + 1 / m)
    5.05
    """
    low, high = 0.0, 1.0
    while optics.magnification(high) > magnification:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        try:
            near = optics.magnification(middle) > magnification
        except InputError:  # within the focal length
            near = True
        low, high = (middle, high) if near else (low, middle)
    return high


@dataclass(frozen=True, eq=False)
class _Search:
    """The search of one value: its settings are measured, and the fewest frames found."""

    planner: Planner
    want: WantedInterval
    entry: Measurement
    options: Mapping[str, Any]

    def sizes(self, chart: str) -> Iterator[PlannedChart]:
        """Yield a chart in the usual size; then smaller ones while they reach the interval, or larger ones until."""
        array = self.planner.camera.sensor.array
        whole = array.rows, array.cols
        exposure_s = self.planner.conditions.exposure_s
        if self.entry.view == "field":
            yield self.setting(chart, whole, exposure_s)
            return
        usual = _within(VIEWED_PX[self.entry.view], whole)
        found = self.setting(chart, usual, exposure_s)
        yield found
        down = found.frames is not None
        for step in range(1, (_SMALLER if down else _LARGER) + 1):
            factor = 2.0 ** (-step if down else step)
            shape = _within((int(usual[0] * factor), int(usual[1] * factor)), whole)
            cells = 25 if self.entry.view == "fine" else 1
            if shape == usual or shape[0] * shape[1] * cells > _MOST_CELLS:
                return
            found = self.setting(chart, shape, exposure_s)
            yield found
            if (found.frames is None) == down:
                return

    def setting(self, chart: str, shape: tuple[int, int], exposure_s: float | None) -> PlannedChart:
        """Return the fewest frames of a chart in one setting."""
        planner = self.planner
        magnification = planner.magnification(shape)
        empty = PlannedChart(chart, *shape, magnification, math.nan, None, exposure_s or math.nan, math.nan)
        try:
            seen = planner.seen(self.entry, chart, shape, exposure_s)
        except InputError as error:
            return replace(empty, reason=str(error))
        sensor = seen.camera.sensor
        bright = float(np.percentile(seen.mean_electrons, _BRIGHT_PERCENTILE))
        setting = replace(
            empty,
            distance_m=seen.scene.distance_m,
            print_dpi=25.4 * shape[1] / (_DOT_RESPONSE * planner.width_mm) if self.entry.view == "fine" else None,
            exposure_s=seen.exposure_s,
            signal_percent=100.0 * bright / light_capacity_e(sensor, seen.exposure_s),
        )
        stacks = _Stacks(seen, self.entry, self.options, planner.conditions.seed)
        stacks.measure(_COUNTS)
        parts = stacks.parts(self.want.name)
        if not parts:
            return replace(setting, reason=stacks.reason(self.want.name))
        found = [_planned(setting, stacks, self.want, part) for part in parts]
        return max(found, key=lambda each: (each.frames is None, each.frames or 0, each.half_width or 0.0))

    def with_limit(self, plan: MeasurementPlan) -> MeasurementPlan:
        """Return the plan with settings between the smallest chart that reaches the interval and one that does not."""
        best = plan.best
        assert best is not None
        own = [each for each in plan.settings if each.chart == best.chart]
        more: list[PlannedChart] = []
        for _ in range(_REFINED):
            good = min((each for each in [*own, *more] if each.frames is not None), key=lambda each: each.cols)
            bad = max((each for each in [*own, *more] if each.frames is None), key=lambda each: each.cols, default=None)
            if bad is None or bad.cols > good.cols or good.cols - bad.cols < 2:
                break
            factor = math.sqrt(bad.cols / good.cols)
            shape = max(int(good.rows * factor), 1), max(int(good.cols * factor), 1)
            more.append(self.setting(best.chart, shape, self.planner.conditions.exposure_s))
        return replace(plan, settings=(*plan.settings, *more))

    def with_light(self, plan: MeasurementPlan) -> MeasurementPlan:
        """Return the plan with settings of less light, and of more where the exposure time was given."""
        best = plan.best
        assert best is not None
        times: list[float | None] = [fraction * best.exposure_s for fraction in _FRACTIONS]
        if self.planner.conditions.exposure_s is not None:
            times.insert(0, None)
        more = (self.setting(best.chart, (best.rows, best.cols), time_s) for time_s in times)
        return replace(plan, settings=(*plan.settings, *more))

    def advised(self, plan: MeasurementPlan) -> MeasurementPlan:
        """Return a plan that reaches nothing with what would."""
        known = [each for each in plan.settings if each.half_width is not None and each.value is not None]
        nearest = min(known, key=lambda each: each.systematic or each.half_width or math.inf)
        size = self.want.size(nearest.value or 0.0)
        shown = f"{nearest.part} of {nearest.chart}" if nearest.part else nearest.chart
        remains = nearest.systematic if nearest.systematic is not None else math.inf
        if remains > size:
            advice = [f"no number of frames reaches it: ±{remains:.2g} remains ({shown})"]
        else:
            advice = [f"more than {MOST_FRAMES} frames would be needed ({shown})"]
        if self.planner.conditions.exposure_s is not None:
            brighter = self.setting(nearest.chart, (nearest.rows, nearest.cols), None)
            plan = replace(plan, settings=(*plan.settings, brighter))
            if brighter.frames is not None:
                factor = brighter.exposure_s / nearest.exposure_s
                advice.append(f"{factor:.2g} times the light reaches it with {_frames(brighter.frames)}")
                return replace(plan, advice="; ".join(advice))
        if self.entry.view != "field":
            # The variance falls with the number of pixels.
            factor = max(remains, nearest.half_width or 0.0 if math.isinf(remains) else 0.0) / size
            array = self.planner.camera.sensor.array
            cols = math.ceil(nearest.cols * factor)
            room = f"; the frame has {array.cols}" if cols > array.cols else ""
            advice.append(f"a chart of about {cols} pixels across would ({factor:.2g} times as many{room})")
        return replace(plan, advice="; ".join(advice))


def _frames(count: int) -> str:
    return f"{count} frame{'s' if count > 1 else ''}"


def _within(shape: tuple[int, int], whole: tuple[int, int]) -> tuple[int, int]:
    """Return a shape in the proportions of the first that the whole holds."""
    factor = min(1.0, *(size / most for size, most in zip(whole, shape, strict=True)))
    return max(int(shape[0] * factor), 1), max(int(shape[1] * factor), 1)


class _Stacks:
    """Simulated stacks of a chart, and what a measurement finds in them."""

    def __init__(self, seen: SeenChart, entry: Measurement, options: Mapping[str, Any], seed: int) -> None:
        self._seen, self._entry, self._options, self._seed = seen, entry, options, seed
        self._results: dict[int, list[Measured | str]] = {}
        self.most = max(min(_MOST_SIMULATED, _MOST_SIMULATED_PX // seen.mean_electrons.size), 2)

    def measure(self, counts: Sequence[int]) -> None:
        """Measure stacks of so many frames, where they are not more than can be simulated."""
        wanted = sorted({count for count in counts if count <= self.most} - self._results.keys())
        if not wanted:
            return
        for draw in range(DRAWS):
            frames = self._seen.frames(wanted[-1], self._seed + draw)
            for count in wanted:
                self._results.setdefault(count, []).append(self._measured(frames[:count]))

    def _measured(self, frames: Sequence[Any]) -> Measured | str:
        try:
            return self._entry(self._seen.image(frames), self._seen.placed, **self._options)
        except InputError as error:
            return str(error)

    @property
    def counts(self) -> list[int]:
        """The numbers of frames that were measured."""
        return sorted(self._results)

    def _of(self, name: ValueName, count: int) -> list[dict[str, Estimate]]:
        found = self._results[count]
        return [name.among(each.values) if isinstance(each, Result) else {} for each in found]

    def parts(self, name: ValueName) -> list[str]:
        """Return the parts of a value that any stack gives."""
        known = (
            part
            for count in self.counts
            for found in self._of(name, count)
            for part, each in found.items()
            if each.value is not None
        )
        return list(dict.fromkeys(known))

    def reason(self, name: ValueName) -> str:
        """Return why the stacks do not give a value."""
        for count in reversed(self.counts):
            for result, found in zip(self._results[count], self._of(name, count), strict=True):
                if isinstance(result, str):
                    return result
                for each in found.values():
                    if each.reason:
                        return each.reason
        return f"the chart has no {name.quantity}" + (f" of {name.part}" if name.part else "")

    def estimates(self, name: ValueName, part: str, count: int) -> list[Estimate] | None:
        """Return a value of each stack; None where one does not give it."""
        found = [each.get(part, Estimate()) for each in self._of(name, count)] if count in self._results else []
        return found if found and all(each.interval_95 is not None for each in found) else None

    def interval(self, name: ValueName, part: str, count: int) -> tuple[float, float] | None:
        """Return the mean value and the root mean square of the half widths; None where a stack does not give it."""
        found = self.estimates(name, part, count)
        if found is None:
            return None
        half = [0.5 * (high - low) for low, high in (each.interval_95 or (0.0, 0.0) for each in found)]
        return float(np.mean([each.value for each in found])), float(np.sqrt(np.mean(np.square(half))))


def _planned(setting: PlannedChart, stacks: _Stacks, want: WantedInterval, part: str) -> PlannedChart:
    """Return the setting with the fewest frames of one part of a value."""

    def known() -> dict[int, tuple[float, float]]:
        found = {count: stacks.interval(want.name, part, count) for count in stacks.counts}
        return {count: each for count, each in found.items() if each is not None}

    setting = replace(setting, part=part)
    if not known():
        return replace(setting, reason=stacks.reason(want.name))
    last = max(known())
    value = known()[last][0]
    size = want.size(value)
    if not any(half for _, half in known().values()):
        return replace(setting, value=value, reason="the value has no interval")
    frames, extrapolated = None, False
    while True:
        found = known()
        systematic, single = _fitted(found)
        reached = min((count for count, (_, half) in found.items() if half <= size), default=None)
        missed = max((count for count in stacks.counts if reached is None or count < reached), default=0)
        if reached is not None and reached - missed <= 1:
            frames = reached
            break
        needed = math.ceil(single**2 / (size**2 - systematic**2)) if size > systematic else None
        if reached is None and needed is None:
            break
        proposed = max(needed or 1, missed + 1)
        if reached is not None:
            proposed = min(proposed, reached - 1)
        if proposed > stacks.most:
            frames, extrapolated = (proposed if proposed <= MOST_FRAMES else None), True
            break
        stacks.measure((proposed,))
    simulated = found.get(frames or last)
    half = simulated[1] if simulated is not None else math.sqrt(systematic**2 + single**2 / (frames or last))
    return replace(
        setting,
        frames=frames,
        half_width=half,
        systematic=systematic,
        single=single,
        value=value,
        extrapolated=extrapolated and frames is not None,
    )


def _fitted(found: Mapping[int, tuple[float, float]]) -> tuple[float, float]:
    """Return the half widths of the part that frames do not reduce, and of that of one frame which falls with them.

    The squares of the half widths are fitted, with relative weights that increase with the frames: the variance of two
    has one degree of freedom. One frame, which does not separate temporal noise and fixed pattern, is used where there
    are no more.
    """
    from scipy.optimize import nnls

    counts = [count for count in found if count > 1] or list(found)
    square = np.array([found[count][1] ** 2 for count in counts])
    if len(counts) == 1:
        return 0.0, math.sqrt(float(square[0]) * counts[0])
    weight = np.sqrt(counts)
    model = np.array([(1.0, 1.0 / count) for count in counts]) * (weight / square)[:, None]
    systematic, single = nnls(model, weight)[0]
    return math.sqrt(float(systematic)), math.sqrt(float(single))
