"""One closed loop that the report's tests share, and a reader of pages."""

from __future__ import annotations

import base64
from html.parser import HTMLParser

import numpy as np
import pytest

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import frame_set_from_arrays
from photosite.studies.closed_loop.study import ClosedLoop, closed_loop
from photosite.studies.protocol import ShootingProtocol, series
from photosite.studies.virtual_lab import with_pedestal

VOID = {"meta", "img", "br", "hr"}


class PageReader(HTMLParser):
    """Reads a page strictly: every element is closed where it was opened."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.rows: list[list[str]] = []
        self.words: list[str] = []
        self._in_cell = False
        self.feed(text)
        self.close()
        assert self.open == [], f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), f"an attribute twice in <{tag}>"
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self._in_cell = True

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag
        if tag in ("td", "th"):
            self._in_cell = False

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.words.append(data)
        if self._in_cell:
            self.rows[-1][-1] += data

    @property
    def text(self) -> str:
        """All that is read, white space evened out."""
        return " ".join("".join(self.words).split())

    def values(self, attribute: str) -> list[str]:
        """What an attribute says, wherever it stands."""
        return [attributes[attribute] for _, attributes in self.elements if attribute in attributes]

    def images(self, media_type: str) -> list[bytes]:
        """The images of one type."""
        start = f"data:{media_type};base64,"
        found = [
            a["src"].removeprefix(start) for tag, a in self.elements if tag == "img" and a["src"].startswith(start)
        ]
        return [base64.b64decode(text, validate=True) for text in found]


@pytest.fixture(scope="session")
def read_page() -> type[PageReader]:
    return PageReader


@pytest.fixture(scope="session")
def loop() -> ClosedLoop:
    steps = (*series("dark", 1 / 8000, 1.0, 4, 6), *series("light", 1 / 8000, 1 / 25, 8, 4))
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=132, cols=196))
    return closed_loop(sensor, ShootingProtocol("short", steps), seed=5)


@pytest.fixture(scope="session")
def darks_only() -> Calibration:
    """No lights, no photons, no volts, one channel."""
    rng = np.random.default_rng(3)
    darks = np.rint(rng.normal(64.0, 2.0, (2, 6, 24, 32))).astype(np.uint16)
    frames = [("dark", t, dn) for t, stack in zip((0.01, 1.0), darks, strict=True) for dn in stack]
    return calibrate(frame_set_from_arrays(frames, bits=12))
