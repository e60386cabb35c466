"""Workers of a Dask scheduler on this machine: efficiency of two, and what a task costs the scheduler."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from photosite.calibration.setting import calibrate_setting
from photosite.engine.dask_workers import WORKER_ENVIRONMENT
from photosite.engine.workers import run_tasks
from photosite.errors import InputError
from photosite.frames.open import open_frames
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.bench.frames import benchmark_protocol, write_frames
from photosite.training.dataset import PairDataset
from photosite.training.light import Electrons

_PAIRS = 64
_SIDE = 512
_ROUNDS = 4


@dataclass(frozen=True)
class Efficiency:
    """Seconds for the same tasks, once workers have done some: medians of several rounds.

    They run on one and two workers of a scheduler, and in one plain process and in two that share them, in turn in each
    round, because the speed of shared machines changes. The processes of the others are stopped meanwhile: an idle
    scheduler or worker takes some percent of a core.
    """

    tasks: int
    one_worker_s: float
    two_workers_s: float
    one_process_s: float
    two_processes_s: float
    # Medians of each round's share of the time of two that is used, against one: of workers, and of plain processes,
    # which is what the machine itself permits
    of_workers: float
    of_machine: float
    # Share of the time in which two workers were at tasks
    busy: float

    def to_dict(self) -> dict[str, float]:
        """Return the figures for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class TaskCost:
    """What a task costs that does nothing, with a number as argument and a row of a sweep as result.

    `bytes` are all that passed the network, between client, scheduler and workers.
    """

    tasks: int
    seconds: float
    scheduler_cpu_s: float
    client_cpu_s: float
    bytes: float

    def to_dict(self) -> dict[str, float]:
        """Return the figures for JSON."""
        return asdict(self)


def noise_load(_: str, index: int) -> int:
    """Draw 64 training pairs of 512 x 512 of a D200, as many as a shard has."""
    ramp = np.linspace(0, 4000, _SIDE * _SIDE, dtype=np.float32).reshape(_SIDE, _SIDE)
    pairs = PairDataset(Electrons([ramp]), load_sensor("nikon-d200"), crop=(_SIDE, _SIDE), draws=1 << 20)
    return sum(int(pairs[_PAIRS * index + k].noisy[0, 0]) for k in range(_PAIRS))


def calibration_load(folder: str, _: int) -> float | None:
    """Calibrate a camera from 64 frames of a D200, uncompressed and in the page cache."""
    return calibrate_setting(open_frames(folder)).system_gain_dn_per_e.value


LOADS: dict[str, tuple[Callable[[str, int], Any], int]] = {
    "noise": (noise_load, 64),
    "calibration": (calibration_load, 8),
}
"""Work of a task, and the number of tasks."""


def nothing(index: int) -> dict[str, float]:
    """Return a row as a sweep has it."""
    return {"signal_e": float(index), "noise_e": 1.0, "snr_db": 20.0}


@contextmanager
def _cluster(workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Start a scheduler and workers, each in a separate process; yield the scheduler's address and the programs."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scheduler.json"
        # A group for each program, with the processes that it starts, which can be stopped
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
        call = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
        started = [subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_scheduler", *call], **quiet)]
        try:
            while not file.exists():
                time.sleep(0.05)
            address = json.loads(file.read_text())["address"]
            call = ["worker", address, "--processes", str(workers)]
            started.append(subprocess.Popen([sys.executable, "-m", "photosite", *call], **quiet))
            yield address, started
        finally:
            for process in reversed(started):
                process.terminate()
            for process in started:
                process.wait()


@contextmanager
def _stopped(processes: Sequence[subprocess.Popen[bytes]]) -> Iterator[None]:
    """Stop groups of processes, and let them go on afterwards."""
    for process in processes:
        os.killpg(process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for process in processes:
            os.killpg(process.pid, signal.SIGCONT)


def efficiency(name: str, folder: str) -> Efficiency:
    """Measure a load of `LOADS`; the folder has the frames of the calibration."""
    work, count = LOADS[name]
    function = partial(_timed, work, folder)
    rounds = []
    with _cluster(1) as (one, of_one), _cluster(2) as (two, of_two), _plain_processes(name, folder) as processes:
        for number, address in enumerate((one, two), 1):
            _wait_for(address, number)
            list(run_tasks(function, range(4 * number), scheduler=address))  # imports, kernels
        for _ in range(_ROUNDS):
            with _stopped(of_two):
                begun = time.perf_counter()
                list(run_tasks(function, range(count), scheduler=one))
                by_one = time.perf_counter() - begun
            with _stopped(of_one):
                begun = time.perf_counter()
                spent = sum(seconds for _, seconds in run_tasks(function, range(count), scheduler=two))
                by_two = time.perf_counter() - begun
            with _stopped([*of_one, *of_two]):
                alone, both = _plain(processes[:1], count), _plain(processes, count)
            rounds.append((by_one, by_two, alone, both, spent / (2.0 * by_two)))
    times = np.array(rounds)
    of_workers, of_machine = (np.median(times[:, k] / (2.0 * times[:, k + 1])) for k in (0, 2))
    one_s, two_s, alone, both, busy = np.median(times, axis=0).tolist()
    return Efficiency(count, one_s, two_s, alone, both, float(of_workers), float(of_machine), busy)


def _timed(work: Callable[[str, int], Any], folder: str, index: int) -> float:
    """Return the seconds of a task."""
    begun = time.perf_counter()
    work(folder, index)
    return time.perf_counter() - begun


def _wait_for(address: str, workers: int) -> None:
    dask: Any = importlib.import_module("distributed")
    with dask.Client(address, set_as_default=False) as client:
        client.wait_for_workers(workers, timeout=60)


_PLAIN = """
import sys
from photosite.studies.bench.workers import LOADS
name, folder = sys.argv[1:]
work = LOADS[name][0]
work(folder, 0)
for line in sys.stdin:
    for index in range(int(line)):
        work(folder, index)
    print("done", flush=True)
"""


@contextmanager
def _plain_processes(name: str, folder: str) -> Iterator[list[subprocess.Popen[str]]]:
    """Start two processes without a scheduler."""
    call = [sys.executable, "-c", _PLAIN, name, folder]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen(call, env=WORKER_ENVIRONMENT | os.environ, **pipes) for _ in range(2)]
    try:
        _plain(processes, 2)
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _plain(processes: list[subprocess.Popen[str]], count: int) -> float:
    """Return the seconds of processes that work at the same time, until the last has ended its share of the tasks."""
    begun = time.perf_counter()
    for process in processes:
        assert process.stdin is not None
        process.stdin.write(f"{count // len(processes)}\n")
        process.stdin.flush()
    for process in processes:
        assert process.stdout is not None
        process.stdout.readline()
    return time.perf_counter() - begun


def task_cost(tasks: int = 5000) -> TaskCost:
    """Measure the cost of a task on two workers of this machine (Linux)."""
    with _cluster(2) as (address, started):
        scheduler = started[0].pid
        _wait_for(address, 2)
        list(run_tasks(nothing, range(100), scheduler=address))
        before = _cpu_s(scheduler), time.process_time(), _loopback_bytes()
        begun = time.perf_counter()
        list(run_tasks(nothing, range(tasks), scheduler=address))
        seconds = time.perf_counter() - begun
        after = _cpu_s(scheduler), time.process_time(), _loopback_bytes()
    spent = [(end - start) / tasks for start, end in zip(before, after, strict=True)]
    return TaskCost(tasks, seconds / tasks, *spent)


def _cpu_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _loopback_bytes() -> int:
    line = next(line for line in Path("/proc/net/dev").read_text().splitlines() if line.strip().startswith("lo:"))
    return int(line.split(":")[1].split()[0])


def measure_workers(report: Callable[[str], object]) -> tuple[dict[str, Efficiency], TaskCost]:
    """Measure the efficiency of each load, and the cost of a task; `report` is called with the name of each step."""
    if importlib.util.find_spec("distributed") is None:
        hint = "Run pip install '.[distributed]' in the clone"
        raise InputError("this measurement needs the package distributed", hint=hint)
    with tempfile.TemporaryDirectory() as folder:
        report("writing frames")
        write_frames(f"{folder}/frames", benchmark_protocol(4))
        found = {}
        for name in LOADS:
            report(f"measuring {name} on two workers")
            found[name] = efficiency(name, f"{folder}/frames")
    report("measuring the cost of a task")
    return found, task_cost()
