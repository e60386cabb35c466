"""`photosite bench`: time and memory on this machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import show, table

if TYPE_CHECKING:
    from photosite.studies.bench.cases import Scaling
    from photosite.studies.bench.memory import MemoryUse
    from photosite.studies.bench.timing import Case


@click.command("bench", cls=Command)
@click.option("--quick", is_flag=True, help="Fewer repeats, smaller stacks, no scaling table; about a minute.")
@click.option("--case", "cases", multiple=True, metavar="NAME", help="Measure this case only; repeatable.")
@click.option(
    "--memory", is_flag=True, help="Measure the memory of commands in bytes per pixel, and nothing else; minutes, 4 GB."
)
@click.option("--workers", is_flag=True, help="Measure two workers of a Dask scheduler, and nothing else (Linux).")
@options.json_option
def command(quick: bool, cases: tuple[str, ...], memory: bool, workers: bool, as_json: bool) -> None:
    """Measure time and memory of photosite on this machine.

    Each case runs in turn with a baseline, a plain way to do the same work: SciPy transforms per wavelength, NumPy's
    random draws, NumPy's mean and variance, or plain reads of the files. The ratio is baseline time over time. The peak
    memory is that of a fresh process without the baseline.

    Example: photosite bench --quick
    """
    from photosite.studies.bench.cases import run_cases, scaling

    if workers:
        options.not_for("--workers", "quick", "cases", "memory")
        _measure_workers(as_json)
        return
    if memory:
        options.not_for("--memory", "cases")
        _measure_memory(quick, as_json)
        return
    measured, left_out = run_cases(cases, quick, lambda name: click.echo(f"measuring {name} ...", err=True))
    whole = not (quick or cases)
    if whole:
        click.echo("measuring the growth of time ...", err=True)
    laws = scaling() if whole else ()
    content = {
        "cases": {name: case.to_dict() for name, case in measured.items()},
        "left_out": left_out,
        "scaling": {law.what: law.to_dict() for law in laws},
    }
    show(as_json, content, lambda: _text(measured, left_out, laws))


def _measure_memory(quick: bool, as_json: bool) -> None:
    from photosite.studies.bench.memory import MEGAPIXELS, measure_memory

    sizes = MEGAPIXELS[:2] if quick else MEGAPIXELS
    uses = measure_memory((), sizes, lambda what: click.echo(f"measuring {what} ...", err=True))
    show(as_json, {"memory": [use.to_dict() for use in uses]}, lambda: _memory_text(uses))


def _memory_text(uses: Sequence[MemoryUse]) -> str:
    first, *others = uses[0].megapixels
    each = (f"bytes per pixel at {size:.0f} MP" for size in others)
    rows: list[tuple[str, ...]] = [("command", "sensor", f"MB at {first:.1f} MP", *each)]
    rows += [(u.command, u.sensor, f"{u.peak_mb[0]:.0f}", *(f"{b:.1f}" for b in u.bytes_per_pixel)) for u in uses]
    return table(rows, "<<" + ">" * (len(rows[0]) - 2))


def _measure_workers(as_json: bool) -> None:
    from photosite.studies.bench.workers import measure_workers

    found, cost = measure_workers(lambda what: click.echo(f"{what} ...", err=True))
    rows: list[tuple[str, ...]] = [
        ("load", "tasks", "1 worker", "2 workers", "efficiency", "of plain processes", "busy")
    ]
    for name, entry in found.items():
        seconds = (f"{entry.one_worker_s:.2f} s", f"{entry.two_workers_s:.2f} s")
        shares = (f"{share:.2f}" for share in (entry.of_workers, entry.of_machine, entry.busy))
        rows.append((name, str(entry.tasks), *seconds, *shares))
    seconds_of = {"in all": cost.seconds, "scheduler": cost.scheduler_cpu_s, "client": cost.client_cpu_s}
    spent = ", ".join(f"{what} {1e3 * seconds:.2f} ms" for what, seconds in seconds_of.items())
    line = f"a task that does nothing: {spent}; {cost.bytes:.0f} bytes on the network"
    content = {"efficiency": {name: entry.to_dict() for name, entry in found.items()}, "task": cost.to_dict()}
    show(as_json, content, lambda: f"{table(rows, '<>>>>>>')}\n\n{line}")


def _text(measured: Mapping[str, Case], left_out: Mapping[str, str], laws: Iterable[Scaling]) -> str:
    rows: list[tuple[str, ...]] = [("case", "seconds", "baseline", "ratio", "peak MB", "megapixels")]
    for name, case in measured.items():
        figures = (case.seconds, case.baseline_seconds, case.ratio, case.peak_mb, case.megapixels)
        rows.append((name, *(f"{figure:.{digits}f}" for figure, digits in zip(figures, (3, 3, 2, 0, 1), strict=True))))
    lines = [table(rows, "<>>>>>")]
    if left_out:
        lines.append("\n" + table([("left out", "reason"), *left_out.items()], "<<"))
    for law in laws:
        points = ", ".join(f"{size:g}: {seconds:.3f} s" for size, seconds in zip(law.sizes, law.seconds, strict=True))
        lines.append(f"\n{law.what} ({law.unit})\n  {points}; exponent {law.exponent:.2f}")
    return "\n".join(lines)
