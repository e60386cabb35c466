"""What a calibration answers to stacks of frames that are not clean."""

from __future__ import annotations

import json
from importlib.resources import files

import pytest

from photosite.calibration.diagnostics import detection_entry, diagnostic_kind
from photosite.studies.detection import detection_study, smallest_found
from photosite.studies.imperfect_stacks import GAIN, KINDS, SATURATION_E, StackKind, calibrate_stack, imperfect_stacks

KIND = {kind.name: kind for kind in KINDS}
GIVEN, WITHHELD = "given", "withheld"
ANSWERS: dict[str, tuple[tuple[float, float] | None, str, str, str]] = {
    # size of the diagnostic, a parameter that it concerns, system gain, PRNU
    "clean": (None, "", GIVEN, GIVEN),
    "clean mosaic": (None, "saturation_dn", GIVEN, GIVEN),
    "crosstalk": ((0.03, 0.06), "system_gain_dn_per_e", GIVEN, GIVEN),
    "smoothing in the camera": ((0.1, 0.15), "read_noise_e", WITHHELD, WITHHELD),
    "sharpening in the camera": ((-0.17, -0.11), "read_noise_e", WITHHELD, WITHHELD),
    "image lag": ((0.02, 0.04), "system_gain_dn_per_e", GIVEN, GIVEN),
    "noise reduction over time": ((0.15, 0.25), "read_noise_e", WITHHELD, WITHHELD),
    "row noise": (None, "", GIVEN, GIVEN),
    "flicker of the light": ((0.006, 0.008), "system_gain_dn_per_e", GIVEN, GIVEN),
    "drift of the light": ((0.01, 0.05), "responsivity_dn_per_photon", GIVEN, GIVEN),
    "bent response": ((-0.02, -0.01), "system_gain_dn_per_e", GIVEN, GIVEN),
    "bent response, 4th power": ((0.005, 0.03), "system_gain_dn_per_e", GIVEN, GIVEN),
    "knee of the response": ((-0.03, -0.01), "system_gain_dn_per_e", GIVEN, GIVEN),
    "soft saturation": ((-0.08, -0.04), "system_gain_dn_per_e", GIVEN, GIVEN),
    "non-linear light": ((-0.02, -0.005), "responsivity_dn_per_photon", GIVEN, GIVEN),
    "mosaic not stated": ((0.5, 0.6), "prnu_percent", GIVEN, WITHHELD),
    "wrong phase": ((0.2, 0.3), "prnu_percent", GIVEN, WITHHELD),
    "digital gain": ((1.36, 1.38), "read_noise_mv", GIVEN, GIVEN),
    "digital gain below 1": ((0.79, 0.81), "read_noise_mv", GIVEN, GIVEN),
    "prescaled colors": ((2.0, 2.2), "read_noise_mv", WITHHELD, GIVEN),
    "gamma": ((0.5, 0.7), "prnu_percent", WITHHELD, WITHHELD),
    "square-root companding": ((0.55, 0.7), "prnu_percent", WITHHELD, WITHHELD),
    "clipping below full scale": (None, "", GIVEN, GIVEN),
    "partly full wells": ((0.1, 0.3), "prnu_percent", GIVEN, GIVEN),
    "readout channels": ((0.009, 0.011), "prnu_percent", GIVEN, GIVEN),
    "taps": ((0.009, 0.013), "prnu_percent", GIVEN, GIVEN),
    "uneven light": ((1.5, 3.0), "prnu_percent", GIVEN, GIVEN),
    "wrong level": ((0.95, 0.97), "responsivity_dn_per_photon", GIVEN, GIVEN),
    "alternating black level": ((1.0, 1.2), "black_level_dn", GIVEN, GIVEN),
    "mirrored dark frames": ((-0.3, 0.3), "dsnu_dn", GIVEN, GIVEN),
    "covered columns": ((0.033, 0.034), "prnu_percent", GIVEN, WITHHELD),
    "frames of another chip": (None, "", GIVEN, GIVEN),
    "turned frames": (None, "", GIVEN, GIVEN),
    "light that does not grow": ((0.015, 0.025), "responsivity_dn_per_photon", GIVEN, GIVEN),
    "hot pixels": ((0.0015, 0.0025), "dark_current_dn_per_s", GIVEN, GIVEN),
    "pixels that blink if lit": ((0.0015, 0.0025), "system_gain_dn_per_e", GIVEN, GIVEN),
}  # fmt: skip


@pytest.mark.parametrize("name", KIND)
def test_a_stack_raises_its_diagnostic_with_size_and_parameters(name: str) -> None:
    kind = KIND[name]
    size, parameter, gain, prnu = ANSWERS[name]
    answer = calibrate_stack(kind, 2)
    assert answer.right
    assert answer.found
    assert [isinstance(entry, str) for entry in (answer.gain, answer.prnu)] == [gain == WITHHELD, prnu == WITHHELD]
    raised = [entry for entry in answer.diagnostics if entry.id == kind.diagnostic]
    if parameter:
        assert any(parameter in entry.parameters for entry in raised)
    if size is not None:
        assert any(entry.size is not None and size[0] <= entry.size <= size[1] for entry in raised)


@pytest.mark.parametrize("name", ["crosstalk", "image lag", "flicker of the light"])
def test_the_gain_is_corrected(name: str) -> None:
    """Without the correction it is 15 % low, 6 % low and 25 % high."""
    gain = calibrate_stack(KIND[name], 2).gain
    assert not isinstance(gain, str)
    assert gain[0] <= GAIN <= gain[1]
    assert gain[1] - gain[0] < 0.07 * GAIN


@pytest.mark.parametrize("factor", [1.8, 2.0])
def test_soft_saturation_with_few_levels_below_withholds_the_gain(factor: float) -> None:
    """One or two levels are below 70 % of the largest variance; with two, a line through them is 25 % low."""
    kind = StackKind("", "", charge=lambda e, *_: e / (1.0 + (factor - 1.0) * e / SATURATION_E))
    answer = calibrate_stack(kind, 1)
    assert isinstance(answer.gain, str)
    assert isinstance(answer.prnu, str)
    assert "tone-curve" in answer.ids


@pytest.mark.slow
def test_clean_stacks_are_right_and_not_reported() -> None:
    answers = list(imperfect_stacks(range(20), KINDS[:2]))
    # 40 stacks of two 95 % intervals: fewer than 30 right in 1 of 5000.
    assert sum(answer.right for answer in answers) >= 30
    raised = [entry.id for answer in answers for entry in answer.diagnostics if entry.severity == "warning"]
    assert len(set(raised) - {"no-saturation"}) <= 1


def test_the_smallest_size_is_bisected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lag is found from 1.1 % in this study: 3 % is halved, and its powers of 2^-1.5, -1.25 and -1.375 are tried."""
    tried: list[float] = []

    def count(kind: StackKind, seeds: range, *, stop: bool = True) -> int:
        tried.append(kind.amount or 0.0)
        return len(seeds) if (kind.amount or 1.0) >= 0.011 else 0

    monkeypatch.setattr("photosite.studies.detection.count_found", count)
    found = smallest_found(KIND["image lag"], range(20))
    assert tried == pytest.approx([0.03 / 2**n for n in (0, 1, 2, 1.5, 1.25, 1.375)])
    assert (found.diagnostic, found.found, found.stacks, found.varied) == ("correlated-noise", 20, 20, True)
    assert found.size == "1.2 % of the charge to the next frame"
    assert not smallest_found(KIND["gamma"], range(20)).varied


def test_the_study_counts_clean_stacks() -> None:
    found = detection_study(stacks=1, clean=1, kinds=(KIND["clean"], KIND["digital gain"], KIND["hot pixels"]))
    assert (found["clean_stacks"], found["alarms"]) == (1, {})
    assert [entry["found"] for entry in found["smallest"]["digital-gain"]] == [1]
    assert [entry["found"] for entry in found["smallest"]["defective-pixels"]] == [1]


def test_entries_of_diagnostics_have_what_the_study_found() -> None:
    """The stored result is of known kinds with their diagnostics."""
    stored = json.loads(files("photosite.calibration").joinpath("detection.json").read_text(encoding="utf-8"))
    for name, entries in stored["smallest"].items():
        shown = detection_entry(diagnostic_kind(name))["Smallest found"]
        assert all(KIND[entry["kind"]].diagnostic == name and entry["size"] in shown for entry in entries)
    assert all(diagnostic_kind(name).id == name for name in stored["alarms"])
