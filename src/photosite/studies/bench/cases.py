"""Benchmark cases by name, and the growth of time with the size of the work."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np

from photosite.engine.threads import ITEMS_PER_THREAD, threads_for
from photosite.errors import InputError, PhotositeError, did_you_mean
from photosite.studies.bench.captures import (
    EXPOSURE_S,
    camera,
    capture_d200,
    cli_simulate,
    field_varying_d200,
    lateral_color_d200,
    lens_d200,
    noise_d200,
    optics_d200,
    plane_d200,
    scene,
)
from photosite.studies.bench.convert_cube import convert_cube
from photosite.studies.bench.effects import captures_d200, effects_curve_d200, effects_em_d200, moving_d200
from photosite.studies.bench.frames import (
    accumulate_against_reading,
    accumulate_d200,
    calibrate_protocol,
    calibrate_protocol_405,
)
from photosite.studies.bench.gpu import gpu_capture, gpu_noise, gpu_transfers
from photosite.studies.bench.lenses import FIRST_KINDS, fine_color, first_frame, first_frame_cached
from photosite.studies.bench.pairs import pairs_lens, pairs_noise
from photosite.studies.bench.timing import Case, best_seconds

CASES: dict[str, Callable[[bool], Case]] = {
    "capture_d200": capture_d200,
    "optics_d200": optics_d200,
    "plane_d200": plane_d200,
    "field_varying_d200": field_varying_d200,
    "lens_d200": lens_d200,
    "lateral_color_d200": lateral_color_d200,
    **{f"fine_color_{spectra}": partial(fine_color, spectra) for spectra in (1, 3, 8)},
    **{f"first_frame_{kind}": partial(first_frame, kind) for kind in FIRST_KINDS},
    **{f"first_frame_{kind}_cached": partial(first_frame_cached, kind) for kind in FIRST_KINDS},
    "noise_d200": noise_d200,
    "effects_em_d200": effects_em_d200,
    "effects_curve_d200": effects_curve_d200,
    "captures_d200": captures_d200,
    "moving_d200": moving_d200,
    "accumulate_d200": accumulate_d200,
    "accumulate_against_reading": accumulate_against_reading,
    "calibrate_protocol": calibrate_protocol,
    "calibrate_protocol_405": calibrate_protocol_405,
    "gpu_noise": gpu_noise,
    "gpu_capture": gpu_capture,
    "gpu_transfers": gpu_transfers,
    "pairs_noise": pairs_noise,
    "pairs_lens": pairs_lens,
    "convert_cube": convert_cube,
    "cli_simulate": cli_simulate,
}

BY_NAME = ("calibrate_protocol_405",)
"""Cases that are measured only where they are named, because they write gigabytes."""

Size = TypeVar("Size", int, float)


def run_cases(
    names: Sequence[str], quick: bool, report: Callable[[str], object]
) -> tuple[dict[str, Case], dict[str, str]]:
    """Measure cases; a case that cannot run here, for example without an extra, does not stop the others.

    Parameters
    ----------
    names
        Names in `CASES`; all but those of `BY_NAME` by default.
    quick
        Fewer repeats and smaller stacks.
    report
        Called with each name before it is measured.

    Returns
    -------
    dict of str to Case, dict of str to str
        The measured cases, and the reasons why others could not run.

    Raises
    ------
    InputError
        If a case is unknown.
    """
    for name in names:
        if name not in CASES:
            raise InputError("case", value=name, expected="a known name", hint=did_you_mean(name, CASES))
    measured, left_out = {}, {}
    for name in names or [name for name in CASES if name not in BY_NAME]:
        report(name)
        try:
            measured[name] = CASES[name](quick)
        except (PhotositeError, ImportError, OSError) as error:
            left_out[name] = str(error)
    return measured, left_out


# Growth of time with pixels, wavelengths, frames and threads.


@dataclass(frozen=True)
class Scaling:
    """Seconds at several sizes of one quantity.

    Parameters
    ----------
    what, unit
        Title, and unit of the sizes.
    sizes, seconds
        Measured points.
    """

    what: str
    unit: str
    sizes: tuple[float, ...]
    seconds: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Exponent of seconds = c sizes^exponent by least squares on logarithms: 1 is proportional, 0 independent."""
        return float(np.polyfit(np.log(self.sizes), np.log(self.seconds), 1)[0])

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {"unit": self.unit, "sizes": self.sizes, "seconds": self.seconds, "exponent": self.exponent}


def scaling() -> tuple[Scaling, ...]:
    """Measure captures of a ColorChecker by pixels, wavelengths, frames of a stream, and threads."""
    shapes = {rows * cols / 1e6: (rows, cols) for rows, cols in ((648, 968), (1296, 1936), (2592, 3872), (5184, 7744))}
    return (
        _measured(
            "capture, by pixels", "megapixels", shapes, lambda size: camera(*shapes[size]).capture(scene(), EXPOSURE_S)
        ),
        _measured(
            "mean electrons of a D200, by wavelengths",
            "wavelengths",
            (31, 61, 151, 301),
            lambda count: camera().mean_electrons(scene(count), EXPOSURE_S),
        ),
        _measured("stream of a D200, by frames", "frames", (1, 4, 16), _stream),
        _measured("capture of a D200, by threads", "threads", (1, 2), _capture_with_threads),
    )


def _measured(what: str, unit: str, sizes: Iterable[Size], work: Callable[[Size], object]) -> Scaling:
    sizes = tuple(sizes)
    for size in sizes:
        work(size)
    return Scaling(what, unit, sizes, tuple(best_seconds(partial(work, size)) for size in sizes))


def _stream(count: int) -> None:
    for _ in camera().stream(scene(), EXPOSURE_S, frames=count):
        pass


def _capture_with_threads(count: int) -> None:
    with threads_for(count * ITEMS_PER_THREAD):
        camera().capture(scene(), EXPOSURE_S)
