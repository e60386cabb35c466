"""`photosite explain`: the entry of a diagnostic in the registry."""

from __future__ import annotations

from typing import Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import show, table


@click.command("explain", cls=Command)
@click.argument("name", metavar="[ID]", required=False)
@options.json_option
def command(name: str | None, as_json: bool) -> None:
    """Explain a diagnostic of a calibration or of image quality, by its id.

    What the data show, what it does to which figures, and what to do. The ids are those of the warnings of `photosite
    calibrate` and `photosite measure`, in their reports and in --json. Without an id, all of them are listed.

    Example: photosite explain unsteady-light
    """
    from photosite.calibration.diagnostics import detection_entry, diagnostic_kind, diagnostic_kinds

    if name is None:
        kinds = diagnostic_kinds()
        content = {each.id: {"severity": each.severity, **each.entry} for each in kinds.values()}
        rows = [("id", "severity", "seen"), *((each.id, each.severity, each.seen) for each in kinds.values())]
        show(as_json, content, lambda: table(rows, "<<<"))
        return
    kind = diagnostic_kind(name)
    from photosite.calibration.parameters import PARAMETER_LABELS

    figures = kind.concerns(PARAMETER_LABELS) or kind.parameters
    known = kind.entry | detection_entry(kind)
    entry: dict[str, Any] = {"id": kind.id, "severity": kind.severity, **known, "Figures": list(figures)}

    def text() -> str:
        every = len(figures) == len(PARAMETER_LABELS)
        named = {"Figures": "all" if every else ", ".join(figures)} if figures else {}
        return "\n".join([f"{kind.id} ({kind.severity})", table(list((known | named).items()), "<<")])

    show(as_json, entry, text)
