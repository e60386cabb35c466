"""Progress of long commands, in a log."""

from __future__ import annotations

import pytest

import photosite.cli.output as output
from photosite.cli.output import Stages


def test_a_log_gets_a_line_every_ten_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(output, "_LOG_EVERY_S", 10.0)
    now = 100.0
    monkeypatch.setattr(output.time, "monotonic", lambda: now)
    stages = Stages()
    stages.stage("reading")
    for done in range(1, 26):
        now = 100.0 + done
        stages(done, 25, "rows")
    assert capsys.readouterr().err.splitlines() == ["reading ...", "  10 of 25 rows", "  20 of 25 rows"]
