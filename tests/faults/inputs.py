"""Small inputs of the commands under faults: each is a function that writes a file or folder of its name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
from camera_files import darktable_content, write_json
from virtual_gain_series import GainModel, gain_series_lab, gain_series_protocol
from virtual_monochromator import MonochromatorRun

import photosite as ps
from photosite.cli.main import run
from photosite.sensor.assumed_channels import assumed_channels
from photosite.sensor.readout import digital_numbers
from photosite.studies.protocol import ShootingProtocol, paper_d200_protocol
from photosite.studies.virtual_lab import with_pedestal

SMALL = "--rows 64 --cols 96"

SWEEP = """photosite_sweep: 1
camera: {{sensor: vendor-2.2um, optics: {{f_number: 2.8, focal_length_mm: 4}}}}
values: {{f_number: [2, {value}]}}
measure: {{snr: {{luminance_cd_m2: 20, exposure: 1/15}}}}
"""


def few_frames() -> ShootingProtocol:
    """Return the protocol of the 2008 paper with an eighth of its frames, two or more of each exposure."""
    whole = paper_d200_protocol()
    return replace(whole, steps=tuple(replace(step, count=max(2, step.count // 8)) for step in whole.steps))


def _seed(path: Path) -> int:
    """Return the digit that ends a name."""
    return int(path.name[-1])


def _write_electrons(path: Path) -> None:
    np.save(path, np.full((16, 16), 500.0, np.float32))


def _write_sweep(path: Path) -> None:
    path.write_text(SWEEP.format(value=path.name.removesuffix(".sweep.yaml")))


def _write_stack(path: Path) -> None:
    with mock.patch("photosite.studies.protocol.paper_d200_protocol", few_frames):
        size = ["--rows", "48", "--cols", "64"]
        assert run(["shoot", "--photons", *size, "--seed", str(_seed(path)), "-o", str(path)]) == 0


def _write_gain_series(path: Path) -> None:
    sensor = ps.load_sensor("nikon-d200").with_(rows=32, cols=48, black_level_dn=200, well_capacity_e=60_000)
    protocol = gain_series_protocol(dark_frames=4, levels=6, repeats=2)
    gain_series_lab(sensor, GainModel(0.2, 1.5), [100, 200], protocol, seed=_seed(path)).write(path)


def _write_monochromator(path: Path) -> None:
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=16, cols=16))
    MonochromatorRun(sensor, (500.0, 550.0, 600.0), 8.0, frames=2, dark_frames=2, seed=_seed(path)).write(path)


def _write_dark_series(path: Path) -> None:
    sensor = ps.load_sensor("nikon-d200").with_(
        rows=16, cols=24, black_level_dn=64, dark_current_e_per_s=40, dark_current_temperature_c=25, dark_doubling_c=6.5
    )
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    path.mkdir()
    for celsius in (15.0, 25.0, 35.0):
        for time_s in (0.01, 5.0):
            for n in range(2):
                at = {"temperature_c": celsius, "seed": _seed(path), "frame": n}
                raw = camera.expose(np.zeros((16, 24), np.float32), time_s, **at)
                raw.save(path / f"dark_{time_s:g}s_{celsius:g}C_{n}.tif")


def polarized_sensor() -> ps.Sensor:
    """Return a small sensor with polarizers."""
    channels = assumed_channels(("P90", "P45", "P135", "P0"), 0.6)
    return ps.load_sensor("sony-imx174").with_(
        rows=16, cols=24, cfa="polarization", channels=channels, black_level_dn=200
    )


def _write_polarized(path: Path) -> None:
    sensor = polarized_sensor()
    angles = np.array([[90, 45], [135, 0]])
    path.mkdir()
    for angle in (None, 0, 45, 90, 135):
        light = 0 if angle is None else 10_000 * (1 + 0.95 * np.cos(np.radians(2 * (angle - angles))))
        mean = np.tile(np.broadcast_to(light, (2, 2)), (8, 12)).astype(np.float32)
        for n in range(2):
            dn = digital_numbers(sensor, mean, 0.01, seed=_seed(path), frame=10 * (angle or 999) + n)
            name = f"dark_{n}.tif" if angle is None else f"flat_{angle}deg_{n}.tif"
            raw = ps.RawFrame(dn, sensor.readout.bits, sensor.array.cfa, black_level_dn=200, exposure_s=0.01)
            raw.save(path / name)


def multiplying_sensor(gain: float) -> ps.Sensor:
    """Return a small sensor with a multiplication register."""
    return ps.load_sensor("nikon-d200").with_(
        rows=24,
        cols=32,
        cfa="mono",
        channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.9, 0.9]}},
        bits=16,
        black_level_dn=200,
        system_gain_dn_per_e=0.1,
        read_noise_e=40,
        well_capacity_e=400_000,
        em_gain={"gain": gain, "stages": 300},
    )


def _write_register(path: Path) -> None:
    path.mkdir()
    for folder, gain, longest_s in (("unity", 1.0, 0.3), ("gain", 100.0, 3e-4)):
        (path / folder).mkdir()
        steps = [("dark", longest_s, 0.0)] * 4
        steps += [("light", n * longest_s / 6, 1e6 * n * longest_s / 6) for n in range(1, 7) for _ in range(3)]
        for number, (kind, time_s, electrons) in enumerate(steps):
            mean = np.full((24, 32), electrons, np.float32)
            dn = digital_numbers(multiplying_sensor(gain), mean, time_s, seed=_seed(path), frame=number)
            raw = ps.RawFrame(dn, 16, black_level_dn=200, exposure_s=time_s)
            raw.save(path / folder / f"{kind}_{number}.tif")


def _write_shot(path: Path) -> None:
    assert run(["simulate", *SMALL.split(), "-o", str(path)]) == 0


def _write_chart(path: Path) -> None:
    sensor = ["--sensor", str(path.with_name("chart.sensor.yaml"))]
    assert run(["simulate", *sensor, "--seed", str(_seed(path.with_suffix(""))), "-o", str(path)]) == 0


INPUTS: dict[str, Callable[[Path], object]] = {
    "e.npy": _write_electrons,
    "4.sweep.yaml": _write_sweep,
    "5.6.sweep.yaml": _write_sweep,
    "stack0": _write_stack,
    "stack1": _write_stack,
    "series0": _write_gain_series,
    "series1": _write_gain_series,
    "bands0": _write_monochromator,
    "bands1": _write_monochromator,
    "darks0": _write_dark_series,
    "darks1": _write_dark_series,
    "turned0": _write_polarized,
    "turned1": _write_polarized,
    "register0": _write_register,
    "register1": _write_register,
    "polarized.sensor.yaml": lambda path: polarized_sensor().save(path),
    "register.sensor.yaml": lambda path: multiplying_sensor(1.0).save(path),
    "chart.sensor.yaml": lambda path: (
        ps.load_sensor("nikon-d200").with_(rows=66, cols=98, black_level_dn=64).save(path)
    ),
    "chart0.dng": _write_chart,
    "chart1.dng": _write_chart,
    "shot.dng": _write_shot,
    "scene.h5": lambda path: ps.charts.macbeth(illuminant="A", mean_luminance_cd_m2=40).save(path),
    "noiseprofiles.json": lambda path: write_json(path, darktable_content()),
}


def write_inputs(inputs: Path, commands: list[str]) -> None:
    """Write the inputs that some command lines name, unless they are there."""
    inputs.mkdir(parents=True, exist_ok=True)
    for name, write in INPUTS.items():
        path = inputs / name
        if any(str(path) in command for command in commands) and not path.exists():
            write(path)
