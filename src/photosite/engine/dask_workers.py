"""Workers of a Dask scheduler on this machine, set up for the tasks of `photosite.engine.workers`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from photosite.engine.threads import cores
from photosite.engine.workers import THREAD_VARIABLES, check_scheduler

_KEPT_BYTES = "2000000000"

WORKER_ENVIRONMENT = {
    # A process for each core.
    **dict.fromkeys(THREAD_VARIABLES, "1"),
    # Keep freed memory for the next task: the system clears what it gives out, and Dask's default returns memory at
    # once. A task runs in a thread beside the main one, where the C library keeps no arrays above 64 MB unless all
    # threads share one arena.
    "MALLOC_TRIM_THRESHOLD_": _KEPT_BYTES,
    "MALLOC_MMAP_THRESHOLD_": _KEPT_BYTES,
    "MALLOC_ARENA_MAX": "1",
    # What Dask does beside the tasks, 2 to 100 times a second by default, takes 4 % of a core for each worker.
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "5s",
    "DASK_DISTRIBUTED__WORKER__MEMORY__MONITOR_INTERVAL": "1s",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
}
"""Variables of a worker process; those that are set have priority."""


def worker_command(scheduler: str, processes: int | None = None, options: Sequence[str] = ()) -> list[str]:
    """Return the command that starts workers of one thread each, and others in place of those that die.

    Parameters
    ----------
    scheduler
        Address of the scheduler, such as "tcp://10.0.0.1:8786".
    processes
        Number of workers; None: one for each core.
    options
        Further options of `dask worker`.

    Raises
    ------
    InputError
        If there is no scheduler at the address, or the package distributed is not installed.
    """
    check_scheduler(scheduler)
    count = str(cores() if processes is None else processes)
    program = [sys.executable, "-m", "distributed.cli.dask_worker", scheduler]
    return [*program, "--nworkers", count, "--nthreads", "1", "--no-dashboard", *options]
