"""Which pictures the gallery has, and the page that shows them."""

from __future__ import annotations

import importlib
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from photosite.errors import InputError, did_you_mean
from photosite.report.style import png_bytes

PAGE_NAME = "README.md"
COMMAND = "photosite reproduce gallery -o gallery"
_DOTS_PER_INCH = 110.0


@dataclass(frozen=True)
class Entry:
    """A picture of the gallery.

    Parameters
    ----------
    key
        Its file's name, without .png.
    title
        A few words.
    text
        What is to be seen, for the page.
    source
        "module:function" of `photosite.studies.gallery`; the function takes nothing and returns a matplotlib figure.
    """

    key: str
    title: str
    text: str
    source: str

    def figure(self) -> Figure:
        """The picture, made."""
        module, _, name = self.source.partition(":")
        make: Callable[[], Figure] = getattr(importlib.import_module(f"photosite.studies.gallery.{module}"), name)
        return make()


GALLERY: tuple[Entry, ...] = ()


def chosen(keys: Sequence[str] | None) -> tuple[Entry, ...]:
    """The entries with these keys, in the gallery's order; None is all.

    Raises
    ------
    InputError
        If there is no such entry.
    """
    known = {entry.key: entry for entry in GALLERY}
    for key in keys or ():
        if key not in known:
            raise InputError(f"the gallery has no picture '{key}'; {did_you_mean(key, known)}")
    return tuple(entry for entry in GALLERY if keys is None or entry.key in keys)


def write_picture(entry: Entry, folder: str | PathLike[str]) -> Path:
    """Make a picture and write it as PNG of 256 colours at most, which its lines and fields need no more than."""
    whole = Image.open(io.BytesIO(png_bytes(entry.figure(), _DOTS_PER_INCH))).convert("RGB")
    path = Path(folder) / f"{entry.key}.png"
    whole.quantize(256, dither=Image.Dither.NONE).save(path, format="PNG", optimize=True)
    return path


def write_page(entries: Sequence[Entry], folder: str | PathLike[str]) -> Path:
    """The page: each picture under its title, over its text."""
    lines = [
        "# Gallery",
        "",
        f"Scenes, lenses and sensors as photosite has them. Made by `{COMMAND}`.",
        "",
    ]
    for entry in entries:
        lines += [f"## {entry.title}", "", f"![{entry.title}]({entry.key}.png)", "", entry.text, ""]
    path = Path(folder) / PAGE_NAME
    path.write_text("\n".join(lines), encoding="utf-8")
    return path
