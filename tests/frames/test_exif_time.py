"""Times of photographs with the digits of their seconds: DNG, Exif directories, JPEG."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

import photosite as ps
from photosite.metrics.chart_image import chart_image
from photosite.values.exif_time import iso_time

TIMES = [f"2026-11-28T12:00:00.{ms:03d}" for ms in (0, 41, 79, 122, 160)]


@pytest.mark.parametrize(
    ("date", "digits", "zone", "expected"),
    [
        ("2026:11:28 12:00:01", "370", "+02:00", "2026-11-28T12:00:01.370+02:00"),
        ("2026:11:28 12:00:01", "4  ", None, "2026-11-28T12:00:01.4"),
        ("2026:11:28 12:00:01", "123456789", None, "2026-11-28T12:00:01.123456"),
        ("2026:11:28 12:00:01", "??", "UTC", "2026-11-28T12:00:01"),
        ("    :  :     :  :  ", "12", None, None),
        (None, "12", None, None),
    ],
)
def test_times(date: str | None, digits: str | None, zone: str | None, expected: str | None) -> None:
    assert iso_time(date, digits, zone) == expected


@pytest.mark.parametrize("time", ["2026-11-28T12:00:00.041000", "2026-11-28T12:00:00", "2026-11-28T12:00:00.5-05:00"])
def test_dng_keeps_the_time(tmp_path: Path, time: str) -> None:
    frame = ps.RawFrame(np.full((24, 24), 100, np.uint16), 12, (("R", "G"), ("G", "B")), metadata={"date_time": time})
    frame.save(tmp_path / "a.dng")
    found = ps.read_raw(tmp_path / "a.dng").metadata["date_time"]
    assert datetime.fromisoformat(found) == datetime.fromisoformat(time)


def test_tiff_with_digits_of_the_original_time(tmp_path: Path) -> None:
    """The time of the exposure goes before that of the last change."""
    file = tmp_path / "a.tif"
    tags = [(36867, "s", 0, "2026:11:28 12:00:00", True), (37521, "s", 0, "37", True)]
    with tifffile.TiffWriter(file) as writer:
        writer.write(np.full((8, 8), 100, np.uint16), datetime="2026:12:24 00:00:00", extratags=tags)
    assert ps.read_raw(file).metadata["date_time"] == "2026-11-28T12:00:00.37"


def test_jpeg_pictures_give_their_times(tmp_path: Path) -> None:
    files = []
    for number, time in enumerate(TIMES):
        exif = Image.Exif()
        exif.get_ifd(34665).update({36867: "2026:11:28 12:00:00", 37521: time.rpartition(".")[2]})
        files.append(tmp_path / f"{number}.jpg")
        Image.fromarray(np.full((16, 16, 3), 100, np.uint8)).save(files[-1], exif=exif)
    assert list(chart_image(files).stamps) == TIMES
    Image.fromarray(np.full((16, 16, 3), 100, np.uint8)).save(files[0])
    assert chart_image(files).stamps == ()
