"""Before the lab day: what precision a protocol will reach.

How many frames a wanted precision takes is searched in `photosite.studies.plan_search`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from photosite.calibration.parameters import PARAMETER_LABELS, Parameters, parameter_label
from photosite.calibration.plan import PlannedGroup, predict
from photosite.errors import InputError
from photosite.sensor.model import Sensor
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.studies.virtual_lab import VirtualLab
from photosite.values.cfa import channel_sites
from photosite.values.estimate import Estimate
from photosite.values.exposure import parse_exposure


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
    least
        Whether this is the least that a calibration needs, so that the wants take no frame more.
    """

    sensor: Sensor
    protocol: ShootingProtocol
    groups: tuple[PlannedGroup, ...]
    expected: Parameters
    wants: tuple[Want, ...] = ()
    least: bool = False

    def to_dict(self) -> dict[str, Any]:
        """What `photosite plan --json` prints."""
        estimates = self.expected.estimates()
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
    >>> from photosite.studies.virtual_lab import virtual_lab, with_pedestal
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
    from photosite.frames.frame_settings import KINDS

    parts = [part.strip() for part in text.split(":")]
    kind = next((kind for kind in KINDS if kind == parts[0]), None)
    if len(parts) != 3 or kind is None or not parts[2].isdecimal():
        raise InputError(f"a step is dark:EXPOSURE:FRAMES or light:EXPOSURE:FRAMES, such as light:1/50:5, not '{text}'")
    return Step(kind, parse_exposure(parts[1]), int(parts[2]))


def predictable() -> tuple[str, ...]:
    """The parameters that a plan predicts."""
    return tuple(name for name in PARAMETER_LABELS if not name.startswith(("dsnu1288", "prnu1288", "linearity")))
