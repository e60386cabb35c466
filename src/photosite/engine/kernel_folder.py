"""The folder of compiled kernels."""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import stat
import tempfile
from functools import lru_cache
from pathlib import Path

from platformdirs import user_cache_path


@lru_cache(maxsize=1)
def kernel_folder() -> Path:
    """Return the folder of compiled kernels, a different one for each state of the engine's sources.

    numba itself compares only the file of a kernel, so that a kernel would stay in use after a function that it calls
    has changed in another file. Where the user's cache cannot be written, the folder is in one of the user's own among
    temporary files; if that is not safe, or cannot be written, one for the lifetime of the process.
    """
    sources = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        sources.update(path.read_bytes())
    name = f"kernels-{sources.hexdigest()[:16]}"
    folder = user_cache_path("photosite", appauthor=False) / name
    if _is_writable(folder):
        return folder
    own = _own_temporary_folder()
    if own is not None and _is_writable(own / name):
        return own / name
    passing = tempfile.mkdtemp(prefix="photosite-kernels-")
    atexit.register(shutil.rmtree, passing, ignore_errors=True)
    return Path(passing)


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _own_temporary_folder() -> Path | None:
    """Return a folder among temporary files that this user alone can write; None if another has its name."""
    if not hasattr(os, "getuid"):
        return None
    folder = Path(tempfile.gettempdir()) / f"photosite-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    safe = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return folder if safe else None


def is_cached(kernel: str = "*") -> bool:
    """Return whether a kernel of this state of the sources, "module.function", or any, has been compiled before."""
    return any(kernel_folder().glob(f"*/{kernel}-*.nbc"))
