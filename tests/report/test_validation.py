"""The report of a validation: verdict, input, pictures and tables."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.report.html import render_page
from photosite.report.page import Details, Images, Notice, Page, Table
from photosite.report.validation import validation_page, write_validation_report
from photosite.scene.charts import macbeth
from photosite.scene.perspective import in_perspective
from photosite.validation.frame_validation import CaptureConditions, FrameValidation, validate_frames
from photosite.validation.lamp import Lamp

CORNERS = ((10.0, 22.0), (4.0, 214.0), (144.0, 206.0), (132.0, 12.0))
LENS = ps.DiffractionLimited(f_number=8, focal_length_mm=50)
SENSOR = ps.load_sensor("nikon-d200").with_(black_level_dn=64, rows=150, cols=224)
CONDITIONS = CaptureConditions(SENSOR, LENS, Lamp.from_name("A"), luminance_cd_m2=40.0)


def shots(frames: int) -> list[ps.RawFrame]:
    camera = ps.Camera(LENS, SENSOR.with_(serial="measured"))
    return list(camera.stream(in_perspective(macbeth(), CORNERS, (150, 224)), 1 / 3, frames, seed=5))


@pytest.fixture(scope="module")
def right() -> FrameValidation:
    return validate_frames(shots(2), CONDITIONS, CORNERS, fit="fill_factor")


@pytest.fixture(scope="module")
def wrong() -> FrameValidation:
    conditions = replace(CONDITIONS, sensor=SENSOR.with_(cfa="bggr"), exposure_s=0.3)
    return validate_frames(shots(1), conditions, CORNERS)


def blocks(page: Page, title: str) -> tuple[object, ...]:
    return next(section.blocks for section in page.sections if section.title == title)


def test_verdict_and_tests(right: FrameValidation, wrong: FrameValidation) -> None:
    notice, tests = blocks(validation_page(right), "Verdict")[:2]
    assert isinstance(notice, Notice)
    assert isinstance(tests, Table)
    assert notice.text.startswith("Measured and simulated agree.")
    assert not notice.warning
    assert [row[-1] for row in tests.rows] == ["agree"] * 3
    notice, tests = blocks(validation_page(wrong), "Verdict")[:2]
    assert isinstance(notice, Notice)
    assert isinstance(tests, Table)
    assert notice.text.startswith("Measured and simulated do not agree.")
    assert notice.warning
    assert [row[-2:] for row in tests.rows] == [("< 1e-12", "differ")] * 2
    text = render_page(validation_page(wrong))
    assert "The colour filter arrays differ" in text
    assert "The exposure times differ: measured 0.333333 s, simulated 0.3 s." in text


def test_input_and_fit(right: FrameValidation) -> None:
    (table, _) = blocks(validation_page(right), "Conditions of the simulation")
    assert isinstance(table, Table)
    conditions = dict(table.rows)
    assert conditions["Exposure time"] == "1/3 s; 1/3 s in the frames"
    assert conditions["Mean luminance of the patches"] == "40 cd/m²"
    assert conditions["Fill factor"] == f"{right.fit.value:.4g} (fitted)"
    numbers = blocks(validation_page(right), "Numbers")
    assert [type(block) for block in numbers] == [Table, Table, Details]
    assert [row[0] for row in numbers[1].rows] == ["all", "R", "G", "B"]


def test_every_patch_and_channel_is_listed(right: FrameValidation) -> None:
    details = blocks(validation_page(right), "Numbers")[-1]
    (table,) = details.blocks
    rows = [row for row in table.rows if isinstance(row, tuple)]
    assert len(rows) == 72
    # Channel; mean, SNR and temporal SNR of both; difference; whether it is used.
    assert {len(row) for row in rows} == {9}
    assert rows[0][1] == f"{right.validation.measured.mean_dn[0, 0]:.1f}"


def test_only_the_measured_picture_has_outlines(right: FrameValidation) -> None:
    (images,) = blocks(validation_page(right), "Pictures")
    assert isinstance(images, Images)
    assert [image.title for image in images.images] == ["Measured", "Simulated"]
    import io

    from PIL import Image

    measured, simulated = (
        np.asarray(Image.open(io.BytesIO(image.content)).convert("RGB"), float) for image in images.images
    )
    assert measured.shape == simulated.shape
    # The white outline of the darkest patch is brighter than that patch in the simulation.
    quad = right.patches[-1]
    top = int(min(right.corners[k][0] for k in range(4)) - 0.06 * 208) // 2 * 2
    left = int(min(right.corners[k][1] for k in range(4)) - 0.06 * 208) // 2 * 2
    rows = slice(quad.r0 - max(top, 0), quad.r1 - max(top, 0))
    cols = slice(quad.c0 - max(left, 0), quad.c1 - max(left, 0))
    assert measured[rows, cols].mean(axis=2).max() > 180 > simulated[rows, cols].mean(axis=2).max()


def test_files_are_reproducible(right: FrameValidation, tmp_path: Path) -> None:
    for name in ("one.html", "two.html"):
        write_validation_report(right, tmp_path / name)
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "two.html").read_bytes()
    write_validation_report(right, tmp_path / "one.pdf")
    assert (tmp_path / "one.pdf").read_bytes().startswith(b"%PDF")


def test_monochrome_camera_has_no_colours() -> None:
    green = SENSOR.channels["G"]
    mono = SENSOR.with_(cfa=[["M"]], channels={"M": green})
    camera = ps.Camera(LENS, mono.with_(serial="measured"))
    scene = in_perspective(macbeth(), CORNERS, (150, 224))
    result = validate_frames([camera.capture(scene, 1 / 3, seed=1)], replace(CONDITIONS, sensor=mono), CORNERS)
    assert result.agrees
    page = validation_page(result)
    assert blocks(page, "Colours") == ()
    assert "no colour differences: the channels are not R, G and B" in render_page(page).lower().replace(
        "r, g and b", "R, G and B"
    )
