"""Charge transfer inefficiency: hidden in simulated frames, found again behind the illuminated lines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom, nbinom

import photosite as ps
from photosite.calibration.effects.charge_transfer import TransferLoss, measure_charge_transfer, trailing_fraction
from photosite.frames.frame_set import FrameSet, without_border
from photosite.sensor.readout import digital_numbers

BEHIND = 8
MONO = {"cfa": "mono", "channels": {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}}
CCD = ps.load_sensor("nikon-d200").with_(**MONO, black_level_dn=100, charge_transfer={}, well_capacity_e=25_000)


def moved(lines: int, inefficiency: float) -> np.ndarray:
    """(read, lines) fraction of each line's charge that is read in each clock cycle."""
    read, line = np.arange(lines + BEHIND)[:, None], np.arange(lines)
    return nbinom.pmf(read - line, line + 1, 1.0 - inefficiency)


def simulated(seed: int, parallel: float, serial: float, rows: int = 40, cols: int = 48) -> TransferLoss:
    """Frames by plain NumPy: Poisson charge, transfers, pattern, noise of pixels, rows and columns, rounding."""
    rng = np.random.default_rng(seed)
    down, across = moved(rows, parallel), moved(cols, serial)
    response, dark_rate = rng.normal(1.0, 0.01, (rows, cols)), rng.lognormal(3.0, 0.3, (rows, cols))
    offset = rng.normal(0.0, 8.0, (rows + BEHIND, cols + BEHIND))
    size, frames = offset.shape, []
    steps = [("dark", 0.01, 0.0, 6), ("dark", 2.0, 0.0, 6), *(("light", 0.01 * n, 4000.0 * n, 2) for n in range(1, 7))]
    for kind, exposure_s, electrons, count in steps:
        for _ in range(count):
            charge = rng.poisson(electrons * response + dark_rate * exposure_s)
            signal = down @ charge @ across.T + offset + rng.normal(0.0, 8.0, size)
            signal += rng.normal(0.0, 2.0, (size[0], 1)) + rng.normal(0.0, 2.0, size[1])
            frames.append((kind, exposure_s, np.rint(0.1 * signal + 100).astype(np.uint16)))
    whole = without_border(FrameSet.from_arrays(frames, bits=12), (0, BEHIND, 0, BEHIND))
    used = [SimpleNamespace(source=source) for group in whole.groups for source in group.frames]
    count = len(whole.of_kind("light"))
    levels = SimpleNamespace(group=np.arange(count), x=np.arange(1.0, count + 1.0), trusted=np.ones(count, np.bool_))
    evidence = SimpleNamespace(
        base=CCD,
        light=SimpleNamespace(channels=[SimpleNamespace(levels=levels, used=np.ones(count, np.bool_))]),
        reduction=SimpleNamespace(frames=whole, used=used),
    )
    found = measure_charge_transfer(evidence)  # type: ignore[arg-type]
    assert isinstance(found, TransferLoss)
    return found


def outcomes(sensors: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors in standard uncertainties, and whether the intervals cover, of hidden inefficiencies."""
    rng = np.random.default_rng(1)
    errors, inside = [], []
    for seed in range(sensors):
        truth = 10 ** rng.uniform(-6.0, -3.0, 2)
        found = simulated(seed, *truth)
        for true, entry in zip(truth, (found.parallel.inefficiency, found.serial.inefficiency), strict=True):
            low, high = entry.interval_95
            inside.append(low < true < high)
            errors.append((entry.value - true) / entry.standard_uncertainty)
    return np.array(errors), np.array(inside)


def test_inefficiency_is_found() -> None:
    errors, inside = outcomes(12)
    assert inside.sum() >= 20
    assert abs(errors.mean()) < 0.9


@pytest.mark.slow
def test_intervals_cover() -> None:
    """200 sensors, both directions: 92.6 to 97.3 % are 2.2 binomial sigma about 95 %; the bias is a fifth of u."""
    errors, inside = outcomes(200)
    assert 0.926 < inside.mean() < 0.973
    assert abs(errors.mean()) < 0.2


@pytest.mark.slow
def test_no_loss_is_seen_in_one_of_200() -> None:
    found = [simulated(seed, 0.0, 0.0) for seed in range(200)]
    assert sum(edge.seen for each in found for edge in (each.parallel, each.serial)) <= 6


def test_no_loss_is_written_as_zero() -> None:
    edge = simulated(3, 0.0, 0.0)
    section = edge.section(CCD, "frames")["charge_transfer"]
    assert not edge.serial.seen
    assert section.serial_inefficiency.value == 0.0
    assert section.serial_inefficiency.standard_uncertainty > 0.0


def test_charge_left_behind_is_named_with_the_change_of_the_gain() -> None:
    """Variance of shot noise in 200 lines of which line n leaves n s behind and gets that of the line before."""
    found = simulated(3, 1e-4, 0.0)
    (named,) = found.diagnostics
    lines = np.arange(1, found.parallel.transfers + 1)
    kept = 1.0 - found.parallel.inefficiency.value * lines
    assert named.size == pytest.approx(np.mean(kept**2 + (1.0 - kept) ** 2) - 1.0, rel=0.03)
    assert named.parameters
    assert replace(found, parallel=replace(found.parallel, seen=False)).diagnostics == ()


def test_the_fraction_behind_the_last_line_is_that_of_clocked_lines() -> None:
    for s, lines in ((1e-5, 40), (1e-2, 40)):
        arrived = np.array([binom.cdf(np.arange(lines), k, 1.0 - s).sum() for k in range(lines, lines + 9)])
        late = -np.diff(arrived)
        assert trailing_fraction(s, lines, 4, 8) == pytest.approx(late[:4].sum() - late[4:].sum(), rel=1e-6)


@pytest.mark.parametrize("output", ["top_left", "bottom_right"])
def test_from_frames_of_the_camera(output: str, tmp_path: Path) -> None:
    """Overscan opposite to the output, DNG with masked areas: both inefficiencies, in sensor file and report."""
    truth = {"parallel_inefficiency": 2e-4, "serial_inefficiency": 1e-4, "output": output}
    lines = {"left": 2, "overscan_rows": 6, "overscan_cols": 8}
    worn = CCD.with_(rows=46, cols=58, optical_black=lines, charge_transfer=truth)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), worn)
    steps = [("dark", 0.01, 0)] * 6 + [("light", 0.01 * n, 2500 * n) for n in range(1, 8) for _ in range(2)]
    for number, (kind, exposure_s, electrons) in enumerate(steps):
        raw = camera.expose(np.full((46, 58), electrons, np.float32), exposure_s, frame=number)
        raw.save(tmp_path / f"{kind}_{number}.dng")
    frames = ps.open_frames(tmp_path)
    assert (frames.rows, frames.cols, frames.border) == (40, 48, worn.effects.border)
    base = worn.with_(charge_transfer={"output": output})
    calibration = ps.calibrate(frames, base)
    found = calibration.charge_transfer
    for edge, true, transfers in ((found.parallel, 2e-4, 40), (found.serial, 1e-4, 50 if output == "top_left" else 48)):
        assert abs(edge.inefficiency.value - true) < 4 * edge.inefficiency.standard_uncertainty < 4e-5
        assert edge.transfers == transfers
    measured = calibration.sensor
    assert (measured.array.rows, measured.array.cols) == (46, 58)
    assert measured.effects.charge_transfer.output == output
    assert measured.effects.charge_transfer.parallel_inefficiency.value == found.parallel.inefficiency.value
    (named,) = (each for each in calibration.diagnostics if each.id == "charge-left-behind")
    assert {"system_gain_dn_per_e", "read_noise_e", "conversion_gain_uv_per_e"} <= set(named.parameters)
    assert named.text in calibration.warnings
    calibration.report(tmp_path / "report.html")
    assert "Charge transfer inefficiency" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert calibration.to_dict()["charge_transfer"]["serial"]["transfers"] == found.serial.transfers


def test_without_lines_behind_there_is_a_reason() -> None:
    steps = [("dark", 0.01, 0)] * 4 + [("light", 0.01 * n, 2500 * n) for n in range(1, 5) for _ in range(2)]
    small = CCD.with_(rows=24, cols=24, optical_black={"overscan_rows": 4})
    frames = [
        (kind, t, digital_numbers(small, np.full((24, 24), electrons, np.float32), t, seed=3, frame=n))
        for n, (kind, t, electrons) in enumerate(steps)
    ]
    calibration = ps.calibrate(FrameSet.from_arrays(frames, bits=12, sensor=small))
    assert (calibration.rows, calibration.cols) == (20, 24)
    assert calibration.charge_transfer.parallel.inefficiency.value is not None
    assert calibration.charge_transfer.serial.inefficiency.value is None
    plain = ps.calibrate(FrameSet.from_arrays(frames, bits=12, sensor=small.with_(charge_transfer=None)))
    assert plain.charge_transfer is None
