"""Folders for what is laid out anew on disk, gone when they are closed or nothing holds them any more."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from pathlib import Path


class TemporaryFolder:
    """A new folder in the place for temporary files (`TMPDIR`).

    Parameters
    ----------
    prefix
        Of its name.

    Attributes
    ----------
    path
        Where it is.

    Examples
    --------
    >>> folder = TemporaryFolder("photosite-")
    >>> folder.path.is_dir(), folder.close(), folder.path.exists()
    (True, None, False)
    """

    def __init__(self, prefix: str) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=prefix))
        self._end = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)

    def close(self) -> None:
        """Remove it with what is in it; a second time does nothing."""
        self._end()
