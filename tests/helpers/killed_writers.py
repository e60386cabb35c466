"""What killed processes leave behind."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from photosite.files.writing import atomic_folder, atomic_path, is_temporary


def temporaries(folder: Path) -> list[Path]:
    """Return the temporary files and folders in a folder."""
    return sorted(path for path in folder.iterdir() if is_temporary(path.name))


def kill_while_writing(path: Path, *, folder: bool = False) -> Path:
    """Kill a forked process while it writes a file, or a folder, and return what it leaves."""
    before = set(temporaries(path.parent))
    if (child := os.fork()) == 0:
        try:
            with (atomic_folder if folder else atomic_path)(path) as temporary:
                (temporary / "a" if folder else temporary).write_bytes(b"half")
                os.kill(os.getpid(), signal.SIGKILL)
        finally:
            os._exit(1)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL
    (left,) = set(temporaries(path.parent)) - before
    return left
