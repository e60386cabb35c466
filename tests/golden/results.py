"""Results of calibrations that must not change: `python tests/golden/results.py write [--keep FOLDER]`.

Each case is calibrated, and the SHA-256 of everything that it gives is kept in digests.json: `to_dict`, sensor file,
warnings, tables of the report, or the error. `compare` lists what differs; `--keep` also writes the results themselves.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # sums depend on the number of threads

import numpy as np

import photosite as ps
from photosite.calibration.setting import calibrate_setting
from photosite.errors import PhotositeError
from photosite.report import style
from photosite.report.page import Details, Heading, Images, Listing, Notice, Page, Paragraph, Subheading, Table
from photosite.report.pages import page
from photosite.sensor.io.sensor_file import dump_sensor
from photosite.studies.conditions import CONDITIONS
from photosite.studies.imperfect_stacks import KINDS
from photosite.studies.protocol import ShootingProtocol, Step, paper_d200_protocol, series
from photosite.studies.virtual_lab import virtual_lab, with_pedestal

DIGESTS = Path(__file__).with_name("digests.json")
SENSORS, SEEDS = 2, 2
"""Virtual sensors of each condition of the coverage study; seeds of each kind of imperfect stack."""

PROTOCOL = ShootingProtocol(
    "golden",
    (
        Step("dark", 1e-3, 16),
        *series("dark", 0.1, 8.0, exposures=4, count=4),
        *(Step("light", 0.005 * n, 4) for n in range(1, 13)),
    ),
)
EFFECTS: dict[str, dict[str, Any]] = {
    "response_curve": {"response_curve": {"polynomial_percent": [0.0, -2.0]}},
    "readout_channels": {"readout_channels": {"relative_gain": [[1.02, 0.98]], "offset_e": [[3.0, -3.0]]}},
    "line_pattern": {"line_pattern": {"row_offset_e": 4.0, "column_offset_e": 6.0, "column_gain_percent": 0.6}},
    "blooming": {"blooming": {"drained": 0.5}, "hot_pixels": {"fraction": 0.004, "median_e_per_s": 5000}},
    "charge_transfer": {"charge_transfer": {"parallel_inefficiency": 1e-4}, "optical_black": {"bottom": 6}},
    "em_gain": {"em_gain": {"gain": 8, "stages": 536}},
    "interpixel_capacitance": {"interpixel_capacitance": {"coupling_percent": 1.2}},
    "converter_error": {"converter_error": {"error_lsb": [0, 1.5, -0.5, 0.8, 0]}},
    "output": {"output": {"dropped_bits": 1}},
    "hot_pixels": {"hot_pixels": {"fraction": 0.005, "median_e_per_s": 300}},
    "pixel_defects": {"pixel_defects": {"dead_fraction": 2e-3, "clusters": 2, "cluster_pixels": 5}},
    "telegraph_noise": {"telegraph_noise": {"fraction": 0.03, "amplitude_e": 60}},
    "read_noise_spread": {"read_noise_spread": {"log_spread": 0.3}},
    "glow": {"glow": {"places": ["left"], "peak_e_per_s": 300, "decay_pixels": 20}},
    "black_level_drift": {"black_level_drift": {"standard_deviation_e": 6}},
    "optical_black": {"optical_black": {"top": 4, "left": 8}},
}
D200 = ps.load_sensor("nikon-d200")
MONO = {
    "cfa": "mono",
    "channels": {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}},
    "rows": 96,
    "cols": 128,
    "black_level_dn": 100,
    "well_capacity_e": 20_000,
    "row_noise_e": 2,
    "dark_current_e_per_s": 20,
    "dcnu_percent": 20,
}


def _effect(name: str) -> dict[str, Any]:
    sensor = D200.with_(**MONO, serial=name, **EFFECTS[name])
    lab = virtual_lab(sensor, PROTOCOL, seed=5, photons_known=True)
    return _results(calibrate_setting(lab.frame_set(), maps=True))


def _results(calibration: Any) -> dict[str, Any]:
    found = {"dict": calibration.to_dict(), "warnings": list(calibration.warnings)}
    if hasattr(calibration, "base") and calibration.base is not None:
        sensor = calibration.sensor
        found["sensor"] = dump_sensor(sensor.with_(created="2026-01-01"))
    if hasattr(calibration, "curves"):
        found["report"] = _texts(page(calibration))
    return found


def _texts(page: Page) -> list[Any]:
    def of(block: Any) -> Iterator[Any]:
        if isinstance(block, Table):
            yield [block.caption, *(row.text if isinstance(row, Heading) else list(row) for row in block.rows)]
        elif isinstance(block, Paragraph | Notice | Subheading):
            yield block.text
        elif isinstance(block, Listing):
            yield list(block.lines)
        elif isinstance(block, Details):
            for inner in block.blocks:
                yield from of(inner)
        elif isinstance(block, Images):
            yield block.caption

    return [[section.title, *(entry for block in section.blocks for entry in of(block))] for section in page.sections]


def _condition(name: str, number: int) -> dict[str, Any]:
    condition = CONDITIONS[name]
    lab = condition.lab(number)
    if condition.captures:
        return _captures(lab)
    return _results(calibrate_setting(lab.frame_set(), maps=condition.maps))


def _captures(lab: Any) -> dict[str, Any]:
    from photosite.calibration.captures.combined import calibrate_combined
    from photosite.calibration.captures.each_capture import calibrate_captures
    from photosite.frames.frame_set import FrameSet

    sensor = lab.camera.sensor
    taken: dict[str, list[Any]] = {}
    output = []
    for _, step, raw in lab.frames():
        output.append((step.kind, step.exposure_s, raw.dn))
        for name, dn in raw.captures.items():
            taken.setdefault(name, []).append((step.kind, step.exposure_s, dn))
    sets = {name: FrameSet.from_arrays(each, bits=sensor.readout.bits) for name, each in taken.items()}
    found = calibrate_captures(sets)
    together = calibrate_combined(FrameSet.from_arrays(output, bits=sensor.output_bits))
    each = {name: _results(one) for name, one in found.captures.items()}
    return {"captures": found.to_dict(), "combined": together.to_dict(), "each": each}


def _stack(kind: str, seed: int) -> dict[str, Any]:
    (found,) = (entry for entry in KINDS if entry.name == kind)
    return _results(calibrate_setting(found.frames(seed)))


def _demo() -> dict[str, Any]:
    sensor = with_pedestal(D200.with_(rows=216, cols=322))
    return _results(
        calibrate_setting(virtual_lab(sensor, paper_d200_protocol(), seed=2008, photons_known=True).frame_set())
    )


def _gain_series() -> dict[str, Any]:
    from photosite.calibration.gain_series.calibrate_series import calibrate_series
    from photosite.frames.frame_set import FrameSet

    sets = [
        virtual_lab(
            D200.with_(**(MONO | {"rows": 48, "cols": 64}), analog_gain=1.0 * gain).with_(gain_setting=100.0 * gain),
            PROTOCOL, seed=int(gain), photons_known=True,
        ).frame_set()
        for gain in (1, 2, 4, 8)
    ]  # fmt: skip
    groups = tuple(group for each in sets for group in each.groups)
    first = sets[0]
    frames = FrameSet(groups, first.rows, first.cols, first.bits, first.cfa, "gain series", sensor=first.sensor)
    found = calibrate_series(frames)
    return {"dict": found.to_dict(), "warnings": list(found.warnings)}


def _emva(pairs: bool) -> dict[str, Any]:
    named = os.environ.get("PHOTOSITE_REFERENCE")
    folder = Path(named) if named else Path(__file__).parents[3] / "shared" / "reference"
    path = folder / "emva1288_ccd12" / "EMVA1288_Data.txt"
    if not path.is_file():
        return {}
    frames = ps.open_frames(path)
    if pairs:
        frames = replace(frames, groups=tuple(group for group in frames.groups if len(group) == 2))
    return _results(calibrate_setting(replace(frames, source="EMVA1288_Data.txt"), maps=pairs))


CASES: dict[str, Callable[[], dict[str, Any]]] = {
    **{f"condition {name} {k}": partial(_condition, name, k) for name in CONDITIONS for k in range(SENSORS)},
    **{f"stack {kind.name} {seed}": partial(_stack, kind.name, seed) for kind in KINDS for seed in range(SEEDS)},
    **{f"effect {name}": partial(_effect, name) for name in EFFECTS},
    "demo": _demo,
    "gain series": _gain_series,
    "emva": partial(_emva, False),
    "emva pairs": partial(_emva, True),
}


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple | set | frozenset):
        return list(value)
    return str(value)


def results(name: str) -> dict[str, str]:
    """Return the results of a case as JSON texts by part."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = CASES[name]()
        except PhotositeError as error:
            found = {"error": str(error)}
    return {part: json.dumps(_old(value), default=_plain, sort_keys=True, indent=1) for part, value in found.items()}


def _old(value: Any) -> Any:
    """Return a result without the diagnostics, which are newer than the digests; numbers with twelve digits."""
    if isinstance(value, dict):
        return {name: _old(entry) for name, entry in value.items() if name != "diagnostics"}
    if isinstance(value, float):
        return float(f"{value:.12g}")  # the last digits depend on where BLAS finds the numbers in memory
    return [_old(entry) for entry in value] if isinstance(value, list | tuple) else value


def digests(texts: dict[str, str]) -> dict[str, str]:
    """Return the SHA-256 of each part."""
    return {part: hashlib.sha256(text.encode()).hexdigest()[:16] for part, text in texts.items()}


def _without_rendering() -> None:
    """Make figures without rendering them, which takes most of the time."""
    style.svg_bytes = lambda figure, below=None: b""


def main() -> int:
    """Write or compare the digests."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", choices=["write", "compare"])
    parser.add_argument("--keep", type=Path, help="folder for the results themselves")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=(), help="parts of the names of cases; default all")
    arguments = parser.parse_args()
    names = [name for name in CASES if not arguments.only or any(part in name for part in arguments.only)]
    with ProcessPoolExecutor(arguments.processes, initializer=_without_rendering) as pool:
        found = dict(zip(names, pool.map(results, names), strict=True))
    if arguments.keep:
        arguments.keep.mkdir(parents=True, exist_ok=True)
        for name, texts in found.items():
            for part, text in texts.items():
                (arguments.keep / f"{name.replace('/', '_')}.{part}.json").write_text(text)
    new = {name: digests(texts) for name, texts in found.items()}
    if arguments.action == "write":
        DIGESTS.write_text(json.dumps(new, indent=0, sort_keys=True) + "\n")
        return 0
    old = json.loads(DIGESTS.read_text())
    different = [f"{name}: {part}" for name in names for part in sorted(old[name] | new[name])
                 if new[name].get(part) != old[name].get(part)]  # fmt: skip
    print("\n".join(different) or f"{len(names)} cases: no difference")
    return len(different) > 0


if __name__ == "__main__":
    sys.exit(main())
