"""Fuzz the readers: `python tests/fuzz/run.py --inputs 100000`.

Each reader gets its share of damaged files in a process with limited memory, watched by its parent: an input that takes
longer than `HANG_S` is a hang, a process that dies is a crash, growth by `LARGE_KIB` is a large allocation. Inputs with
findings are kept in --keep, and the exit status is then 1. The same seed gives the same inputs.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import resource
import sys
import time
import traceback
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parent))  # wherever it is run from
import fuzzing

HANG_S = 10.0
"""Limit of wall time for one input, thousands of times that of a valid one."""

BATCH = 500
"""Inputs per process."""

ADDRESS_SPACE = 6 << 30
"""Limit of a process's address space, in bytes; the libraries' own mappings take a third."""

LARGE_KIB = 256 << 10
"""Growth of a process over one input of some kilobytes that is a finding."""


def batch(name: str, seed: int, first: int, count: int, keep: Path, report: Connection) -> None:
    """Read damaged files `first` to `first + count` of a target; report the number of each before reading it."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    with TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as place:
        folder = Path(place)
        target = fuzzing.targets(folder)[name]
        path = folder / f"input{target.suffix}"
        path.write_bytes(target.seeds[0])
        fuzzing.outcome(target, path)  # imports
        for number in range(first, first + count):
            data = content(target, name, seed, number)
            path.write_bytes(data)
            fuzzing.start_child()
            report.send(("start", number))
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            try:
                found = fuzzing.outcome(target, path)
            except BaseException:
                found = _end_of(traceback.format_exc())
            grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
            if grown > LARGE_KIB and number > first:
                found = f"grew by {grown >> 10} MiB over {len(data)} bytes ({found})"
            if found not in ("read", "refused"):
                (keep / f"{name}-{number}{target.suffix}").write_bytes(data)
            report.send(("done", found))
    report.send(("end", ""))


def _end_of(trace: str) -> str:
    """Return the last frames and the message, long lines cut."""
    return "\n".join(line[:300] for line in trace.strip().splitlines()[-9:])


def content(target: fuzzing.Target, name: str, seed: int, number: int) -> bytes:
    """Return damaged file `number` of a target."""
    rng = random.Random(f"{seed} {name} {number}")
    return fuzzing.damaged(rng.choice(target.seeds), rng, text=target.text)


class Watch:
    """One target's inputs, batch after batch."""

    def __init__(self, name: str, seed: int, inputs: int, keep: Path) -> None:
        self.name, self.seed, self.inputs, self.keep = name, seed, inputs, keep
        self.found: Counter[str] = Counter()
        self.findings: list[str] = []

    def run(self) -> None:
        """Run all inputs; continue after a hang or crash."""
        at = 0
        while at < self.inputs:
            at = self._batch(at, min(BATCH, self.inputs - at))

    def _batch(self, first: int, count: int) -> int:
        ours, theirs = multiprocessing.Pipe(duplex=False)
        arguments = (self.name, self.seed, first, count, self.keep, theirs)
        process = multiprocessing.get_context("fork").Process(target=batch, args=arguments)
        process.start()
        theirs.close()
        number = first - 1
        try:
            while True:
                # Before the first input, the process imports and makes seeds.
                if not ours.poll(HANG_S if number >= first else 20 * HANG_S):
                    process.kill()
                    return self._lost(number, f"hang: more than {HANG_S:g} s")
                what, value = ours.recv()
                if what == "start":
                    number = value
                elif what == "done":
                    self._count(number, value)
                else:
                    return first + count
        except EOFError:
            process.join()
            return self._lost(number, f"crash: exit status {process.exitcode}")
        finally:
            process.join(5)
            ours.close()

    def _lost(self, number: int, why: str) -> int:
        """Keep the input that ended a process, and return the number of the next."""
        with TemporaryDirectory() as place:
            target = fuzzing.targets(Path(place))[self.name]
            file = self.keep / f"{self.name}-{number}{target.suffix}"
            file.write_bytes(content(target, self.name, self.seed, number))
        self._count(number, why)
        return number + 1

    def _count(self, number: int, found: str) -> None:
        if found in ("read", "refused"):
            self.found[found] += 1
            return
        self.found["finding"] += 1
        self.findings.append(f"{self.name} {number}: {found}")
        print(self.findings[-1], file=sys.stderr, flush=True)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000, help="damaged files in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="one target")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings"), help="folder for inputs with findings")
    chosen = parser.parse_args()
    with TemporaryDirectory() as place:
        names = [name for name in fuzzing.targets(Path(place)) if chosen.only in (None, name)]
    chosen.keep.mkdir(parents=True, exist_ok=True)
    begun, total, findings = time.monotonic(), 0, []
    print(f"{'reader':12} {'inputs':>8} {'read':>8} {'refused':>8} {'findings':>8} {'s':>7}")
    for name in names:
        since = time.monotonic()
        watch = Watch(name, chosen.seed, -(-chosen.inputs // len(names)), chosen.keep)
        watch.run()
        seen = watch.found
        total += seen.total()
        findings += watch.findings
        taken = time.monotonic() - since
        print(
            f"{name:12} {seen.total():8} {seen['read']:8} {seen['refused']:8} {seen['finding']:8} {taken:7.0f}",
            flush=True,
        )
    print(f"{total} inputs in {time.monotonic() - begun:.0f} s, {len(findings)} findings")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
