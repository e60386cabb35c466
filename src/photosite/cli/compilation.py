"""Kernels that a second process compiles while a command reads frames or builds a scene.

The process calls functions for tiny arrays, so that their kernels are in the cache (`engine.kernel_cache`) when the
command needs them. The command waits for what the process is at, and compiles what it has not begun.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import numpy as np


def compile_exposure() -> None:
    """Compile what exposes a frame, on a chip without fixed pattern: the command itself compiles what draws that."""
    _expose("nikon-d200", prnu_percent=0.0, dsnu_mv=0.0, dcnu_percent=0.0)


def compile_captures() -> None:
    """Compile what exposes, reads and combines several captures."""
    _expose("dual-gain-phone", prnu_percent=0.0, dsnu_mv=0.0, dcnu_percent=0.0)


def _expose(sensor_name: str, **fields: float) -> None:
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.sensor.readout import digital_numbers

    sensor = load_sensor(sensor_name).with_(rows=16, cols=16, **fields)
    digital_numbers(sensor, np.ones((16, 16), np.float32), 1.0, seed=1)


def compile_statistics() -> None:
    """Compile the statistics of maps, which follow the sums of frames in a calibration."""
    from photosite.engine.map_statistics import label_moments
    from photosite.engine.noise_products import difference_products, frame_products
    from photosite.engine.site_planes import far_sums, mean_of_sites, plane_moments

    values, one = np.add.outer(np.arange(40.0), np.arange(64.0)), np.ones((1, 1))
    plane_moments(values, (1, 1), high_passed=True)
    frames = np.ones((2, 40, 64), np.uint16)
    difference_products(frames[0], frames[1], (1, 1), 2)
    frame_products(frames, (0, 0), (1, 1), 4, 1024)
    np.asarray(mean_of_sites(values, None, (1, 1), relative=True))
    far_sums(values, one, one)
    label_moments(values)


def start_beside(function: Callable[[], None]) -> None:
    """Call a function of this module in a process of its own, if there is a core for it.

    Nothing waits for the process, and it prints nothing: what it leaves out is compiled where it is needed.
    """
    from photosite.engine.threads import thread_count

    if thread_count() < 2:
        return
    code = f"from photosite.cli.compilation import {function.__name__}; {function.__name__}()"
    subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the command
    )
