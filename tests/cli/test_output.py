"""Progress of long commands, in a log."""

from __future__ import annotations

import io
import time
import warnings

import pytest

import photosite.cli.output as output
from photosite.cli.output import Stages, diagnostics_text, held_warnings, not_listed, table, working
from photosite.errors import PhotositeWarning
from photosite.values.diagnostic import Diagnostic


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


def test_tables_fit_the_terminal() -> None:
    rows = [("name", "value", "method"), ("read noise", "3.14", "the paper's, from dark frames at one exposure time")]
    whole = table(rows, "<><")
    assert whole.splitlines()[1].endswith("exposure time")
    narrow = table(rows, "<><", width=40)
    assert max(map(len, narrow.splitlines())) <= 40
    assert narrow.split() == whole.split()
    assert "3.14" in narrow


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_long_commands_show_that_they_work_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "_WORKING_AFTER_S", 0.02)
    for stream, shown in ((_Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr(output.sys, "stderr", stream)
        with working("photosite develop"):
            time.sleep(0.1)
        assert ("photosite develop: working" in stream.getvalue()) == shown
        assert stream.getvalue() == "" or stream.getvalue().endswith("\r\033[K")


def test_held_warnings_appear_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        monkeypatch.setattr(output.warnings, "showwarning", lambda message, *rest: seen.append(str(message)))
        with held_warnings() as held:
            for text in ("listed", "shown by itself"):
                warnings.warn(PhotositeWarning(text), stacklevel=1)
            assert seen == []
            not_listed(held, ["listed"])
    assert seen == ["shown by itself"]


def test_diagnostics_appear_once() -> None:
    """Equal texts are one line; of the texts of a kind, three."""
    odd = [Diagnostic("odd", "warning", f"warning {number % 5}") for number in range(10)]
    withheld = Diagnostic("unknown", "withheld", "no light", ("prnu_percent", "dsnu_e"))
    (text,) = diagnostics_text([*odd, withheld], every=False)
    assert [line.split()[:2] for line in text.splitlines()[1:]] == [["warning", "odd"]] * 4 + [["withheld", "unknown"]]
    (text,) = diagnostics_text([*odd, withheld])
    assert len(text.splitlines()) == 1 + 5 + 1
    assert "prnu_percent, dsnu_e" in text
    assert diagnostics_text([]) == []
