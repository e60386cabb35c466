"""Plans against closed forms and against virtual measurements."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.engine.threads import threads_for
from photosite.errors import InputError
from photosite.studies.conditions import CONDITIONS
from photosite.studies.planning import Design, Want, plan_frames, plan_protocol, step_from
from photosite.studies.virtual_lab import virtual_lab, with_pedestal

PREDICTED = tuple(name for name in PARAMETER_LABELS if not name.startswith(("dsnu1288", "prnu1288", "linearity")))


@pytest.mark.slow
def test_the_expected_uncertainty_is_the_spread_of_virtual_measurements() -> None:
    """60 chips of one sensor.

    The ratio of their standard deviation to the expected uncertainty has a standard error of 9 %. Each limit rejects a
    correct prediction with probability 10^-4; one that is wrong by a factor of 2 is accepted with 10^-4. The
    uncertainty of the saturation is not a spread over chips: its position between the exposures is the same for all.
    """
    sensors = 60
    low, high = np.sqrt(stats.chi2.ppf((1e-4, 1 - 1e-4), sensors - 1) / (sensors - 1))
    some = CONDITIONS["few-mono-12"]
    sensor, lab = some.sensor(1), some.lab(1)
    found: dict[str, list[float]] = {}
    for number in range(sensors):
        chip = replace(lab.camera, sensor=sensor.with_(serial=f"plan {number}"))
        with threads_for(1):
            estimates = calibrate(replace(lab, camera=chip, seed=number).frame_set()).estimates()
        for name, entry in estimates.items():
            if entry.value is not None:
                found.setdefault(name, []).append(entry.value)
    plan = plan_protocol(lab)
    between = {"saturation_capacity_e", "saturation_capacity_photons", "snr_max_db", "dynamic_range_db"}
    off = {}
    for name in PREDICTED:
        expected = getattr(plan.expected, name)
        if name in between or not expected.standard_uncertainty:
            continue
        values = np.array(found[name])
        ratio = values.std(ddof=1) / expected.standard_uncertainty
        far = abs(values.mean() - expected.value) * math.sqrt(sensors) / expected.standard_uncertainty
        if not low < ratio < high or far > 4.5:
            off[name] = (ratio, far)
    assert off == {}
    assert len(PREDICTED) > 20


def test_read_noise_and_prnu_follow_the_textbook() -> None:
    """A variance over n frames of P pixels has the variance 2 v^2 / ((n - 1) P); the pixels are a sample too."""
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=200, cols=200))
    plan = plan_frames(sensor, {"read_noise_dn": Want.parse("read_noise_dn=0.1%")})
    darks = plan.protocol.steps[0].count
    assert 1 / math.sqrt(2 * (darks - 1) * 40_000) <= 0.001 * 1.02 <= 1 / math.sqrt(2 * (darks - 3) * 40_000)
    prnu = plan.expected.prnu_percent
    assert prnu.value is not None
    assert prnu.standard_uncertainty is not None
    assert prnu.standard_uncertainty > prnu.value / math.sqrt(2 * 40_000)


def test_every_want_is_met_and_fewer_frames_do_not_suffice() -> None:
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=100, cols=100))
    wants = {w.parameter: w for w in map(Want.parse, ("prnu_percent=1.2%", "system_gain_dn_per_e=0.3%"))}
    plan = plan_frames(sensor, wants)
    reached = {name: want.reached(getattr(plan.expected, name)) for name, want in wants.items()}
    assert max(reached.values()) <= 1.0
    steps = plan.protocol.steps
    fewer = replace(
        plan.protocol, steps=tuple(replace(s, count=s.count - 1) if s.kind == "light" else s for s in steps)
    )
    less = plan_protocol(virtual_lab(sensor, fewer, level=1.25 / 0.579)).expected
    assert max(want.reached(getattr(less, name)) for name, want in wants.items()) > 1.0


def test_a_modest_want_takes_the_minimum_protocol() -> None:
    """Three levels in the linear range of both green and red, three dark exposures, two frames at each."""
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=400, cols=400))
    wants = {w.parameter: w for w in map(Want.parse, ("prnu_percent=2%", "system_gain_dn_per_e=0.5%"))}
    plan = plan_frames(sensor, wants)
    assert plan.least
    assert {step.count for step in plan.protocol.steps} == {2}
    lights, darks = ([g for g in plan.groups if g.kind == kind] for kind in ("light", "dark"))
    assert len(darks) == 3
    linear = [sum(g.electrons[k] <= 0.7 * sensor.saturation_capacity_e for g in lights) for k in range(3)]
    assert min(linear) == 3
    assert plan.protocol.frame_count == 2 * (len(darks) + len(lights)) <= 28
    full = Design().protocol(2, 2, 2)
    assert plan.protocol.frame_count < full.frame_count
    better = plan_frames(sensor, {"k": Want.parse("system_gain_dn_per_e=0.05%")})
    assert not better.least
    assert better.protocol.frame_count > plan.protocol.frame_count


def test_unreachable_precision_is_rejected_with_the_best_that_is_possible() -> None:
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=100, cols=150))
    with pytest.raises(InputError, match=r"prnu_percent to 0.1 % cannot be reached.*\(0.58 %\).*100 x 150"):
        plan_frames(sensor, {"prnu_percent": Want.parse("prnu_percent=0.1%")})
    with pytest.raises(InputError, match=r"quantum_efficiency_percent cannot be estimated.*photons"):
        plan_frames(sensor, {"q": Want.parse("quantum_efficiency_percent=1%")})
    with pytest.raises(InputError) as caught:
        plan_frames(sensor, {})
    assert caught.value.what == "wants"


def test_dark_frames_that_would_clip_are_rejected() -> None:
    with pytest.raises(InputError, match="0 DN"):
        plan_frames(ps.load_sensor("nikon-d200").with_(rows=10, cols=10), {"r": Want.parse("read_noise_dn=5%")})


@pytest.mark.parametrize("text", ["prnu_percent", "prnu_percent=", "prnu_percent=-1%", "prnu_percent=nan", "prnu=1%"])
def test_an_invalid_want_is_rejected(text: str) -> None:
    with pytest.raises(InputError):
        Want.parse(text)


@pytest.mark.parametrize("text", ["dark:1/50", "flat:1/50:3", "light:0:3", "light:1/50:0", "light:1/50:x"])
def test_an_invalid_step_is_rejected(text: str) -> None:
    with pytest.raises(InputError):
        step_from(text)
