"""The report of a validation: verdict, input, pictures and tables."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import photosite as ps
from photosite.report.page import Details, Images, Notice, Page, Table
from photosite.report.validation import validation_page
from photosite.report.write import render_page
from photosite.scene.charts import macbeth
from photosite.scene.placement import in_perspective
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


@pytest.fixture(scope="module")
def right_page(right: FrameValidation) -> Page:
    return validation_page(right)


def blocks(page: Page, title: str) -> tuple[object, ...]:
    return next(section.blocks for section in page.sections if section.title == title)


def test_verdict_and_tests(right_page: Page, wrong: FrameValidation) -> None:
    notice, tests = blocks(right_page, "Verdict")[:2]
    assert isinstance(notice, Notice)
    assert isinstance(tests, Table)
    assert notice.text.startswith("Measured and simulated agree.")
    assert not notice.warning
    assert [row[-1] for row in tests.rows] == ["agree"] * 3
    wrong_page = validation_page(wrong)
    notice, tests = blocks(wrong_page, "Verdict")[:2]
    assert isinstance(notice, Notice)
    assert isinstance(tests, Table)
    assert notice.text.startswith("Measured and simulated do not agree.")
    assert notice.warning
    assert [row[-2:] for row in tests.rows] == [("< 1e-12", "differ")] * 2
    text = render_page(wrong_page)
    assert "The color filter arrays differ" in text
    assert "The exposure times differ: measured 0.333333 s, simulated 0.3 s." in text


def test_input_and_fit(right: FrameValidation, right_page: Page) -> None:
    (table, _) = blocks(right_page, "Conditions of the simulation")
    assert isinstance(table, Table)
    conditions = dict(table.rows)
    assert conditions["Exposure time"] == "1/3 s; 1/3 s in the frames"
    assert conditions["Mean luminance of the patches"] == "40 cd/m²"
    assert conditions["Fill factor"] == f"{right.fit.value:.4g} (fitted)"
    numbers = blocks(right_page, "Numbers")
    assert [type(block) for block in numbers] == [Table, Table, Details]
    assert [row[0] for row in numbers[1].rows] == ["all", "R", "G", "B"]


def test_every_patch_and_channel_is_listed(right: FrameValidation, right_page: Page) -> None:
    details = blocks(right_page, "Numbers")[-1]
    (table,) = details.blocks
    rows = [row for row in table.rows if isinstance(row, tuple)]
    assert len(rows) == 72
    # Channel; mean, SNR and temporal SNR of both; difference; whether it is used.
    assert {len(row) for row in rows} == {9}
    assert rows[0][1] == f"{right.validation.measured.mean_dn[0, 0]:.1f}"


def test_only_the_measured_picture_has_outlines(right: FrameValidation, right_page: Page) -> None:
    (images,) = blocks(right_page, "Pictures")
    assert isinstance(images, Images)
    assert [image.title for image in images.images] == ["Measured", "Simulated"]
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


def test_page_is_reproducible(right: FrameValidation, right_page: Page) -> None:
    assert render_page(validation_page(right)) == render_page(right_page)


def test_monochrome_camera_has_no_colours() -> None:
    green = SENSOR.channels["G"]
    mono = SENSOR.with_(cfa=[["M"]], channels={"M": green})
    camera = ps.Camera(LENS, mono.with_(serial="measured"))
    scene = in_perspective(macbeth(), CORNERS, (150, 224))
    result = validate_frames([camera.capture(scene, 1 / 3, seed=1)], replace(CONDITIONS, sensor=mono), CORNERS)
    assert result.agrees
    assert blocks(validation_page(result), "Colors") == ()
    assert result.validation.notes == ("no color differences: the channels are not R, G and B",)
