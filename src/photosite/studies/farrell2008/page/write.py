"""The study as files: the page, the numbers, the figures."""

from __future__ import annotations

import json
from pathlib import Path

from photosite.report.write import write_report
from photosite.studies.farrell2008.page.drawing import Drawing
from photosite.studies.farrell2008.page.page import study_page, study_parts
from photosite.studies.farrell2008.study import Reproduction

PAGE_NAME, RESULTS_NAME, FIGURES_NAME = "farrell2008.html", "results.json", "figures"


def write_study(study: Reproduction, folder: Path) -> None:
    """Write the page, results.json and the figures as SVG and PNG to a folder that exists.

    Apart from `seconds` in results.json, the same study gives the same bytes.

    Raises
    ------
    FileError
        If something cannot be written.
    ValueError
        If a number is not finite: a result holds none, so that is a bug.
    """
    parts = study_parts(study)
    figures = folder / FIGURES_NAME
    figures.mkdir()
    for part in parts.values():
        for entry in part:
            if isinstance(entry, Drawing):
                entry.save(figures)
    text = json.dumps(study.to_dict(), allow_nan=False, ensure_ascii=False, indent=1)
    (folder / RESULTS_NAME).write_text(text + "\n", encoding="utf-8", newline="\n")
    write_report(study_page(study, parts), folder / PAGE_NAME)
