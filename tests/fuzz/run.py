"""Fuzz readers, description files and command lines: `python tests/fuzz/run.py --inputs 100000`, or `--seconds 60`.

Each target gets its share of the inputs, of the time, or of what ends first, in a process with limited memory that its
parent watches: an input that takes longer than `HANG_S` is a hang, a process that dies is a crash, growth by
`LARGE_KIB` is a large allocation. Inputs with findings are kept in --keep, and the exit status is then 1. The same seed
gives the same inputs.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import random
import resource
import sys
import time
import traceback
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

if __name__ == "__main__":  # before numba is imported: threads do not survive the fork
    os.environ |= {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
sys.path.insert(0, str(Path(__file__).parent))  # wherever it is run from
import fuzzing

HANG_S = 10.0
"""Limit of wall time for one input, thousands of times that of a valid one."""

COMMAND_HANG_S = 120.0
"""The same for a command line, which may simulate and calibrate."""

MOST_KEPT = 20
"""Findings of a target that are printed and kept; the table counts all."""

BATCH = 500
"""Inputs per process."""

ADDRESS_SPACE = 6 << 30
"""Limit of a process's address space, in bytes; the libraries' own mappings take a third."""

LARGE_KIB = 256 << 10
"""Growth of a process over one input of some kilobytes that is a finding; command lines may work with more."""


def batch(watch: Watch, first: int, count: int, report: Connection) -> None:
    """Read inputs `first` to `first + count` of a target; report the number of each before reading it."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # messages of C libraries
    target, path = watch.target, watch.folder / f"input{watch.target.suffix}"
    path.write_bytes(target.seeds[0])
    fuzzing.outcome(target, path)  # imports
    until = time.monotonic() + watch.left_s  # without the start of the process
    for number in range(first, first + count):
        if time.monotonic() > until:
            break
        data = watch.content(number)
        path.write_bytes(data)
        fuzzing.start_child()
        report.send(("start", number))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            found = fuzzing.outcome(target, path)
        except BaseException:
            found = _end_of(traceback.format_exc())
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        if grown > LARGE_KIB and number > first and target.draw is None:
            found = f"grew by {grown >> 10} MiB over {len(data)} bytes ({found})"
        if found not in ("read", "refused"):
            watch.keep_input(number)
        report.send(("done", found))
    report.send(("end", ""))


def _end_of(trace: str) -> str:
    """Return the last frames and the message, long lines cut."""
    return "\n".join(line[:300] for line in trace.strip().splitlines()[-9:])


def _heard(connection: Connection, seconds: float) -> bool:
    """Wait for a message, in steps of a second: time in which this process itself was stopped does not count."""
    return any(connection.poll(1.0) for _ in range(math.ceil(seconds)))


class Watch:
    """One target's inputs, batch after batch."""

    def __init__(self, name: str, target: fuzzing.Target, folder: Path, seed: int, keep: Path) -> None:
        self.name, self.target, self.folder, self.seed, self.keep = name, target, folder, seed, keep
        self.hang_s = HANG_S if target.draw is None else COMMAND_HANG_S
        self.left_s = math.inf
        self.found: Counter[str] = Counter()
        self.findings: list[str] = []

    def content(self, number: int) -> bytes:
        """Return an input."""
        return self.target.hostile(random.Random(f"{self.seed} {self.name} {number}"))

    def keep_input(self, number: int) -> None:
        """Write an input with a finding to the folder of findings, up to `MOST_KEPT` of a target."""
        if len(list(self.keep.glob(f"{self.name}-*"))) >= MOST_KEPT:
            return
        (self.keep / f"{self.name}-{number}{self.target.suffix}").write_bytes(self.content(number))

    def run(self, inputs: int | None, seconds: float | None) -> None:
        """Run so many inputs, or for so long; continue after a hang or crash."""
        at = 0
        self.left_s = math.inf if seconds is None else seconds
        while (inputs is None or at < inputs) and self.left_s > 0:
            at = self._batch(at, BATCH if inputs is None else min(BATCH, inputs - at))

    def _batch(self, first: int, count: int) -> int:
        ours, theirs = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context("fork").Process(target=batch, args=(self, first, count, theirs))
        process.start()
        theirs.close()
        number, begun = first - 1, math.inf
        try:
            while True:
                # Before the first input, the process imports and makes seeds.
                if not _heard(ours, self.hang_s if number >= first else 20 * HANG_S):
                    process.kill()
                    return self._lost(number, f"hang: more than {self.hang_s:g} s")
                what, value = ours.recv()
                if what == "start":
                    number, begun = value, min(begun, time.monotonic())
                elif what == "done":
                    self._count(number, value)
                else:
                    if number < first + count - 1:  # the time was over
                        begun = -math.inf
                    return first + count
        except EOFError:
            process.join()
            return self._lost(number, f"crash: exit status {process.exitcode}")
        finally:
            self.left_s -= max(time.monotonic() - begun, 0.0)
            process.join(5)
            ours.close()

    def _lost(self, number: int, why: str) -> int:
        """Keep the input that ended a process, and return the number of the next."""
        self.keep_input(number)
        self._count(number, why)
        return number + 1

    def _count(self, number: int, found: str) -> None:
        if found in ("read", "refused"):
            self.found[found] += 1
            return
        self.found["finding"] += 1
        self.findings.append(f"{self.name} {number}: {found}")
        if len(self.findings) <= MOST_KEPT:
            print(self.findings[-1], file=sys.stderr, flush=True)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, help="inputs in all; without --seconds, 100000")
    parser.add_argument("--seconds", type=float, help="time for all targets, besides their start")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="one target")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings"), help="folder for inputs with findings")
    chosen = parser.parse_args()
    inputs = 100_000 if chosen.inputs is None and chosen.seconds is None else chosen.inputs
    chosen.keep.mkdir(parents=True, exist_ok=True)
    keep, begun, total, findings = chosen.keep.absolute(), time.monotonic(), 0, []
    print(f"{'target':13} {'inputs':>8} {'read':>8} {'refused':>8} {'findings':>8} {'s':>7}")
    with TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as place:
        folder = Path(place, "files")
        folder.mkdir()
        targets = {name: t for name, t in fuzzing.targets(folder).items() if chosen.only in (None, name)}
        for name, target in targets.items():
            since = time.monotonic()
            watch = Watch(name, target, folder, chosen.seed, keep)
            share = None if chosen.seconds is None else chosen.seconds / len(targets)
            watch.run(None if inputs is None else -(-inputs // len(targets)), share)
            seen = watch.found
            total += seen.total()
            findings += watch.findings
            taken = time.monotonic() - since
            print(
                f"{name:13} {seen.total():8} {seen['read']:8} {seen['refused']:8} {seen['finding']:8} {taken:7.0f}",
                flush=True,
            )
    print(f"{total} inputs in {time.monotonic() - begun:.0f} s, {len(findings)} findings")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
