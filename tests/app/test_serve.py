"""The command that serves the workbench, in a separate process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.smoke("serve")
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.skipif(
    hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN, reason="SIGHUP is ignored (nohup)"
)
def test_a_closed_terminal_ends_the_server(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "photosite", "serve"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": os.environ | {"TMPDIR": str(tmp_path)}}
    with subprocess.Popen(command, **pipes) as server:
        assert b"token=" in server.stdout.readline()
        assert b"Ctrl-C" in server.stderr.readline()
        server.send_signal(signal.SIGHUP)
        _, rest = server.communicate(timeout=60)
    assert rest == b""
    assert server.returncode in (128 + signal.SIGTERM, -signal.SIGTERM)
    assert not list(tmp_path.iterdir())
