"""Limits of image quality: a file of conditions, and the verdict on each.

photosite_limits: 1
name: Machine vision, line 3
guard: interval                       # or value: intervals are ignored
limits:
  - edge-sfr.mtf50.G >= 0.3           # MEASUREMENT.QUANTITY.PART
  - noise.dynamic_range_db >= 60      # every part
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from photosite.errors import InputError
from photosite.files.yaml import check_version, line_of, read_yaml, validated
from photosite.metrics.camera_quality import CameraQuality
from photosite.metrics.measure import ImageQuality
from photosite.metrics.measurement import Result
from photosite.metrics.registry import ValueName
from photosite.values.estimate import Estimate
from photosite.values.shown import Reported, ResultTable, Shown, Tabular
from photosite.values.validated import Section

VERSION_KEY = "photosite_limits"
_LIMIT = re.compile(r"(.+?)\s*(>=|<=)\s*([-+.\deE]+)\s*$")

Guard = Literal["interval", "value"]
Verdict = Literal["pass", "fail", "undecided", "missing"]


@dataclass(frozen=True)
class Limit(Shown):
    """A condition on a value, such as `edge-sfr.mtf50.G >= 0.3`.

    Parameters
    ----------
    name
        Which value.
    sign, bound
        ">=" or "<=", and the number.
    """

    name: ValueName
    sign: Literal[">=", "<="]
    bound: float

    @classmethod
    def parse(cls, text: str) -> Limit:
        """Parse a condition.

        Raises
        ------
        InputError
            If it is not of the form, or the measurement or its quantity is unknown.

        Examples
        --------
        >>> Limit.parse("edge-sfr.mtf50.G >= 0.3").bound
        0.3
        """
        match = _LIMIT.match(text)
        if match is None:
            raise InputError("limit", value=text, expected="such as edge-sfr.mtf50.G >= 0.3")
        name, sign, bound = match.groups()
        try:
            number = float(bound)
        except ValueError:
            raise InputError("limit", value=text, expected="a number after the sign") from None
        return cls(ValueName.parse(name), sign, number)  # type: ignore[arg-type]  # the sign is one of the two

    @property
    def text(self) -> str:
        """The condition as it is written."""
        return f"{self.name} {self.sign} {self.bound:g}"

    def verdict(self, estimate: Estimate, guard: Guard) -> Verdict:
        """Return whether a value passes; undecided where its interval holds the bound, or is not known."""
        if estimate.value is None:
            return "missing"
        low, high = estimate.interval_95 or (estimate.value, estimate.value)
        if guard == "value":
            low = high = estimate.value
        inside = [end >= self.bound if self.sign == ">=" else end <= self.bound for end in (low, high)]
        return "pass" if all(inside) else "undecided" if any(inside) else "fail"


@dataclass(frozen=True)
class Judgment(Shown):
    """The verdict on a value, with the name of its chart or photograph."""

    limit: Limit
    chart: str
    part: str
    estimate: Estimate
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class Judged(Tabular, Reported):
    """The verdicts on image quality; the report is that of the image quality, with the verdicts on its first page.

    Parameters
    ----------
    name
        Of the limits.
    rows
        The verdict on each value.
    quality
        The image quality.
    """

    name: str
    rows: tuple[Judgment, ...]
    quality: ImageQuality | CameraQuality

    @property
    def passed(self) -> bool:
        """Whether every value passes; an undecided or missing one does not."""
        return all(row.verdict == "pass" for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        rows = [
            {"limit": row.limit.text, "chart": row.chart, "part": row.part, "verdict": row.verdict}
            | row.estimate.to_dict()
            for row in self.rows
        ]
        return {"name": self.name, "passed": self.passed, "limits": rows}

    def _table(self) -> ResultTable:
        rows = []
        for row in self.rows:
            low, high = row.estimate.interval_95 or (None, None)
            rows.append((row.limit.text, row.chart, row.part, row.estimate.shown_value, low, high, row.verdict))
        title = f"{self.name}: {'pass' if self.passed else 'no pass'}"
        return ResultTable(title, ("limit", "chart", "part", "value", "lower 95 %", "upper 95 %", "verdict"), rows)


class _File(Section):
    photosite_limits: Literal[1]
    name: str | None = None
    guard: Guard = "interval"
    limits: Annotated[list[str], Field(min_length=1)]


@dataclass(frozen=True)
class Limits(Shown):
    """Limits of image quality.

    Parameters
    ----------
    limits
        The conditions.
    guard
        "interval": a value passes if its whole 95 % interval does; "value": intervals are ignored.
    name
        Name of the limits.
    """

    limits: tuple[Limit, ...]
    guard: Guard = "interval"
    name: str = "limits"

    def judge(self, found: ImageQuality | CameraQuality) -> Judged:
        """Return the verdicts on the results of one or more charts; values that were not measured are missing."""
        charts = found.charts if isinstance(found, CameraQuality) else {found.chart.name: found}
        rows = []
        for limit in self.limits:
            name = limit.name
            results = {
                chart: each.results[id] for chart, each in charts.items() if (id := name.measurement) in each.results
            }
            matching = [
                (chart, *pair)
                for chart, result in results.items()
                if isinstance(result, Result)
                for pair in name.among(result.values).items()
            ]
            if not matching:
                reasons = [result.reason for result in results.values() if not isinstance(result, Result)]
                missing = Estimate(reason=reasons[0] if reasons else "it was not measured")
                matching = [("", name.part or "", missing)]
            rows += [Judgment(limit, *each, limit.verdict(each[-1], self.guard)) for each in matching]
        return Judged(self.name, tuple(rows), found)


def load_limits(path: str | PathLike[str]) -> Limits:
    """Read limits from a YAML file with the fields listed at the top of this module.

    Raises
    ------
    FileError
        If the file is missing or invalid, with the line.
    """
    file = Path(path)
    data = read_yaml(file, "a file of limits")
    check_version(file, data, VERSION_KEY)
    content: _File = validated(_File, data, file)
    limits = []
    for index, text in enumerate(content.limits):
        try:
            limits.append(Limit.parse(text))
        except InputError as error:
            raise error.in_file(file, line_of(data["limits"], index)) from None
    return Limits(tuple(limits), content.guard, content.name or file.name)
