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
from photosite.studies.gallery.panels import DOTS_PER_INCH

PAGE_NAME = "README.md"
COMMAND = "photosite reproduce gallery -o gallery"
_JPEG_QUALITY = 92


@dataclass(frozen=True)
class Entry:
    """A picture of the gallery.

    Parameters
    ----------
    key
        Its file's name, without ending.
    title
        A few words.
    text
        What is to be seen, for the page.
    source
        "module:function" of `photosite.studies.gallery`; the function takes nothing and returns a matplotlib figure.
    noisy
        It is mostly pixels with noise, which PNG would keep at ten times the size: a JPEG.
    extra
        The extra that it needs. Where that is missing the picture is left out.
    """

    key: str
    title: str
    text: str
    source: str
    noisy: bool = False
    extra: str | None = None

    @property
    def file_name(self) -> str:
        """In the gallery's folder."""
        return f"{self.key}.{'jpg' if self.noisy else 'png'}"

    def figure(self) -> Figure:
        """The picture, made."""
        module, _, name = self.source.partition(":")
        make: Callable[[], Figure] = getattr(importlib.import_module(f"photosite.studies.gallery.{module}"), name)
        return make()


def chosen(keys: Sequence[str] | None) -> tuple[Entry, ...]:
    """The entries with these keys, in the gallery's order; None is all.

    Raises
    ------
    InputError
        If there is no such entry.
    """
    from photosite.studies.gallery.entries import GALLERY

    known = {entry.key: entry for entry in GALLERY}
    for key in keys or ():
        if key not in known:
            raise InputError(f"the gallery has no picture '{key}'. {did_you_mean(key, known)}")
    return tuple(entry for entry in GALLERY if keys is None or entry.key in keys)


def write_picture(entry: Entry, folder: str | PathLike[str]) -> Path:
    """Make a picture and write it under its name: PNG without loss, JPEG where noise would make that large."""
    path = Path(folder) / entry.file_name
    with Image.open(io.BytesIO(png_bytes(entry.figure(), DOTS_PER_INCH))) as drawn:
        whole = drawn.convert("RGB")
    if entry.noisy:
        whole.save(path, format="JPEG", quality=_JPEG_QUALITY, subsampling="4:4:4", optimize=True)
    elif whole.getcolors(256) is not None:
        whole.quantize(256, dither=Image.Dither.NONE).save(path, format="PNG", optimize=True)
    else:
        whole.save(path, format="PNG", optimize=True)
    return path


def write_page(
    entries: Sequence[Entry], folder: str | PathLike[str], left_out: Sequence[tuple[Entry, str]] = ()
) -> Path:
    """The page: each picture under its title, over its text; and which were left out, and why."""
    lines = [
        "# Gallery",
        "",
        f"Scenes, lenses and sensors as photosite has them, in the order light travels. Made by `{COMMAND}`;",
        "numbers in the pictures are measured while they are drawn.",
        "",
    ]
    for entry in entries:
        lines += [f"## {entry.title}", "", f"![{entry.title}]({entry.file_name})", "", entry.text, ""]
        lines += [f"`photosite.studies.gallery.{entry.source.replace(':', '.')}`", ""]
    if left_out:
        lines += ["## Left out", "", *(f"- {entry.title}: {reason}" for entry, reason in left_out), ""]
    path = Path(folder) / PAGE_NAME
    path.write_text("\n".join(lines), encoding="utf-8")
    return path
