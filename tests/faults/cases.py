"""The commands that write, with small inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np

import photosite as ps
from faults import Case
from photosite.cli.main import run
from photosite.studies.protocol import ShootingProtocol, paper_d200_protocol

SMALL = "--rows 64 --cols 96"

SWEEP = """photosite_sweep: 1
camera: {{sensor: vendor-2.2um, optics: {{f_number: 2.8, focal_length_mm: 4}}}}
values: {{f_number: [2, {value}]}}
measure: {{snr: {{luminance_cd_m2: 20, exposure: 1/15}}}}
"""


def few_frames() -> ShootingProtocol:
    """Return the protocol of the 2008 paper with an eighth of its frames."""
    whole = paper_d200_protocol()
    return replace(whole, steps=tuple(replace(step, count=-(-step.count // 8)) for step in whole.steps))


def _write_electrons(path: Path) -> None:
    np.save(path, np.full((16, 16), 500.0, np.float32))


def _write_sweep(path: Path) -> None:
    path.write_text(SWEEP.format(value=path.name.removesuffix(".sweep.yaml")))


def _write_stack(path: Path) -> None:
    with mock.patch("photosite.studies.protocol.paper_d200_protocol", few_frames):
        size = ["--rows", "48", "--cols", "64"]
        assert run(["shoot", "--photons", *size, "--seed", path.name[-1], "-o", str(path)]) == 0


def _write_shot(path: Path) -> None:
    assert run(["simulate", *SMALL.split(), "-o", str(path)]) == 0


def _write_scene(path: Path) -> None:
    ps.charts.macbeth(illuminant="A", mean_luminance_cd_m2=40).save(path)


INPUTS: dict[str, Callable[[Path], None]] = {
    "e.npy": _write_electrons,
    "4.sweep.yaml": _write_sweep,
    "5.6.sweep.yaml": _write_sweep,
    "stack0": _write_stack,
    "stack1": _write_stack,
    "shot.dng": _write_shot,
    "scene.h5": _write_scene,
}


def write_inputs(inputs: Path, chosen: list[Case]) -> None:
    """Write the inputs of some cases, unless they are there."""
    inputs.mkdir(parents=True, exist_ok=True)
    needed = " ".join(part for case in chosen for which in (0, 1) for part in case.command(which))
    for name, write in INPUTS.items():
        path = inputs / name
        if str(path) in needed and not path.exists():
            write(path)


def cases(inputs: Path) -> list[Case]:
    """Return the cases, with inputs in a folder."""
    stacks = tuple(str(inputs / f"stack{seed}") for seed in "01")
    sweeps = tuple(str(inputs / f"{value}.sweep.yaml") for value in ("4", "5.6"))
    seeds = ("1", "2")
    sensors = ("sony-a7r2", "sony-imx571")
    calibrate = "calibrate {value} -o mine.sensor.yaml --force"
    pair = ("mine.sensor.yaml", "mine.maps.h5")
    convert = f"convert {inputs}/scene.h5 --distance {{value}} --force -o"
    distances = ("2", "3")
    pairs = f"dataset {inputs}/e.npy --inputs-are electrons --sensor vendor-2.2um --crop 16x16 --crops 6"
    sheet = "--pixel-um 3.45 --full-well-e 10500 --qe-peak 0.65 --bits 12 --rows 2048 --cols 2448"
    return [
        Case("sensors new", f"sensors new {sheet} --read-noise-e {{value}} -o mine.sensor.yaml --force", seeds),
        Case("simulate", f"simulate {SMALL} --seed {{value}} -o shot.dng --force", seeds),
        Case("simulate, HDF5", f"simulate {SMALL} --seed {{value}} -o shot.h5 --clean clean.h5 --force", seeds),
        Case("sensors export", "sensors export {value} -o mine.sensor.yaml --force", ("vendor-2.2um", "nikon-d200")),
        Case("develop", f"develop {inputs}/shot.dng --brightness {{value}} -o shot.png --force", seeds),
        Case("convert, HDF5", f"{convert} scene.h5", distances),
        Case("convert, ENVI", f"{convert} scene.hdr", distances, overwrites=False),
        Case(
            "export, darktable",
            "export {value} darktable --maker A --model B --gain-setting 100 -o noise.json --force",
            sensors,
        ),
        Case("export, EMVA", "export {value} emva -o emva", stacks, overwrites=False, folder="emva"),
        Case("sweep", "sweep {value} -o a.csv --figure a.png --force", sweeps, checkpoint="a.csv.partial"),
        Case("dataset", f"{pairs} --seed {{value}} --pairs-per-shard 2 -o pairs", seeds, overwrites=False),
        Case("shoot", "shoot --rows 24 --cols 32 --seed {value} -o stack", seeds, overwrites=False, folder="stack"),
        Case("calibrate", f"{calibrate} --maps --report report.html", stacks, pairs=(pair,)),
        Case("calibrate, checkpoint", f"{calibrate} --checkpoint kept", stacks, checkpoint="kept"),
        Case("calibrate, several", "calibrate {value} --into results --maps", stacks, overwrites=False),
        Case("calibrate, PDF", "calibrate {value} --report report.pdf --force", stacks),
    ]
