"""Planning a measurement: the precision that a protocol reaches, and the fewest frames that reach a precision."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from photosite.calibration.parameters import PARAMETER_LABELS, Label, Parameters
from photosite.errors import InputError, PhotositeWarning, did_you_mean
from photosite.frames.frame_settings import KINDS, Kind
from photosite.sensor.model import Sensor
from photosite.studies.effect_study import effect_studies
from photosite.studies.predicted_precision import PlannedGroup, predict, predict_pixel_gain
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import VirtualLab, virtual_lab
from photosite.values.cfa import channel_sites
from photosite.values.estimate import Estimate
from photosite.values.exposure import parse_exposure

MOST_FRAMES = 4096
"""Largest number of frames at one setting in a plan."""

LEVELS, TOP = 16, 1.25
"""Flat fields of a design: at most this many equal steps, up to this multiple of saturation."""

LEAST_FRAMES, LEAST_LINEAR_LEVELS, LEAST_SERIES = 2, 3, 2
"""Minimum of a calibration: frames at a setting, to separate noise from fixed pattern; flat fields of every channel in
the linear range; exposures of the dark series besides the shortest, so that each line fit has one point to spare."""

LEAST_IN_WORDS = (
    f"{LEAST_FRAMES} frames at every setting, {LEAST_LINEAR_LEVELS} light levels in every channel's linear range, "
    f"{LEAST_SERIES + 1} dark exposures"
)

_LINEAR_FRACTION = 0.7
"""End of EMVA 1288's photon transfer fit, relative to saturation."""


PIXEL_GAIN = "pixel_gain_dn_per_e"
"""Name of the gain of one pixel, which maps hold (`photosite calibrate --pixel-gain`)."""

PLANNED_LABELS: dict[str, Label] = {**PARAMETER_LABELS, PIXEL_GAIN: Label("Gain of one pixel", "DN/e⁻", "")}
"""Label and unit of what a plan can reach."""


@dataclass(frozen=True)
class Want:
    """Largest acceptable standard uncertainty of a parameter, relative to its value or in its unit."""

    parameter: str
    standard_uncertainty: float
    relative: bool

    @classmethod
    def parse(cls, text: str) -> Want:
        """Return the precision in text such as `prnu_percent=2%` (relative) or `read_noise_e=0.05` (in the unit).

        Raises
        ------
        InputError
            If the parameter is unknown, or the precision is not a number above 0.

        Examples
        --------
        >>> Want.parse("system_gain_dn_per_e=0.5%")
        Want(parameter='system_gain_dn_per_e', standard_uncertainty=0.005, relative=True)
        """
        name, sign, number = (part.strip() for part in text.partition("="))
        if not sign:
            raise InputError("want", value=text, expected="PARAMETER=NUMBER or PARAMETER=NUMBER%")
        if name not in PLANNED_LABELS:
            hint = did_you_mean(name, PLANNED_LABELS)
            raise InputError("want", value=text, expected="PARAMETER=NUMBER of a known parameter", hint=hint)
        relative = number.endswith("%")
        try:
            size = float(number.removesuffix("%"))
        except ValueError:
            size = math.nan
        if not (math.isfinite(size) and size > 0.0):
            expected = f"{name}=NUMBER or {name}=NUMBER% with a number above 0"
            raise InputError("want", value=text, expected=expected, hint=f"Give {name}=2%, for example")
        return cls(name, size / 100 if relative else size, relative)

    def reached(self, found: Estimate) -> float:
        """Return the expected over the wanted uncertainty: 1 or less if the precision is reached.

        Raises
        ------
        InputError
            If the parameter cannot be estimated.
        """
        if found.value is None or found.standard_uncertainty is None:
            raise InputError(f"{self.parameter} cannot be estimated from these frames: {found.reason}")
        wanted = self.standard_uncertainty * (abs(found.value) if self.relative else 1.0)
        return found.standard_uncertainty / wanted if wanted > 0.0 else math.inf

    @property
    def text(self) -> str:
        """The precision as text: a percentage or a number."""
        return f"{100 * self.standard_uncertainty:g} %" if self.relative else f"{self.standard_uncertainty:g}"


@dataclass(frozen=True)
class Plan:
    """A protocol for an assumed sensor, and the parameters with the uncertainties to expect from it.

    `groups` are the frames of the protocol with the light on the pixels. `least` is whether the plan is the minimum of
    a calibration, so that the wanted precision (`wants`, empty for a given protocol) needs no further frames.
    """

    sensor: Sensor
    protocol: ShootingProtocol
    groups: tuple[PlannedGroup, ...]
    expected: Parameters
    wants: tuple[Want, ...] = ()
    least: bool = False

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """The parameters by name, and the gain of one pixel, with the uncertainties to expect."""
        return {**self.expected.estimates(), PIXEL_GAIN: predict_pixel_gain(self.sensor, self.groups)}

    def to_dict(self) -> dict[str, Any]:
        """Return the content that `photosite plan --json` prints."""
        return {
            "sensor": self.sensor.name,
            "rows": self.sensor.array.rows,
            "cols": self.sensor.array.cols,
            "frames": self.protocol.frame_count,
            **({"least_of_a_calibration": self.least} if self.wants else {}),
            "steps": [
                {
                    "kind": group.kind,
                    "exposure_s": group.exposure_s,
                    "frames": group.frames,
                    "electrons": dict(zip(self.sensor.channel_names, group.electrons, strict=True)),
                }
                for group in self.groups
            ],
            "expected": {
                name: {"value": entry.value, "standard_uncertainty": entry.standard_uncertainty}
                if entry.value is not None
                else {"reason": entry.reason}
                for name, entry in self.estimates.items()
            },
            "wanted": {
                want.parameter: {
                    "standard_uncertainty": want.standard_uncertainty,
                    "relative": want.relative,
                    "expected_over_wanted": want.reached(self.estimates[want.parameter]),
                }
                for want in self.wants
            },
        }


def plan_protocol(lab: VirtualLab) -> Plan:
    """Return the precision that a laboratory's protocol will reach.

    Raises
    ------
    InputError
        If the protocol has no repeated dark frames, or its dark frames would clip at 0.

    Warns
    -----
    PhotositeWarning
        If the sensor has effects that the prediction leaves out.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.studies.protocol import paper_d200_protocol
    >>> from photosite.studies.virtual_lab import with_pedestal
    >>> plan = plan_protocol(virtual_lab(with_pedestal(ps.load_sensor("nikon-d200")), paper_d200_protocol()))
    >>> gain = plan.expected.system_gain_dn_per_e
    >>> f"{100 * gain.standard_uncertainty / gain.value:.3f} %"
    '0.008 %'
    """
    _warn_of_effects(lab.camera.sensor)
    groups = planned_groups(lab)
    return Plan(lab.camera.sensor, lab.protocol, groups, predict(lab.camera.sensor, groups))


def _warn_of_effects(sensor: Sensor) -> None:
    """Warn of effects that change the photon transfer: the plan is without them."""
    missing = [name for name, study in effect_studies().items() if not study.planned]
    if given := [name for name in missing if getattr(sensor.effects, name, None) is not None]:
        problem = f"sensor '{sensor.name}': the plan leaves out {', '.join(given)} of its effects"
        warnings.warn(PhotositeWarning(problem, hint="Precision with them may be lower"), stacklevel=3)


CURVE_FACTORS = tuple(2.0 ** (k / 4) for k in range(-12, 13))
"""Numbers of frames of a curve of precision, relative to those of the plan."""


def precision_curves(plan: Plan) -> tuple[list[int], dict[str, list[float]]]:
    """Return how the wanted precision depends on the number of frames.

    The frames at all settings are multiplied by the same factor, at least to `LEAST_FRAMES`.

    Returns
    -------
    list of int
        Numbers of frames, increasing.
    dict of list of float
        Expected over wanted uncertainty at these numbers, by parameter: 1 or less where the precision is reached.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.studies.virtual_lab import with_pedestal
    >>> sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=200, cols=200))
    >>> plan = plan_frames(sensor, {"read_noise_dn": Want.parse("read_noise_dn=0.2%")})
    >>> frames, ratios = precision_curves(plan)
    >>> frames[0], plan.protocol.frame_count in frames, ratios["read_noise_dn"][0] > 1.0
    (26, True, True)
    """
    ratios: dict[int, dict[str, float]] = {}
    for factor in CURVE_FACTORS:
        groups = [replace(each, frames=max(round(factor * each.frames), LEAST_FRAMES)) for each in plan.groups]
        more = replace(plan, groups=tuple(groups), expected=predict(plan.sensor, groups))
        count = sum(group.frames for group in groups)
        ratios[count] = {want.parameter: want.reached(more.estimates[want.parameter]) for want in plan.wants}
    names = [want.parameter for want in plan.wants]
    return sorted(ratios), {name: [ratios[count][name] for count in sorted(ratios)] for name in names}


def planned_groups(lab: VirtualLab) -> tuple[PlannedGroup, ...]:
    """Return the frames of a laboratory with the light on the pixels; steps with the same setting form one group."""
    sensor = lab.camera.sensor
    tile = sensor.array.cfa
    sites = [channel_sites(tile, name)[0] for name in sensor.channel_names]
    small = replace(lab.camera, sensor=sensor.with_(rows=len(tile), cols=len(tile[0])))
    groups = []
    for (kind, exposure_s), frames in _frames_by_setting(lab.protocol).items():
        electrons = (0.0,) * len(sites)
        if kind == "light":
            mean = small.mean_electrons(lab.light, exposure_s)
            electrons = tuple(float(mean[site]) for site in sites)
        photons = lab.photons_per_pixel(Step(kind, exposure_s, frames))
        groups.append(PlannedGroup(kind, exposure_s, frames, electrons, photons))
    return tuple(groups)


def _frames_by_setting(protocol: ShootingProtocol) -> dict[tuple[Kind, float], int]:
    counts: dict[tuple[Kind, float], int] = {}
    for step in protocol.steps:
        key = step.kind, step.exposure_s
        counts[key] = counts.get(key, 0) + step.count
    return counts


def setting_text(group: PlannedGroup, capacity_e: float) -> str:
    """Return the light of a group in words: "dark", or the signal of the brightest channel relative to saturation."""
    if group.kind == "dark":
        return "dark"
    return f"{100 * max(group.electrons) / capacity_e:.3g} % of saturation"


def step_from(text: str) -> Step:
    """Return a step from text such as `light:1/50:5`: kind, exposure time, frames.

    Raises
    ------
    InputError
        If the text is not of that form.

    Examples
    --------
    >>> step = step_from("dark:1/8000:50")
    >>> step.kind, step.exposure_s, step.count
    ('dark', 0.000125, 50)
    """
    parts = [part.strip() for part in text.split(":")]
    kind = next((kind for kind in KINDS if kind == parts[0]), None)
    try:
        if len(parts) == 3 and kind is not None:
            return Step(kind, parse_exposure(parts[1]), int(parts[2]))
    except ValueError:  # InputError included
        pass
    expected = (
        "dark:EXPOSURE:FRAMES or light:EXPOSURE:FRAMES with an exposure time above 0 s and 1 frame or more, such as "
        "light:1/50:5"
    )
    raise InputError("step", value=text, expected=expected)


@dataclass(frozen=True)
class Design:
    """A protocol with three free numbers: dark frames at one exposure, in a series, and flat fields per level.

    Fixed are the longest exposure times, and the numbers of flat field levels and of exposures in the dark series.
    """

    longest_dark_s: float = 5.0
    longest_flat_s: float = 0.05
    levels: int = LEVELS
    dark_exposures: int = 6

    def protocol(self, darks: int, repeats: int, flats: int) -> ShootingProtocol:
        """Return the protocol with given numbers of frames."""
        shortest = self.longest_flat_s / self.levels
        dark = series("dark", 2 * shortest, self.longest_dark_s, self.dark_exposures, repeats)
        light = (Step("light", shortest * (k + 1), flats) for k in range(self.levels))
        return ShootingProtocol("planned", (Step("dark", shortest, darks), *dark, *light))


def plan_frames(
    sensor: Sensor,
    wants: Mapping[str, Want],
    *,
    design: Design | None = None,
    illuminant: str = "D65",
    metered: bool = False,
) -> Plan:
    """Return the plan with the fewest frames that reaches the wanted precision.

    The search tries designs with few and many light levels and dark exposures. In each it starts with two frames at
    every setting and doubles the number that gains the most per frame until all wants are met, then reduces each number
    as far as they remain met.

    Parameters
    ----------
    sensor, wants
        Assumed sensor, and wanted precision by parameter.
    design
        Longest exposure times, and the largest numbers of light levels and dark exposures.
    illuminant, metered
        Light of the flat fields, and whether the photons per pixel will be known.

    Raises
    ------
    InputError
        If nothing is wanted, a parameter cannot be estimated, or no number of frames suffices, because the number of
        pixels limits the precision.

    Warns
    -----
    PhotositeWarning
        As `plan_protocol`.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.studies.virtual_lab import with_pedestal
    >>> sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=200, cols=200))
    >>> plan = plan_frames(sensor, {"read_noise_dn": Want.parse("read_noise_dn=0.2%")})
    >>> plan.protocol.steps[0].count, plan.protocol.frame_count  # 1 / sqrt(2 (n - 1) 40 000) is 0.2 %
    (5, 29)
    """
    if not wants:
        hint = "Give prnu_percent=2%, for example"
        raise InputError("wants", value=wants, expected="one parameter or more", hint=hint)
    _warn_of_effects(sensor)
    design = design or Design()
    fraction = _weakest_fraction(sensor, design, illuminant)
    best: Plan | None = None
    refused: InputError | None = None
    for number, tried in enumerate(_designs(design, fraction)):
        least = tried.protocol(*(LEAST_FRAMES,) * 3)
        lab = virtual_lab(sensor, least, illuminant=illuminant, level=TOP / fraction, photons_known=metered)
        try:
            found = _fewest(lab, wants, tried, best)
        except InputError as error:
            refused = error
            continue
        if number == 0 and found is not None and found.protocol == least:
            return replace(found, least=True)
        best = found or best
    if best is None:
        raise refused or InputError("no protocol was found")
    return best


def _designs(most: Design, fraction: float) -> list[Design]:
    """Return designs with few and many light levels and dark exposures, the minimum of a calibration first."""
    # The brightest channel has steps of TOP / fraction / levels; this many of them lie in its linear range.
    least = math.ceil(LEAST_LINEAR_LEVELS * TOP / (fraction * _LINEAR_FRACTION) - 1e-9)
    few = sorted({min(least, most.levels), (least + most.levels) // 2 if least < most.levels else most.levels})
    return [
        replace(most, levels=levels, dark_exposures=exposures)
        for exposures in sorted({min(LEAST_SERIES, most.dark_exposures), most.dark_exposures})
        for levels in sorted({*few, most.levels})
    ]


def _fewest(lab: VirtualLab, wants: Mapping[str, Want], design: Design, best: Plan | None) -> Plan | None:
    """Return the fewest frames of one design; None if the best plan so far does not need more."""
    sensor = lab.camera.sensor
    light = planned_groups(lab)  # the same for all numbers of frames

    def planned(counts: list[int]) -> Plan:
        protocol = design.protocol(*counts)
        frames = _frames_by_setting(protocol).values()
        groups = tuple(replace(group, frames=n) for group, n in zip(light, frames, strict=True))
        return Plan(sensor, protocol, groups, predict(sensor, groups), tuple(wants.values()))

    def worst(plan: Plan) -> float:
        return max(want.reached(plan.estimates[want.parameter]) for want in wants.values())

    counts = [LEAST_FRAMES] * 3
    plan = planned(counts)
    if worst(plan) > 1.0 and worst(most := planned([MOST_FRAMES] * 3)) > 1.0:
        raise _unreachable(most, wants)
    while worst(plan) > 1.0:
        options = []
        for k in range(3):
            if 2 * counts[k] <= MOST_FRAMES:
                more = [2 * n if i == k else n for i, n in enumerate(counts)]
                better = planned(more)
                cost = better.protocol.frame_count - plan.protocol.frame_count
                options.append((_progress(plan, better, wants) / cost, more, better))
        _, counts, plan = max(options, key=lambda option: option[0])
        # The final reduction at most halves the numbers.
        if best is not None and plan.protocol.frame_count > 2 * best.protocol.frame_count:
            return None
    for k in (2, 1, 0):
        low, high = (counts[k] // 2 if counts[k] > 2 else 1), counts[k]
        while high - low > 1:
            middle = (low + high) // 2
            tried = planned([middle if i == k else n for i, n in enumerate(counts)])
            low, high = (low, middle) if worst(tried) <= 1.0 else (middle, high)
        counts[k] = high
    found = planned(counts)
    return found if best is None or found.protocol.frame_count < best.protocol.frame_count else None


def _weakest_fraction(sensor: Sensor, design: Design, illuminant: str) -> float:
    """Return the signal of the least over the most sensitive channel: all channels are to reach saturation."""
    lab = virtual_lab(sensor, design.protocol(2, 2, 1), illuminant=illuminant)
    brightest = planned_groups(lab)[-1].electrons
    least = min(brightest)
    return least / max(brightest) if least > 0.05 * max(brightest) else 1.0


def _progress(before: Plan, after: Plan, wants: Mapping[str, Want]) -> float:
    """Return the logarithmic improvement of the wants that are not met."""
    result = 0.0
    for want in wants.values():
        then, now = (want.reached(plan.estimates[want.parameter]) for plan in (before, after))
        if then > 1.0:
            result += math.log(then / max(now, 1.0))
    return result


def _unreachable(best: Plan, wants: Mapping[str, Want]) -> InputError:
    for want in wants.values():
        found = best.estimates[want.parameter]
        if want.reached(found) > 1.0:
            value, u = found.value, found.standard_uncertainty or 0.0
            relative = f" ({100 * u / abs(value):.2g} %)" if value else ""
            array, of_pixel = best.sensor.array, want.parameter == PIXEL_GAIN
            limit = "" if of_pixel else f", limited by the number of pixels ({array.rows} x {array.cols})"
            return InputError(
                f"{want.parameter} to {want.text} cannot be reached: with {MOST_FRAMES} frames at every setting its "
                f"standard uncertainty is {u:.3g}{relative}{limit}",
                hint="Want less precision" + ("" if of_pixel else ", or plan for a larger chip"),
            )
    raise AssertionError("some want is not met")
