"""Before the lab day: the fewest frames that are found to reach a wanted precision."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from photosite.errors import InputError
from photosite.sensor.model import Sensor
from photosite.studies.planning import Plan, Want, plan_protocol, planned_groups
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import virtual_lab

MOST_FRAMES = 4096
"""Frames at one setting beyond which a plan does not go."""

LEVELS, TOP = 16, 1.25
"""Flats of a design: at most so many equal steps, up to so many saturations."""

LEAST_FRAMES, LEAST_LINEAR_LEVELS, LEAST_SERIES = 2, 3, 2
"""What a calibration needs: frames at a setting, to part noise from pattern; flats of every channel in the linear
range, and exposures of the dark series beside the shortest, so that a line has one point more than it takes."""

LEAST_IN_WORDS = (
    f"{LEAST_FRAMES} frames at every setting, {LEAST_LINEAR_LEVELS} light levels in every channel's linear range, "
    f"{LEAST_SERIES + 1} dark exposures"
)

_LINEAR_SHARE = 0.7
"""Of saturation: where EMVA 1288's photon transfer ends."""

_DARK_EXPOSURES = 6


@dataclass(frozen=True)
class Design:
    """A protocol with three numbers free: darks at one exposure, darks of a series, flats at each level.

    Parameters
    ----------
    longest_dark_s, longest_flat_s
        Where the dark series and the flats end.
    levels, dark_exposures
        Flats, and exposures of the dark series.
    """

    longest_dark_s: float = 5.0
    longest_flat_s: float = 0.05
    levels: int = LEVELS
    dark_exposures: int = _DARK_EXPOSURES

    def protocol(self, darks: int, repeats: int, flats: int) -> ShootingProtocol:
        """Darks at the shortest flat's exposure, a dark series from there, and flats in equal steps."""
        shortest = self.longest_flat_s / self.levels
        return ShootingProtocol(
            "planned",
            (
                Step("dark", shortest, darks),
                *series("dark", 2 * shortest, self.longest_dark_s, self.dark_exposures, repeats),
                *(Step("light", shortest * (k + 1), flats) for k in range(self.levels)),
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

    Designs with few and many light levels and dark exposures are tried, from the least that a calibration needs
    (`LEAST_IN_WORDS`) on. In each, from two frames at every setting on, the number that brings the wants nearest for
    the frames it costs is doubled, until all are met; then each number is brought down as far as they stay met.

    Parameters
    ----------
    sensor
        A guess of the sensor.
    wants
        By parameter.
    design
        The longest exposures; its levels and dark exposures are the most that are tried.
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
    (5, 29)
    """
    if not wants:
        raise InputError("say what is wanted, such as prnu_percent=2%")
    design = design or Design()
    share = _weakest_share(sensor, design, illuminant)
    best: Plan | None = None
    refused: InputError | None = None
    for number, tried in enumerate(_designs(design, share)):
        try:
            found = _fewest(sensor, wants, tried, TOP / share, illuminant, metered, best)
        except InputError as error:
            refused = error
            continue
        if number == 0 and found is not None and found.protocol == tried.protocol(*(LEAST_FRAMES,) * 3):
            return replace(found, least=True)
        best = found or best
    if best is None:
        raise refused or InputError("no protocol was found")
    return best


def _designs(most: Design, share: float) -> list[Design]:
    """Few and many light levels and dark exposures, the least that a calibration needs first."""
    # The brightest channel has steps of TOP / share / levels: so many of them below the linear range's end.
    least = math.ceil(LEAST_LINEAR_LEVELS * TOP / (share * _LINEAR_SHARE) - 1e-9)
    few = sorted({min(least, most.levels), (least + most.levels) // 2 if least < most.levels else most.levels})
    return [
        replace(most, levels=levels, dark_exposures=exposures)
        for exposures in sorted({min(LEAST_SERIES, most.dark_exposures), most.dark_exposures})
        for levels in sorted({*few, most.levels})
    ]


def _fewest(
    sensor: Sensor,
    wants: Mapping[str, Want],
    design: Design,
    level: float,
    illuminant: str,
    metered: bool,
    best: Plan | None,
) -> Plan | None:
    """The fewest frames of one design; None where it takes as many as the best that is known already, or more."""

    def planned(counts: tuple[int, ...]) -> Plan:
        protocol = design.protocol(*counts)
        lab = virtual_lab(sensor, protocol, illuminant=illuminant, level=level, photons_known=metered)
        return replace(plan_protocol(lab), wants=tuple(wants.values()))

    def worst(plan: Plan) -> float:
        return max(want.reached(getattr(plan.expected, want.parameter)) for want in wants.values())

    counts = [LEAST_FRAMES] * 3
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
        # The numbers are brought down to more than half at the end.
        if best is not None and plan.protocol.frame_count > 2 * best.protocol.frame_count:
            return None
    for k in (2, 1, 0):
        low, high = (counts[k] // 2 if counts[k] > 2 else 1), counts[k]
        while high - low > 1:
            middle = (low + high) // 2
            tried = planned(tuple(middle if i == k else n for i, n in enumerate(counts)))
            low, high = (low, middle) if worst(tried) <= 1.0 else (middle, high)
        counts[k] = high
    found = planned(tuple(counts))
    return found if best is None or found.protocol.frame_count < best.protocol.frame_count else None


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
