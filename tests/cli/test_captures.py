"""Sensors with several captures on the command line: frames of each capture, and what calibrate shows of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photosite as ps

PHONE = ("--sensor", "dual-gain-phone", "--rows", 32, "--cols", 32)


def test_simulate_writes_each_capture(photosite: Any, tmp_path: Path) -> None:
    shot = ("simulate", *PHONE, "--exposure", "1/90", "--captures")
    done = photosite(*shot, "-o", tmp_path / "shot.tif", "--json")
    assert (done.status, done.err) == (0, "")
    phone = ps.load_sensor("dual-gain-phone").with_(rows=32, cols=32)
    parts = {name: ps.read_raw(tmp_path / f"shot.{name}.tif") for name in ("high", "low")}
    assert done.json["captures"] == {name: [str(tmp_path / f"shot.{name}.tif")] for name in parts}
    assert {name: (raw.bits, raw.metadata["capture"]) for name, raw in parts.items()} == {
        "high": (12, "high"),
        "low": (12, "low"),
    }
    combined = ps.read_raw(tmp_path / "shot.tif")
    assert combined.bits == 14
    bright, dark = parts["high"].dn.astype(float).mean() - 64, parts["low"].dn.astype(float).mean() - 64
    assert bright / dark == pytest.approx(4.0, rel=0.1)
    assert phone.output_bits == 14
    none = photosite("simulate", "--captures", "--rows", 32, "--cols", 32, "-o", tmp_path / "a.tif")
    assert (none.status, none.err.count("\n")) == (2, 1)


@pytest.mark.slow
@pytest.mark.usefixtures("short_protocol")
def test_calibrate_reads_the_captures(photosite: Any, tmp_path: Path) -> None:
    stack = tmp_path / "stack"
    assert photosite("shoot", *PHONE, "--captures", "-o", stack).status == 0
    parts = photosite("calibrate", stack, "--captures", "high,low", "--report", tmp_path / "r.html", "--json")
    assert parts.status == 0
    columns = (parts.json[name] for name in ("capture", "parameter", "value", "lower_95", "upper_95"))
    found = {(capture, name): values for capture, name, *values in zip(*columns, strict=True)}
    assert found["low", "signal_ratio"][0] == pytest.approx(0.25, rel=0.01)
    _, lower, upper = found["high", "read_noise_e"]
    assert 0.6 < lower < 0.8 < upper < 1.1
    assert "Sensitivity ratio" in (tmp_path / "r.html").read_text()
    wrong = photosite("calibrate", stack, "--captures", "high,middle")
    assert (wrong.status, wrong.err.count("\n")) == (2, 1)


def test_calibrate_says_what_it_sees_of_combined_frames(photosite: Any, tmp_path: Path) -> None:
    rng, number = np.random.default_rng(1), 0
    for light in [0.0, 0.0, *np.geomspace(60, 30000, 24)]:
        for _ in range(4):
            electrons = rng.poisson(light, (32, 32)) + rng.normal(0, 6, (32, 32))
            small = (rng.poisson(0.05 * light, (32, 32)) + rng.normal(0, 3, (32, 32))) / 0.05
            dn = np.where(electrons < 3000, electrons, small) + 100.5
            kind, time_s = ("light", light * 1e-6) if light else ("dark", 1e-4)
            raw = ps.RawFrame(np.uint16(dn), bits=16, exposure_s=time_s, metadata={"kind": kind})
            raw.save(tmp_path / f"{kind}_{number:03d}.tif")
            number += 1
    done = photosite("calibrate", tmp_path, "--json")
    assert done.status == 0
    assert "several-captures" in {entry["id"] for entry in done.json["diagnostics"]}
    found = dict(zip(zip(done.json["part"], done.json["parameter"], strict=True), done.json["value"], strict=True))
    assert found["capture 2", "sensitivity_ratio"] == pytest.approx(0.05, rel=0.1)
    assert found["knee 1", "signal_e"] == pytest.approx(3000, rel=0.2)
    output = photosite("calibrate", tmp_path, "--sensor", "nikon-d200", "-o", tmp_path / "a.yaml")
    assert (output.status, output.err.count("\n")) == (2, 1)
