"""Before the lab day: what precision a protocol will reach, and how many frames a wanted precision takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from photosite.calibration.parameters import PARAMETER_LABELS, parameter_label
from photosite.calibration.plan import PlannedGroup, predict
from photosite.calibration.result import Estimate, Parameters
from photosite.cfa import channel_sites
from photosite.errors import InputError
from photosite.exposure import parse_exposure
from photosite.sensor.model import Sensor
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import VirtualLab, virtual_lab

MOST_FRAMES = 4096
"""Frames at one setting beyond which a plan does not go."""

LEVELS, TOP = 16, 1.25
"""Flats of a design: equal steps up to so many saturations."""

_DARK_EXPOSURES = 6


@dataclass(frozen=True)
class Want:
    """A precision that is wanted.

    Parameters
    ----------
    parameter
        Its name.
    standard_uncertainty
        What its standard uncertainty may be at most; a share of the value where `relative`.
    relative
        Whether it is one.
    """

    parameter: str
    standard_uncertainty: float
    relative: bool

    @classmethod
    def parse(cls, text: str) -> Want:
        """From `prnu_percent=2%`, a share of the value, or `read_noise_e=0.05`, in the parameter's unit.

        Raises
        ------
        InputError
            If there is no such parameter, or the precision is no number above 0.

        Examples
        --------
        >>> Want.parse("system_gain_dn_per_e=0.5%")
        Want(parameter='system_gain_dn_per_e', standard_uncertainty=0.005, relative=True)
        """
        name, sign, number = (part.strip() for part in text.partition("="))
        if not sign:
            raise InputError(f"a wanted precision is PARAMETER=NUMBER or PARAMETER=NUMBER%, not '{text}'")
        parameter_label(name)
        relative = number.endswith("%")
        try:
            size = float(number.removesuffix("%"))
        except ValueError:
            size = math.nan
        if not (math.isfinite(size) and size > 0.0):
            raise InputError(f"the precision wanted of {name} is a number above 0, such as 0.1 or 2%, not '{number}'")
        return cls(name, size / 100 if relative else size, relative)

    def reached(self, found: Estimate) -> float:
        """The expected uncertainty over the one wanted: 1 or less where the want is met.

        Raises
        ------
        InputError
            If the parameter cannot be estimated at all.
        """
        if found.value is None or found.standard_uncertainty is None:
            raise InputError(f"{self.parameter} cannot be had from such frames: {found.reason}")
        wanted = self.standard_uncertainty * (abs(found.value) if self.relative else 1.0)
        return found.standard_uncertainty / wanted if wanted > 0.0 else math.inf

    @property
    def text(self) -> str:
        """As it is written."""
        return f"{100 * self.standard_uncertainty:g} %" if self.relative else f"{self.standard_uncertainty:g}"


@dataclass(frozen=True)
class Plan:
    """Frames to take, and what they will tell.

    Parameters
    ----------
    sensor
        The guess.
    protocol
        What to shoot.
    groups
        The same with the light on the pixels.
    expected
        The parameters with their uncertainties.
    wants
        What was asked for; empty where a protocol was given.
    """

    sensor: Sensor
    protocol: ShootingProtocol
    groups: tuple[PlannedGroup, ...]
    expected: Parameters
    wants: tuple[Want, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """What `photosite plan --json` prints."""
        estimates = self.expected.estimates()
        return {
            "sensor": self.sensor.name,
            "rows": self.sensor.array.rows,
            "cols": self.sensor.array.cols,
            "frames": self.protocol.frame_count,
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
                for name, entry in estimates.items()
            },
            "wanted": {
                want.parameter: {
                    "standard_uncertainty": want.standard_uncertainty,
                    "relative": want.relative,
                    "expected_over_wanted": want.reached(estimates[want.parameter]),
                }
                for want in self.wants
            },
        }


def plan_protocol(lab: VirtualLab) -> Plan:
    """What precision a laboratory's protocol will reach.

    Raises
    ------
    InputError
        If the protocol has no repeated dark frames, or its darks would clip at 0.

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
    groups = planned_groups(lab)
    return Plan(lab.camera.sensor, lab.protocol, groups, predict(lab.camera.sensor, groups))


def planned_groups(lab: VirtualLab) -> tuple[PlannedGroup, ...]:
    """A laboratory's protocol with the light on its sensor's pixels; steps of one setting are one group."""
    sensor = lab.camera.sensor
    tile = sensor.array.cfa
    sites = [channel_sites(tile, name)[0] for name in sensor.channel_names]
    small = replace(lab.camera, sensor=sensor.with_(rows=len(tile), cols=len(tile[0])))
    counts: dict[tuple[str, float], tuple[Step, int]] = {}
    for step in lab.protocol.steps:
        before = counts.get((step.kind, step.exposure_s), (step, 0))[1]
        counts[step.kind, step.exposure_s] = (step, before + step.count)
    groups = []
    for step, count in counts.values():
        electrons = (0.0,) * len(sites)
        if step.kind == "light":
            mean = small.mean_electrons(lab.light, step.exposure_s)
            electrons = tuple(float(mean[site]) for site in sites)
        groups.append(PlannedGroup(step.kind, step.exposure_s, count, electrons, lab.photons_per_pixel(step)))
    return tuple(groups)


@dataclass(frozen=True)
class Design:
    """A protocol with three numbers free: darks at one exposure, darks of a series, flats at each level."""

    longest_dark_s: float = 5.0
    longest_flat_s: float = 0.05

    def protocol(self, darks: int, repeats: int, flats: int) -> ShootingProtocol:
        """Darks at the shortest flat's exposure, a dark series from there, and flats in equal steps."""
        shortest = self.longest_flat_s / LEVELS
        return ShootingProtocol(
            "planned",
            (
                Step("dark", shortest, darks),
                *series("dark", 2 * shortest, self.longest_dark_s, _DARK_EXPOSURES, repeats),
                *(Step("light", shortest * (k + 1), flats) for k in range(LEVELS)),
            ),
        )


def plan_frames(
    sensor: Sensor,
    wants: Mapping[str, Want],
    *,
    design: Design | None = None,
    illuminant: str = "D65",
    metered: bool = False,
) -> Plan:
    """The fewest frames that are found to reach what is wanted.

    From two frames at every setting on, the number that brings the wants nearest for the frames it costs is doubled,
    until all are met; then each number is brought down as far as they stay met.

    Parameters
    ----------
    sensor
        A guess of the sensor.
    wants
        By parameter.
    design
        The exposures.
    illuminant
        Light of the flats.
    metered
        Whether the photons will be known.

    Raises
    ------
    InputError
        If nothing is wanted, a parameter cannot be had from such frames, or no number of frames is enough: the pixels
        themselves are a sample.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.studies.virtual_lab import with_pedestal
    >>> sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=200, cols=200))
    >>> plan = plan_frames(sensor, {"read_noise_dn": Want.parse("read_noise_dn=0.2%")})
    >>> plan.protocol.steps[0].count, plan.protocol.frame_count  # 1 / sqrt(2 (n - 1) 40 000) is 0.2 %
    (5, 49)
    """
    if not wants:
        raise InputError("say what is wanted, such as prnu_percent=2%")
    design = design or Design()
    level = TOP / _weakest_share(sensor, design, illuminant)

    def planned(counts: tuple[int, ...]) -> Plan:
        protocol = design.protocol(*counts)
        lab = virtual_lab(sensor, protocol, illuminant=illuminant, level=level, photons_known=metered)
        return replace(plan_protocol(lab), wants=tuple(wants.values()))

    def worst(plan: Plan) -> float:
        return max(want.reached(getattr(plan.expected, want.parameter)) for want in wants.values())

    counts = [2, 2, 2]
    plan = planned(tuple(counts))
    while worst(plan) > 1.0:
        options = []
        for k in range(3):
            if 2 * counts[k] <= MOST_FRAMES:
                more = [2 * n if i == k else n for i, n in enumerate(counts)]
                better = planned(tuple(more))
                cost = better.protocol.frame_count - plan.protocol.frame_count
                options.append((_progress(plan, better, wants) / cost, more, better))
        if not options or max(option[0] for option in options) <= 1e-9:
            raise _unreachable(planned((MOST_FRAMES,) * 3), wants)
        _, counts, plan = max(options, key=lambda option: option[0])
    for k in (2, 1, 0):
        low, high = (counts[k] // 2 if counts[k] > 2 else 1), counts[k]
        while high - low > 1:
            middle = (low + high) // 2
            tried = planned(tuple(middle if i == k else n for i, n in enumerate(counts)))
            low, high = (low, middle) if worst(tried) <= 1.0 else (middle, high)
        counts[k] = high
    return planned(tuple(counts))


def _weakest_share(sensor: Sensor, design: Design, illuminant: str) -> float:
    """Electrons of the least over those of the most sensitive channel: all channels are to reach saturation."""
    lab = virtual_lab(sensor, design.protocol(2, 2, 1), illuminant=illuminant)
    brightest = planned_groups(lab)[-1].electrons
    least = min(brightest)
    return least / max(brightest) if least > 0.05 * max(brightest) else 1.0


def _progress(before: Plan, after: Plan, wants: Mapping[str, Want]) -> float:
    """How far the wants that are not met come nearer, in logarithms."""
    result = 0.0
    for want in wants.values():
        then, now = (want.reached(getattr(plan.expected, want.parameter)) for plan in (before, after))
        if then > 1.0:
            result += math.log(then / max(now, 1.0))
    return result


def _unreachable(best: Plan, wants: Mapping[str, Want]) -> InputError:
    for want in wants.values():
        found = getattr(best.expected, want.parameter)
        if want.reached(found) > 1.0:
            share = f" ({100 * found.standard_uncertainty / abs(found.value):.2g} %)" if found.value else ""
            array = best.sensor.array
            return InputError(
                f"{want.parameter} to {want.text} cannot be reached: with {MOST_FRAMES} frames at every setting its "
                f"standard uncertainty is {found.standard_uncertainty:.3g}{share}, for {array.rows} x {array.cols} "
                f"pixels are a sample themselves; want less, or plan for a larger chip"
            )
    raise AssertionError("some want is not met")


def setting_text(group: PlannedGroup, capacity_e: float) -> str:
    """How bright a group is, in words: "dark", or the brightest channel in shares of saturation."""
    if group.kind == "dark":
        return "dark"
    return f"{100 * max(group.electrons) / capacity_e:.3g} % of saturation"


def step_from(text: str) -> Step:
    """A step from `light:1/50:5`: kind, exposure, frames.

    Raises
    ------
    InputError
        If it is no step.

    Examples
    --------
    >>> step = step_from("dark:1/8000:50")
    >>> step.kind, step.exposure_s, step.count
    ('dark', 0.000125, 50)
    """
    from photosite.frames.frame_set import KINDS

    parts = [part.strip() for part in text.split(":")]
    kind = next((kind for kind in KINDS if kind == parts[0]), None)
    if len(parts) != 3 or kind is None or not parts[2].isdecimal():
        raise InputError(f"a step is dark:EXPOSURE:FRAMES or light:EXPOSURE:FRAMES, such as light:1/50:5, not '{text}'")
    return Step(kind, parse_exposure(parts[1]), int(parts[2]))


def predictable() -> tuple[str, ...]:
    """The parameters that a plan predicts."""
    return tuple(name for name in PARAMETER_LABELS if not name.startswith(("dsnu1288", "prnu1288", "linearity")))
