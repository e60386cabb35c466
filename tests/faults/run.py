"""Run the commands that write while the system fails them; print a table: `python tests/faults/run.py faults`.

Kinds: `faults` fails each operation on files (once, and from there on) and allocations, `kills` kills at each operation
and at random moments, `power` computes what disks may hold after power failures, `full-disk` ends the space after some
numbers of bytes, `races` runs two processes at once. The exit status is 1 if there are findings.
"""

from __future__ import annotations

import argparse
import errno
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # wherever it is run from
sys.path.insert(1, str(Path(__file__).parents[1] / "helpers"))
from caches import race
from cases import cases
from inputs import write_inputs
from power import failures

import faults
from faults import Case, Run, contents, fill, findings


def _chosen(count: int, most: int, rng: random.Random) -> list[int]:
    """Return numbers from 1 to `count`: all, or `most` of them with the first and the last."""
    if count <= most:
        return list(range(1, count + 1))
    return sorted({1, count, *rng.sample(range(2, count), most - 2)})


def with_faults(case: Case, folder: Path, most: int, rng: random.Random) -> tuple[int, list[str]]:
    """Fail the operations of a case: once with EIO, from there on with ENOSPC; and its large allocations."""
    tries, wrong = 0, []
    kinds = (
        (faults.FAIL_ONCE, errno.EIO, case.operations),
        (faults.FAIL_FROM, errno.ENOSPC, case.operations),
        (faults.NO_MEMORY, 0, case.allocations),
    )
    for action, number, count in kinds:
        for at in _chosen(count, most, rng):
            fill(folder, case.old)
            ended = Run(folder, case, 1, action, at, number).wait()
            tries += 1
            wrong += [f"{case.name}, action {action} at {at}: {text}" for text in findings(case, folder, ended)]
    return tries, wrong


def with_kills(case: Case, folder: Path, most: int, rng: random.Random) -> tuple[int, list[str]]:
    """Kill a case before its operations, and end it by signals at random moments."""
    tries, wrong = 0, []
    fill(folder, case.old)
    started = time.monotonic()
    Run(folder, case).wait()
    length_s = time.monotonic() - started
    for at in _chosen(case.operations, most, rng):
        fill(folder, case.old)
        ended = Run(folder, case, 1, faults.KILL, at).wait()
        tries += 1
        wrong += [f"{case.name}, killed at {at}: {text}" for text in findings(case, folder, ended, killed=True)]
    for number in range(max(2, most // 4)):
        fill(folder, case.old)
        kind = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP)[number % 3]
        running = Run(folder, case)
        time.sleep(rng.uniform(0, length_s))
        os.kill(running.process, kind)
        tries += 1
        where = f"{case.name}, {kind.name}"
        wrong += [f"{where}: {text}" for text in findings(case, folder, running.wait(), killed=True)]
    return tries, wrong


def without_power(case: Case, folder: Path, most: int, rng: random.Random) -> tuple[int, list[str]]:
    """Record the operations of a case, and check what disks may hold when the power fails."""
    fill(folder, case.old)
    log = Path(f"{folder}.log")
    Run(folder, case, log=str(log)).wait()
    return failures(case, log.read_text(), str(folder), most)


def on_full_disks(case: Case, folder: Path, most: int, rng: random.Random) -> tuple[int, list[str]]:
    """End the space after some numbers of bytes."""
    total = 2 * sum(map(len, case.new.values()))
    wrong = []
    sizes = sorted({0, 1, 100, *(rng.randrange(total) for _ in range(most))})
    for size in sizes:
        fill(folder, case.old)
        ended = Run(folder, case, 1, faults.FULL, number=size).wait()
        wrong += [f"{case.name}, full after {size} bytes: {text}" for text in findings(case, folder, ended)]
    return len(sizes), wrong


def in_races(case: Case, folder: Path, most: int, rng: random.Random) -> tuple[int, list[str]]:
    """Run a case twice at once: with different arguments over older outputs, or resuming a run that was killed."""
    tries, wrong = max(2, most // 4), []
    for number in range(tries):
        fill(folder, case.old)
        if number % 2:
            Run(folder, case, 1, faults.KILL, rng.randint(1, case.operations)).wait()
        both = [Run(folder, case)]
        time.sleep(rng.choice([0, 0.01, 0.1]))
        both.append(Run(folder, case, number % 2 if case.overwrites else 1))
        ended = [running.wait() for running in both]
        where = f"{case.name}, race {number}"
        for each in ended:
            if each.status not in (0, 2) or "Traceback" in each.err:
                wrong.append(f"{where}: exit status {each.status}: {each.err[-1500:]}")
        found = contents(folder)
        wrong += [f"{where}: {text}" for text in faults.state(case, found)]
        if number % 2 and 0 in [each.status for each in ended] and found != case.new:
            wrong.append(f"{where}: not the new outputs")
    return tries, wrong


KINDS: dict[str, Callable[[Case, Path, int, random.Random], tuple[int, list[str]]]] = {
    "faults": with_faults,
    "kills": with_kills,
    "power": without_power,
    "full-disk": on_full_disks,
    "races": in_races,
}


CACHES = "simulate, empty caches"
"""Name of the race of two processes that fill the caches, among those of the cases."""


def check(
    kinds: list[str], only: str = "", most: int = 1_000_000, seed: int = 0, inputs: Path | None = None
) -> list[str]:
    """Run kinds over the cases whose names match `only`; print a line with their tries for each case.

    Return what is wrong.
    """
    # Memory, not a disk: what is tested is the order of operations, not their speed.
    parent = "/dev/shm" if Path("/dev/shm").is_dir() else None
    place = Path(tempfile.mkdtemp(prefix="faults-", dir=parent)).resolve()
    all_wrong = []
    try:
        print(f"| command | operations | {' | '.join(kinds)} | findings | s |", flush=True)
        print("|---" * (4 + len(kinds)) + "|", flush=True)
        inputs = (inputs or place / "inputs").resolve()
        chosen = [case for case in cases(inputs) if re.search(only, case.name)]
        write_inputs(inputs, [" ".join(case.command(which)) for case in chosen for which in (0, 1)])
        for case in chosen:
            started = time.monotonic()
            folder = place / "work"
            wrong = faults.prepare(case, folder)
            tries = []
            if not wrong:
                for kind in kinds:
                    count, found = KINDS[kind](case, folder, most, random.Random(f"{seed} {case.name}"))
                    tries.append(str(count))
                    wrong += found
            figures = [str(case.operations), *(tries or [""] * len(kinds)), str(len(wrong))]
            print(f"| {case.name} | {' | '.join(figures)} | {time.monotonic() - started:.0f} |", flush=True)
            for text in wrong[:8]:
                print(f"  {text}", file=sys.stderr, flush=True)
            all_wrong += wrong
        if "races" in kinds and re.search(only, CACHES):
            started = time.monotonic()
            wrong = race(place / "caches", kernels=True)
            figures = ["", *("1" if kind == "races" else "" for kind in kinds), str(len(wrong))]
            print(f"| {CACHES} | {' | '.join(figures)} | {time.monotonic() - started:.0f} |", flush=True)
            for text in wrong:
                print(f"  {text}", file=sys.stderr, flush=True)
            all_wrong += wrong
    finally:
        shutil.rmtree(place)
    return all_wrong


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", choices=KINDS, nargs="+")
    parser.add_argument("--only", default="", help="regular expression for the names of the cases")
    parser.add_argument("--most", type=int, default=1_000_000, help="tries of each kind for a case; default: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--inputs", type=Path, help="folder that keeps the inputs; default: temporary")
    given = parser.parse_args()
    if "shim.so" not in os.environ.get("LD_PRELOAD", ""):
        with tempfile.TemporaryDirectory() as folder:
            library = faults.build_shim(Path(folder))
            child = os.spawnve(os.P_WAIT, sys.executable, [sys.executable, *sys.argv], faults.shim_environment(library))
        sys.exit(child)
    sys.exit(1 if check(given.kinds, given.only, given.most, given.seed, given.inputs) else 0)


if __name__ == "__main__":
    main()
