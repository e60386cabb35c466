"""The gallery's entries, its page, its command; the cheap pictures among those that a camera takes."""

from __future__ import annotations

import inspect
import io
import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from PIL import Image

from photosite.cli import gallery as command
from photosite.errors import InputError
from photosite.report.style import png_bytes, styled
from photosite.studies.gallery import entries, page
from photosite.studies.gallery.entries import GALLERY
from photosite.studies.gallery.page import Entry, chosen, write_page, write_picture
from photosite.studies.gallery.panels import DOTS_PER_INCH, curves_below, pictures

DOCS = Path(__file__).parents[3] / "docs" / "gallery"


@pytest.mark.parametrize("entry", GALLERY, ids=lambda entry: entry.key)
def test_every_entry_is_a_function_without_parameters(entry: Entry) -> None:
    module, _, name = entry.source.partition(":")
    make = getattr(import_module(f"photosite.studies.gallery.{module}"), name)
    assert not inspect.signature(make).parameters
    assert inspect.signature(make).return_annotation in ("Figure", Figure)
    assert entry.text.endswith(".")
    assert "  " not in entry.text


def test_keys_are_unique_and_chosen_by_name() -> None:
    keys = [entry.key for entry in GALLERY]
    assert len(set(keys)) == len(keys) >= 15
    assert [entry.key for entry in chosen(["glare", "patterns"])] == ["patterns", "glare"]  # in the gallery's order
    with pytest.raises(InputError, match=r"no picture 'glar'; Did you mean 'glare'"):
        chosen(["glar"])


def test_the_page_in_docs_is_the_one_that_the_command_writes(tmp_path: Path) -> None:
    """Entries that change, come or go make the page stale, and this fails: run the command again."""
    written = write_page(GALLERY, tmp_path).read_text(encoding="utf-8")
    assert (DOCS / "README.md").read_text(encoding="utf-8") == written
    files = {file.name: file for file in DOCS.iterdir()}
    assert set(files) == {"README.md", *(entry.file_name for entry in GALLERY)}
    assert sum(file.stat().st_size for file in files.values()) < 4e6
    for entry in GALLERY:
        with Image.open(files[entry.file_name]) as picture:
            assert picture.format == ("JPEG" if entry.noisy else "PNG")
            assert 400 < picture.width <= 1250  # readable at its own size on a page


@styled()
def _noise() -> Figure:
    random = np.random.default_rng(3)
    return pictures(
        [
            [("grey", random.random((20, 33), np.float32)), ("colour", random.random((20, 40, 3), np.float32))],
            [("large", np.eye(11, dtype=np.float32))],
        ],
        1.1,
        below_in=1.0,
    )


def test_pixels_of_panels_are_whole_pixels_of_the_figure() -> None:
    """Else drawing would resample them, and a zone plate would get rings that no camera made."""
    with Image.open(io.BytesIO(png_bytes(_noise(), DOTS_PER_INCH))) as drawn:
        got = np.asarray(drawn.convert("RGB"))
    random = np.random.default_rng(3)
    grey, colour = random.random((20, 33), np.float32), random.random((20, 40, 3), np.float32)
    first = got[30:50, 6:39]
    assert np.abs(first / 255.0 - grey[:, :, None]).max() < 2 / 255  # one of 256 greys, rounded
    assert np.abs(got[30:50, 49:89] / 255.0 - colour).max() < 1 / 250
    times = (round(1.1 * DOTS_PER_INCH) - 12) // 11
    large = got[74 : 74 + 11 * times, 6 : 6 + 11 * times, 0]
    np.testing.assert_array_equal(large, np.kron(np.eye(11), np.full((times, times), 255)))
    assert got.shape[0] == 2 * 6 + 24 + 20 + 24 + 11 * times + 110


def test_curves_stand_below_the_pictures() -> None:
    with styled():
        figure = pictures([[("a", np.zeros((50, 300), np.float32))]], below_in=2.0)
        axes = curves_below(figure, 2.0)
    assert axes.get_position().y1 < figure.axes[0].get_position().y0
    assert axes.get_position().x1 < 1


def test_a_picture_is_the_same_bytes_every_time_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Entry, "figure", lambda self: _noise())
    plain = Entry("noise", "Noise", "Seen.", "x:y")
    first = write_picture(plain, tmp_path).read_bytes()
    assert write_picture(plain, tmp_path).read_bytes() == first
    with (
        Image.open(tmp_path / "noise.png") as read,
        Image.open(io.BytesIO(png_bytes(_noise(), DOTS_PER_INCH))) as drawn,
    ):
        np.testing.assert_array_equal(np.asarray(read.convert("RGB")), np.asarray(drawn.convert("RGB")))
    assert write_picture(Entry("noise", "Noise", "Seen.", "x:y", noisy=True), tmp_path).suffix == ".jpg"


def _small_gallery(monkeypatch: pytest.MonkeyPatch, *, extra: str | None) -> None:
    def make(entry: Entry) -> Figure:
        if entry.key == "render":
            raise InputError("rendering needs the extra 'render': pip install 'photosite[render]'")
        return _noise()

    small = (Entry("noise", "Noise", "Seen.", "x:y"), Entry("render", "A render", "Seen.", "x:y", extra=extra))
    monkeypatch.setattr(entries, "GALLERY", small)
    monkeypatch.setattr(page.Entry, "figure", make)


def test_a_picture_whose_extra_is_missing_is_left_out_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _small_gallery(monkeypatch, extra="render")
    folder = tmp_path / "gallery"
    done = CliRunner().invoke(command.command, ["-o", str(folder), "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["pictures"] == [str(folder / "noise.png")]
    assert found["left_out"]["render"].startswith("rendering needs the extra 'render'")
    assert "left out: A render: rendering needs the extra" in done.stderr
    assert sorted(file.name for file in folder.iterdir()) == ["README.md", "noise.png"]
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert "![Noise](noise.png)" in text
    assert "render.png" not in text
    assert "- A render: rendering needs the extra 'render'" in text


def test_any_other_failure_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _small_gallery(monkeypatch, extra=None)
    done = CliRunner().invoke(command.command, ["-o", str(tmp_path / "gallery")])
    assert isinstance(done.exception, InputError)
    assert not list(tmp_path.iterdir())
