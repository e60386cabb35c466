"""`photosite worker`: workers of a Dask scheduler on this machine."""

from __future__ import annotations

import os
import sys

import click

from photosite.cli import options
from photosite.cli.command import Command


@click.command("worker", cls=Command)
@click.argument("scheduler", metavar="ADDRESS")
@click.argument("dask_options", metavar="[-- OPTIONS]", nargs=-1)
@click.option(
    "--processes", type=options.Whole(1, 1024), metavar="N", help="Workers, one core each.  [default: all cores]"
)
def command(scheduler: str, dask_options: tuple[str, ...], processes: int | None) -> None:
    """Start workers for the tasks of a Dask scheduler, until Ctrl-C.

    ADDRESS is what `dask scheduler` prints, such as tcp://10.0.0.1:8786, and what other commands get as --dask. Start
    workers on each machine, with the same photosite. Each computes one task at a time on one core, and keeps its memory
    for the next task. One that dies is replaced, and its task done again. Dask logs to standard error. After Ctrl-C it
    takes up to ten seconds to end.

    Options of `dask worker` follow behind --: `dask worker --help` lists them. Environment variables that are set,
    those of Dask's configuration and MALLOC_ARENA_MAX among them, have priority over the settings of this command.

    Needs the extra distributed: pip install '.[distributed]' in the clone.

    Example: photosite worker tcp://10.0.0.1:8786 -- --memory-limit 4GB
    """
    if scheduler.startswith("-"):
        raise click.UsageError("ADDRESS is missing; it precedes --", click.get_current_context())
    from photosite.engine.dask_workers import WORKER_ENVIRONMENT, worker_command

    program = worker_command(scheduler, processes, dask_options)
    os.dup2(sys.stderr.fileno(), 2)  # for Dask's log; messages of C libraries were discarded
    os.execve(program[0], program, WORKER_ENVIRONMENT | os.environ)
