"""A person's whole path through each view, at three widths, in both appearances, with axe-core."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from photosite.studies.planning import precision_curves

pytestmark = pytest.mark.browser

WIDTHS = {390: 844, 1024: 768, 1600: 1000}
VIEWS = ("camera", "calibrate", "compare", "plan", "sweep", "quality")
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
PICTURES = os.environ.get("PICTURES")
"""Folder to write screenshots to."""


def wait(page, script: str, argument: object = None) -> None:
    """Wait until a script returns true; `page.wait_for_function` needs eval, which the page's policy forbids."""
    deadline = time.monotonic() + 180
    while not page.evaluate(script, argument):
        assert time.monotonic() < deadline, script
        page.wait_for_timeout(100)


def opened(page, link: str, view: str = "camera") -> None:
    page.goto(link)
    page.wait_for_url("**/")
    page.goto(f"{link.split('/?')[0]}/#{view}")
    ready(page, view)


def ready(page, view: str) -> None:
    if view == "camera":
        page.wait_for_selector("#badge.exact")
    elif view == "calibrate":
        page.get_by_label("Folder on this machine").select_option("stack")
        page.wait_for_selector("#view-calibrate table")
    else:
        page.wait_for_selector(f"#view-{view} .card table, #view-{view} .card svg")
        wait(
            page,
            "text => document.querySelector(text).textContent.startsWith('computed')",
            f"#view-{view} [role=status]",
        )


def drop(page, target: str, path: Path) -> None:
    """Drop a file on an element, as a file manager does."""
    transfer = page.evaluate_handle(
        "([name, text]) => { const made = new DataTransfer(); made.items.add(new File([text], name)); return made; }",
        [path.name, path.read_text()],
    )
    for event in ("dragenter", "dragover", "drop"):
        page.dispatch_event(target, event, {"dataTransfer": transfer})


def save(page, name: str) -> None:
    if PICTURES:
        page.screenshot(path=str(Path(PICTURES, f"{name}.png")), full_page=True)


def set_number(page, label: str, value: object) -> None:
    page.get_by_label(label, exact=True).first.fill(str(value))


@pytest.mark.parametrize("appearance", ["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("view", VIEWS)
def test_no_violations_of_accessibility_and_nothing_cut_off(
    page, link, axe, view: str, width: int, appearance: str
) -> None:
    page.set_viewport_size({"width": width, "height": WIDTHS[width]})
    page.emulate_media(color_scheme=appearance)
    opened(page, link, view)
    if PICTURES and view == "compare":
        wait(page, "document.querySelectorAll('#view-compare .badge.exact').length === 2")
    save(page, f"{view}-{width}-{appearance}")
    page.evaluate(axe)
    page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    result = page.evaluate(f"axe.run(document, {{runOnly: {json.dumps(RULES)}}})")
    found = [
        (v["id"], [node["target"] for node in v["nodes"]][:3], v["nodes"][0]["any"][:1]) for v in result["violations"]
    ]
    assert not found
    assert len(result["passes"]) > 15
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_camera_view_from_slider_to_copied_python(page, link) -> None:
    views: list = []
    page.on("response", lambda answer: answer.url.endswith("/api/view") and views.append(answer))
    opened(page, link)
    page.select_option("#pick-sensor", "file:small.sensor.yaml")
    wait(page, "document.getElementById('status-text').textContent.startsWith('Small')")
    page.select_option("#pick-scene", "siemens-star")
    page.locator("label.name:text-is('Cycles')").wait_for()
    set_number(page, "Exposure", 0.02)
    slider = page.get_by_label("f-number slider", exact=True)
    slider.focus()
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    f_number = float(page.get_by_label("f-number", exact=True).input_value())
    assert f_number < 8
    page.wait_for_selector("#badge.exact")
    body = views[-1].body()
    size = int.from_bytes(body[:4], "little")
    header = json.loads(body[4 : 4 + size])
    assert (header["exact"], header["rows"], header["cols"]) == (True, 130, 194)
    assert (header["mean"], header["dn_type"]) == (True, "uint16")
    dn = np.frombuffer(body, np.uint16, 130 * 194, 4 + size + 4 * 130 * 194).reshape(130, 194)
    page.click("#copy-python")
    page.wait_for_selector("#code[open]")
    names: dict = {}
    exec(page.inner_text("#code-text"), names)
    assert names["optics"].f_number == f_number
    assert np.array_equal(names["dn"], dn)
    page.click("#code-close")

    copied = page.url
    page.goto(link.split("/?")[0] + "/#plan")
    page.goto(copied)
    page.reload()
    ready(page, "camera")
    assert float(page.get_by_label("f-number", exact=True).input_value()) == f_number
    assert page.input_value("#pick-scene") == "siemens-star"


def test_pixels_regions_layers_and_effects(page, link) -> None:
    opened(page, link)
    page.click("#zoom-one")
    wait(page, "document.getElementById('status-text').textContent.includes('every pixel')")
    box = page.locator("#picture").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 150)
    wait(page, "/Row \\d+, column \\d+, [RGB]: [\\d.]+ DN/.test(document.getElementById('readout').textContent)")
    page.click("#mode-region")
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 180, box["y"] + 160, steps=4)
    page.mouse.up()
    page.wait_for_selector("#regions table")
    cells = page.locator("#regions tbody tr").first.locator("td").all_inner_texts()
    assert cells[0] == "R"
    assert all(float(text) > 0 for text in cells[1:])
    for layer in ("raw", "mean", "snr", "developed"):
        page.select_option("#layer", layer)
    page.check("#overlay")
    page.get_by_text("Shutter and effects", exact=True).click()
    page.check("[data-part=telegraph_noise]")
    page.get_by_label("Amplitude", exact=True).fill("500")
    page.wait_for_selector("#badge.preview")
    page.wait_for_selector("#badge.exact")
    page.get_by_text("Undo changes of the sensor").click()
    wait(page, "!document.querySelector('[data-part=telegraph_noise]').checked")


def test_tables_captures_and_dropped_files_are_simulated(page, link, folder: Path) -> None:
    opened(page, link)
    drop(page, "#picture", folder / "small.sensor.yaml")
    wait(page, "document.getElementById('status-text').textContent.startsWith('Small')")
    page.get_by_text("Spectral response", exact=True).click()
    page.locator("summary", has_text=re.compile("^G$")).last.click()
    table = page.get_by_label("Quantum efficiency, table").nth(1)
    table.fill("400 0.1\n500 0.6 0.2 7")
    table.blur()
    assert table.get_attribute("aria-invalid") == "true"
    csv = folder / "green.csv"
    csv.write_text("wavelength,efficiency\n400,0.1\n550,0.7\n700,0.05\n")
    name = table.get_attribute("id")
    drop(page, f"#{name}", csv)
    wait(page, "name => document.getElementById(name).value.startsWith('wavelength')", name)
    assert table.get_attribute("aria-invalid") is None
    page.get_by_text("Captures", exact=True).first.click()
    page.check("[data-part=captures]")
    page.get_by_role("button", name="Add to Parts").click()
    page.get_by_label("Name", exact=True).last.fill("shortest")
    page.get_by_label("Name", exact=True).last.blur()
    page.get_by_label("Flicker", exact=True).check()
    page.wait_for_selector("#badge.exact")
    page.click("#copy-python")
    page.wait_for_selector("#code[open]")
    names: dict = {}
    exec(page.inner_text("#code-text"), names)
    sensor = names["sensor"]
    assert sensor.channels["G"].quantum_efficiency == (0.1, 0.7, 0.05)
    assert sensor.captures.names[-1] == "shortest"
    assert names["scene"].flicker.frequency_hz == 100.0


def test_a_lens_with_aberrations_and_an_added_gain_setting(page, link, axe) -> None:
    opened(page, link)
    page.select_option("#pick-sensor", "google-pixel-4a")
    page.wait_for_selector("#pick-gain")
    page.get_by_text("Array", exact=True).click()
    set_number(page, "Rows", 200)
    set_number(page, "Columns", 300)
    for part in ("distortion", "blur", "pupil", "lateral_color", "relative_illumination", "veiling_glare"):
        page.check(f"[data-part={part}]")
    page.locator("[data-part=blur] >> xpath=../..").get_by_label("Defocus", exact=True).fill("20")
    page.locator("[data-part=distortion] >> xpath=../..").get_by_label("Kind").select_option("table")
    table = page.get_by_label("Percent, table")
    table.fill("0 0\n5 -1 3")
    table.blur()
    assert table.get_attribute("aria-invalid") == "true"
    table.fill("0 0\n20 -1")
    table.blur()
    f_number = page.get_by_label("f-number", exact=True)
    f_number.fill("0.2")
    f_number.blur()
    assert page.get_by_text("f-number must be a number, 0.5 or more").is_visible()
    f_number.fill("2.8")
    page.get_by_text("Gain settings", exact=True).click()
    page.get_by_role("button", name="Add to Other settings").click()
    assert page.locator("#pick-gain option").all_inner_texts() == ["55", "110", "220", "440", "880", "1760"]
    page.select_option("#pick-gain", "1760")
    wait(page, "document.querySelector('#badge.exact') && location.hash.includes('camera=')")
    page.click("#copy-python")
    page.wait_for_selector("#code[open]")
    names: dict = {}
    exec(page.inner_text("#code-text"), names)
    sensor, optics = names["sensor"], names["optics"]
    assert (sensor.gain_setting, sensor.readout.analog_gain.value) == (1760, 32)
    assert (optics.base.f_number, optics.blur.defocus_um, optics.blur.pupil.blades) == (2.8, 20, 7)
    assert optics.distortion.ratio.tolist() == [1.0, 0.99]
    page.click("#code-close")
    page.evaluate(axe)
    page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    result = page.evaluate(f"axe.run(document, {{runOnly: {json.dumps(RULES)}}})")
    assert not [(v["id"], [node["target"] for node in v["nodes"]][:3]) for v in result["violations"]]
    page.reload()
    ready(page, "camera")
    assert page.input_value("#pick-gain") == "1760"
    assert page.is_checked("[data-part=lateral_color]")


@pytest.mark.refused
def test_a_wrong_value_is_explained_and_the_page_goes_on(page, link) -> None:
    opened(page, link)
    set_number(page, "Distance", 0.01)
    page.wait_for_selector("#alert:not([hidden])")
    assert "focal length" in page.inner_text("#alert")
    set_number(page, "Distance", 2)
    page.wait_for_selector("#badge.exact")
    assert page.is_hidden("#alert")


@pytest.mark.refused
def test_errors_of_uploads_and_regions_stay_until_the_next_try(page, link, folder: Path, tmp_path: Path) -> None:
    opened(page, link)
    damaged = tmp_path / "damaged.png"
    damaged.write_bytes(b"no picture")
    page.set_input_files("#upload-scene", str(damaged))
    page.wait_for_selector("#alert:not([hidden])")
    assert page.inner_text("#alert").startswith("damaged.png: ")
    set_number(page, "Exposure", 0.31)
    page.wait_for_selector("#badge.preview")
    page.wait_for_selector("#badge.exact")
    assert page.inner_text("#alert").startswith("damaged.png: ")
    for name, value in (("r0", 9000), ("r1", 9001), ("c0", 0), ("c1", 8)):
        page.fill(f"#region-{name}", str(value))
    page.get_by_role("button", name="Add region").click()
    assert "2592 rows and 3872 columns" in page.inner_text("#alert")
    assert page.locator("#regions table").count() == 0
    page.set_input_files("#upload-scene", str(shutil.copy(folder / "picture.png", tmp_path / "second.png")))
    wait(page, "document.getElementById('pick-scene').value.startsWith('upload:')")
    assert page.is_hidden("#alert")


@pytest.mark.refused
@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="finds the processes of the server in /proc")
def test_the_page_goes_on_after_all_worker_processes_died(page, link, folder: Path) -> None:
    opened(page, link)
    processes: dict[str, tuple[str, bytes]] = {}
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended
            processes[path.name] = (path / "status").read_text(), (path / "cmdline").read_bytes()
    server = next(pid for pid, (_, line) in processes.items() if b"serve" in line and str(folder).encode() in line)
    workers = [pid for pid, (of, line) in processes.items() if f"PPid:\t{server}\n" in of and b"spawn_main" in line]
    assert len(workers) >= 3
    for pid in workers:
        os.kill(int(pid), signal.SIGKILL)
    set_number(page, "Exposure", 0.21)
    page.wait_for_selector("#badge:not(.exact)")  # a preview, or an error where a process ends during the request
    page.wait_for_selector("#badge.exact")
    assert page.is_hidden("#alert")


@pytest.mark.refused
def test_a_process_that_dies_at_work_and_a_full_disk_are_said_on_the_page(page, link) -> None:
    opened(page, link)
    lost = {"error": "the computation failed: its process ended; a new one was started"}
    page.route("**/api/view", lambda route: route.fulfill(status=503, json=lost), times=1)
    set_number(page, "Exposure", 0.22)
    page.wait_for_selector("#alert:not([hidden])")
    assert "process ended" in page.inner_text("#alert")
    page.wait_for_selector("#badge.exact")
    assert page.is_hidden("#alert")
    full = {"id": "x", "kind": "frame", "status": "failed", "error": "No space left on device: frame.npy"}
    page.route("**/api/frames", lambda route: route.fulfill(status=202, json=full), times=1)
    set_number(page, "Exposure", 0.23)
    page.wait_for_selector("#alert:not([hidden])")
    assert "No space left" in page.inner_text("#alert")


def test_a_long_frame_can_be_cancelled_and_another_tab_goes_on(page, link, browser) -> None:
    opened(page, link)
    page.select_option("#pick-sensor", "sony-a7r2")
    page.wait_for_selector("#working:not([hidden])")
    other = page.context.new_page()
    other.goto(link.split("/?")[0] + "/")
    other.wait_for_selector("#badge.preview, #badge.exact")
    page.bring_to_front()
    page.click("#cancel")
    page.wait_for_selector("#working", state="hidden")
    assert "exact frame follows" not in page.inner_text("#status")
    other.wait_for_selector("#badge.exact")
    other.close()


def test_the_picture_with_the_keyboard(page, link) -> None:
    opened(page, link)
    page.focus("#picture")
    page.keyboard.press("1")
    wait(page, "document.getElementById('status-text').textContent.includes('every pixel')")
    before = page.inner_text("#readout")
    page.keyboard.press("ArrowRight")
    wait(page, "text => document.getElementById('readout').textContent !== text", before)
    page.keyboard.press("0")
    wait(page, "document.getElementById('status-text').textContent.includes('the mean of')")


def test_the_first_keys_reach_the_views_in_order(page, link) -> None:
    opened(page, link)
    page.reload()
    ready(page, "camera")
    reached = []
    for _ in range(10):
        page.keyboard.press("Tab")
        reached.append(
            page.evaluate("document.activeElement.textContent.trim().slice(0, 12) || document.activeElement.id")
        )
    reached = [each for each in reached if not each.startswith("Uploads")]  # there if a test before has uploaded
    views = ["Camera", "Calibrate", "Compare", "Plan", "Sweep", "Quality"]
    assert reached[:8] == ["Skip to cont", *views, "Appearance: "]


def test_an_upload_is_simulated(page, link, folder: Path) -> None:
    opened(page, link)
    page.set_input_files("#upload-scene", str(folder / "picture.png"))
    wait(page, "document.getElementById('pick-scene').value.startsWith('upload:')")
    wait(page, "document.getElementById('picture').getAttribute('aria-label').includes('picture')")
    page.wait_for_selector("#badge.exact")
    page.click("#uploads-open")
    page.get_by_role("dialog").get_by_role("button", name="Delete picture.png").click()
    wait(page, "document.getElementById('pick-scene').value === 'macbeth'")
    wait(page, "!/ of picture/.test(document.getElementById('picture').getAttribute('aria-label'))")
    page.wait_for_selector("#badge.exact")
    page.reload()
    ready(page, "camera")
    assert page.is_hidden("#alert")
    page.wait_for_timeout(500)  # the list of uploads has arrived
    assert "picture.png" not in page.locator("#uploads").inner_html()


def test_other_views_switch_away_from_a_deleted_sensor(page, link, folder: Path) -> None:
    opened(page, link)
    page.set_input_files("#upload-sensor", str(folder / "small.sensor.yaml"))
    wait(page, "document.getElementById('pick-sensor').value.startsWith('upload:')")
    for view in ("compare", "plan", "sweep"):
        page.click(f"a[href='#{view}']")
        page.locator(f"#view-{view} select").first.wait_for()
    for view in ("plan", "sweep"):
        page.click(f"a[href='#{view}']")
        page.locator(f"#view-{view} select").first.select_option("sensor of the camera view")
    page.get_by_role("button", name=re.compile("^Uploads")).click()
    page.get_by_role("dialog").get_by_role("button", name="Delete small.sensor.yaml").last.click()
    for view in ("plan", "sweep"):
        wait(page, f"document.querySelector('#view-{view} select').value.includes('nikon-d200')")
        assert "upload:" not in page.locator(f"#view-{view}").inner_html()
    texts = page.locator("#view-compare").get_by_text("(of the camera view)").all_inner_texts()
    assert [text.strip() for text in texts] in ([], ["nikon-d200 (of the camera view)"])


def test_a_broken_sensor_file_in_compare_is_named(page, link, folder: Path) -> None:
    broken = folder / "broken.sensor.yaml"
    broken.write_text("photosite_sensor: 1\nname: broken\narray: {rows: many}\n")
    try:
        opened(page, link, "compare")
        page.locator("#view-compare").get_by_label("broken.sensor.yaml").check()
        page.wait_for_selector("#alert:not([hidden])", timeout=120_000)
        assert re.search(r"broken\.sensor\.yaml:\d+: ", page.inner_text("#alert"))
        assert "\n" not in page.inner_text("#alert")
    finally:
        broken.unlink()


def test_an_uploaded_folder_of_frames_is_deleted(page, link, folder: Path) -> None:
    opened(page, link, "calibrate")
    page.set_input_files("#frames-folder", str(folder / "stack"))
    picked = page.get_by_label("Folder on this machine")
    wait(page, "document.querySelector('#view-calibrate select').value.startsWith('upload:')")
    page.get_by_role("button", name=re.compile("^Uploads")).click()
    row = page.get_by_role("dialog").get_by_role("row", name=re.compile("15 frames, 64 x 64 pixels")).last
    row.get_by_role("button").click()
    wait(page, "document.querySelector('#view-calibrate select').value === ''")
    assert "stack" in picked.inner_text()
    assert "upload:" not in picked.inner_html()
    page.keyboard.press("Escape")
    picked.select_option("stack")
    page.wait_for_selector("#view-calibrate .numbered")


def test_a_folder_is_calibrated_with_a_changed_group(page, link, axe) -> None:
    opened(page, link, "calibrate")
    view = page.locator("#view-calibrate")
    view.get_by_label("Kind of group 5").select_option("omit")
    view.get_by_role("button", name="Calibrate", exact=True).click()
    view.get_by_role("heading", name="Parameters", exact=True).wait_for()
    gain = view.locator("tr", has=page.get_by_role("rowheader", name="System gain K (DN/e⁻)")).first
    low, high = (float(text) for text in gain.locator("td").nth(1).inner_text().split(" to "))
    assert low < 0.5 < high
    assert view.locator("svg.plot").count() >= 4
    view.get_by_role("button", name="Copy as Python").click()
    page.wait_for_selector("#code[open]")
    assert "replace(groups[3]" in page.inner_text("#code-text")
    assert "groups[4]" not in page.inner_text("#code-text")
    page.click("#code-close")
    with page.expect_download() as download:
        view.get_by_role("button", name="Download report.html").click()
    assert download.value.suggested_filename == "report.html"
    assert "System gain K" in download.value.path().read_text(encoding="utf-8")
    view.get_by_text("report.html downloaded").wait_for()
    points = view.locator("svg.plot").first
    points.focus()
    page.keyboard.press("ArrowRight")
    assert "(95 %)" in view.locator(".plot-value").first.inner_text()
    save(page, "calibrate-results")
    page.evaluate(axe)
    page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    result = page.evaluate(f"axe.run(document, {{runOnly: {json.dumps(RULES)}}})")
    assert not [(v["id"], [node["target"] for node in v["nodes"]][:3]) for v in result["violations"]]


def test_an_uploaded_folder_is_calibrated_with_maps(page, link, folder: Path) -> None:
    opened(page, link, "calibrate")
    page.set_input_files("#frames-folder", str(folder / "stack"))
    view = page.locator("#view-calibrate")
    view.get_by_text("15 frames of stack uploaded").wait_for()
    assert view.get_by_label("Folder on this machine").input_value().startswith("upload:")
    view.get_by_label("Maps of the chip").check()
    view.get_by_role("button", name="Calibrate", exact=True).click()
    view.get_by_role("heading", name="Relative response (PRNU)").wait_for()
    view.locator(".chip-map canvas[tabindex]").first.focus()
    page.keyboard.press("ArrowDown")
    assert "Row 33, column 32" in view.locator(".chip-map .plot-value").first.inner_text()
    view.get_by_role("button", name="Copy as Python").click()
    page.wait_for_selector("#code[open]")
    assert "maps=True" in page.inner_text("#code-text")


def test_several_settings_are_calibrated_and_one_is_chosen(page, link, axe) -> None:
    opened(page, link, "calibrate")
    view = page.locator("#view-calibrate")
    view.get_by_label("Folder on this machine").select_option("modes")
    view.get_by_role("heading", name="2 settings").wait_for()
    view.get_by_label("Maps of the chip").check()
    view.get_by_label("Also the gain of each pixel").check()
    view.get_by_label("Maps of the chip").uncheck()
    assert not view.get_by_label("Also the gain of each pixel").is_checked()
    view.get_by_role("button", name="Calibrate", exact=True).click()
    view.get_by_role("heading", name="Settings compared").wait_for()
    for row, gain in enumerate((0.5, 0.25)):
        cells = view.get_by_role("row", name=re.compile("System gain K")).nth(row).get_by_role("cell")
        low, high = (float(text) for text in cells.nth(2).inner_text().split(" to "))
        assert low < gain < high
    save(page, "calibrate-settings")
    page.evaluate(axe)
    result = page.evaluate(f"axe.run(document, {{runOnly: {json.dumps(RULES)}}})")
    assert not [(v["id"], [node["target"] for node in v["nodes"]][:3]) for v in result["violations"]]
    view.get_by_role("button", name="Choose read_mode=slow").click()
    view.get_by_role("heading", name=re.compile("12 frames of 64 × 64 pixels")).wait_for()
    view.get_by_text("What the files do not state").click()
    assert view.get_by_label("One of several settings").input_value() == "read_mode=slow"
    view.get_by_label("Black level (DN)").fill("60")
    view.get_by_label("Black level (DN)").blur()
    view.get_by_role("heading", name=re.compile("black level 60 DN")).wait_for()


def test_a_dropped_folder_is_uploaded(page, link, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "few").mkdir()
    for path in sorted((folder / "stack").iterdir())[::6]:
        shutil.copy(path, tmp_path / "few")
    (tmp_path / "few" / "notes.txt").write_text("no frame")
    opened(page, link, "calibrate")
    box = page.locator(".drop-here").bounding_box()
    place = {"x": box["x"] + 20, "y": box["y"] + 10}
    files = {"items": [], "files": [str(tmp_path / "few")], "dragOperationsMask": 1}
    driver = page.context.new_cdp_session(page)
    for kind in ("dragEnter", "dragOver", "drop"):
        driver.send("Input.dispatchDragEvent", {"type": kind, "data": files, **place})
    page.get_by_text("3 frames of few uploaded, 1 other file left out").wait_for()
    wait(page, "document.querySelectorAll('#view-calibrate .numbered tbody tr').length === 3")


def test_a_sweep_over_two_fields(page, link) -> None:
    opened(page, link, "sweep")
    view = page.locator("#view-sweep")
    assert view.locator("svg.plot rect").count() > 17 * 5
    view.locator("#sweep-results select").nth(1).select_option("curves")
    assert view.locator("svg.plot path.line").count() == 5
    with page.expect_download() as download:
        view.get_by_role("button", name="Save CSV").click()
    assert download.value.path().read_text().startswith("pixel_width_um,f_number,signal_e")


def add_values(page, view: str, label: str, *names: str) -> None:
    for name in names:
        group = page.locator(f"#view-{view}").get_by_role("group", name=label, exact=True)
        group.get_by_role("combobox").select_option(name)


def test_image_quality_is_swept(page, link, folder: Path, axe) -> None:
    """Color differences against the f-number, with intervals; a camera without a value has the reason."""
    opened(page, link, "sweep")
    view = page.locator("#view-sweep")
    view.get_by_label(re.compile("^Measure")).select_option("image_quality")
    view.get_by_role("group", name="Values").wait_for()
    view.get_by_label(re.compile("^Sensor")).select_option(label="chart.sensor.yaml")
    view.get_by_role("button", name="Compute").click()
    page.locator("#alert", has_text="values").wait_for()
    add_values(page, "sweep", "Values", "color-accuracy.delta_e_2000_mean", "edge-sfr.mtf50", "sfr-map.mtf50")
    view.get_by_role("button", name="Remove sfr-map.mtf50").click()
    add_values(page, "sweep", "Values", "contrast-detection.dynamic_range_db")
    view.get_by_label("To", exact=True).fill("8")
    page.keyboard.press("Tab")
    view.get_by_label("Values", exact=True).last.fill("3")
    page.keyboard.press("Tab")
    view.get_by_role("button", name="Compute").click()
    view.locator("svg.plot path.line").first.wait_for()
    assert page.locator("#alert").is_hidden()
    show = view.get_by_label(re.compile("^Show"))
    show.select_option("edge-sfr.mtf50.G")
    labels = view.locator("svg.plot text").all_text_contents()
    assert {"edge-sfr: MTF50, G (cycles/pixel)", "f-number"} <= set(labels)
    assert view.locator("svg.plot .bar").count() == 3
    assert "f_number = 1.4: " in view.get_by_label("Missing values").inner_text()
    save(page, "sweep-quality")
    show.select_option("color-accuracy.delta_e_2000_mean.matrix")
    view.locator("svg.plot").focus()
    page.keyboard.press("Home")
    assert re.search(r"95 %: [\d.]+ to [\d.]+", view.locator(".plot-value").inner_text())
    view.locator("summary").click()
    assert re.search(r"\([\d.]+ to [\d.]+\)", view.locator("table").inner_text())
    save(page, "sweep-quality-table")
    page.evaluate(axe)
    assert not page.evaluate(f"axe.run(document, {{runOnly: {json.dumps(RULES)}}})")["violations"]
    with page.expect_download() as download:
        view.get_by_role("button", name="Save CSV").click()
    head, first, *_ = csv.reader(download.value.path().read_text().splitlines())
    assert {"low(edge-sfr.mtf50.G)", "color-accuracy.delta_e_2000_mean.matrix, patch left out"} <= set(head)
    assert len(head) == len(first)
    view.get_by_role("button", name="Copy as command").click()
    page.wait_for_selector("#code[open]")
    assert '"image_quality"' in page.inner_text("#code-text")


def test_image_quality_is_compared(page, link, axe) -> None:
    opened(page, link, "compare")
    view = page.locator("#view-compare")
    for name in ("chart.sensor.yaml", "small.sensor.yaml"):
        view.get_by_role("checkbox", name=name).check()
    for name in ("google-pixel-4a", "nikon-d200"):
        view.get_by_role("checkbox", name=name).uncheck()
    add_values(page, "compare", "Image quality of simulated charts", "edge-sfr.mtf50", "noise.snr_18_db")
    row = view.get_by_role("row", name="edge-sfr: MTF50, G (cycles/pixel)")
    row.wait_for()
    wait(page, "document.querySelectorAll('#view-compare .badge.exact').length === 2")
    assert re.fullmatch(r"[\d.]+ \([\d.]+ to [\d.]+\)", row.get_by_role("cell").first.inner_text())
    save(page, "compare-quality")
    page.evaluate(axe)
    assert not page.evaluate(f"axe.run(document, {{runOnly: {json.dumps(RULES)}}})")["violations"]
    view.get_by_role("button", name="Copy as command").click()
    page.wait_for_selector("#code[open]")
    assert "--value edge-sfr.mtf50" in page.inner_text("#code-text")
    page.click("#code-close")
    copied = page.url
    page.goto(link.split("/?")[0] + "/#plan")
    page.goto(copied)
    page.reload()
    view.get_by_role("button", name="Remove noise.snr_18_db").click()
    wait(page, "!document.querySelector('#view-compare').innerText.includes('noise: SNR')")
    row.wait_for()


def test_sensors_are_compared_with_linked_pictures_and_code(page, link) -> None:
    opened(page, link, "compare")
    view = page.locator("#view-compare")
    view.get_by_role("checkbox", name="google-pixel-4a").uncheck()
    view.get_by_role("checkbox", name="small.sensor.yaml").check()
    view.get_by_role("columnheader", name="small.sensor.yaml").first.wait_for()
    wait(page, "document.querySelectorAll('#view-compare .badge.exact').length === 2")
    error = view.locator("tr", has=page.get_by_role("rowheader", name="Color error, mean ΔE 2000")).locator("td")
    shown = [float(text) for text in error.all_inner_texts()]
    view.get_by_role("button", name="Copy as Python").click()
    page.wait_for_selector("#code[open]")
    names: dict = {}
    exec(page.inner_text("#code-text").replace("print(", "str(").replace("found.plot()", ""), names)
    own = [facts.to_dict()["mean_delta_e_2000"] for facts in names["found"].cameras.values()]
    assert shown == pytest.approx(own, rel=1e-3)
    page.click("#code-close")
    view.get_by_role("button", name="Copy as command").click()
    page.wait_for_selector("#code[open]")
    assert "photosite cameras compare workbench-1.camera.yaml workbench-2.camera.yaml" in page.inner_text("#code-text")
    page.click("#code-close")
    view.get_by_role("button", name="Compute").click()
    wait(page, "location.hash.startsWith('#compare=')")
    copied = page.url
    page.goto(link.split("/?")[0] + "/#plan")
    page.goto(copied)
    page.reload()
    ready(page, "compare")
    assert not view.get_by_role("checkbox", name="google-pixel-4a").is_checked()


def test_sensors_are_compared_in_the_light_of_an_uploaded_spectrum(page, link, tmp_path: Path) -> None:
    opened(page, link, "compare")
    view = page.locator("#view-compare")
    error = view.locator("tr", has=page.get_by_role("rowheader", name="Color error, mean ΔE 2000"))
    before = error.inner_text()
    lamp = tmp_path / "lamp.csv"
    lamp.write_text("wavelength_nm,relative_energy\n380,6\n560,2\n780,1\n")
    page.set_input_files("#view-compare input[type=file]", str(lamp))
    view.get_by_text("s, lamp.csv").wait_for()
    assert error.inner_text() != before
    assert view.get_by_label("Light", exact=True).input_value().startswith("upload:")


def test_lenses_are_compared_and_their_pictures_move_together(page, link) -> None:
    opened(page, link, "compare")
    view = page.locator("#view-compare")
    view.get_by_label("Lenses").check()
    view.get_by_label("Scene of the pictures").select_option("siemens-star")
    view.get_by_role("button", name="Add a lens").click()
    view.get_by_role("group", name="Lens 3").get_by_label("f-number").fill("32")
    page.keyboard.press("Tab")
    view.get_by_role("columnheader", name="f/32, 50 mm").first.wait_for()
    mtf = view.locator("tr", has=page.get_by_role("rowheader", name="MTF50 of lens and pixel")).locator("td")
    values = [float(text) for text in mtf.all_inner_texts()]
    assert values == sorted(values, reverse=True)
    wait(page, "document.querySelectorAll('#view-compare .badge.exact').length === 3")
    view.locator("canvas[tabindex]").first.focus()
    page.keyboard.press("1")
    page.keyboard.press("ArrowRight")
    wait(
        page,
        """[...document.querySelectorAll('#view-compare .readout')].every(each => / DN = /.test(each.textContent))
        && new Set([...document.querySelectorAll('#view-compare .readout')].map(
            each => each.textContent.split(',').slice(0, 2).join())).size === 1""",
    )


def test_measured_frames_are_compared_with_their_simulation(page, link) -> None:
    opened(page, link, "compare")
    view = page.locator("#view-compare")
    view.get_by_label("Measured frames and their simulation").check()
    view.get_by_label("Measured frames of one scene and setting").select_option("file:chart")
    view.get_by_label("Sensor simulated").select_option(label="chart.sensor.yaml")
    view.get_by_label("f-number").fill("4")
    page.keyboard.press("Tab")
    view.get_by_role("button", name="Compare with simulation").click()
    view.get_by_text("measured and simulated agree").wait_for()
    assert view.locator("svg.plot").count() == 2
    save(page, "compare-measured")
    view.get_by_role("button", name="Copy as command").click()
    page.wait_for_selector("#code[open]")
    assert "photosite validate --measured" in page.inner_text("#code-text")
    page.click("#code-close")
    view.get_by_label("Tolerance").fill("0")
    view.get_by_label("Light level").select_option("")
    view.get_by_label("Mean luminance of the patches").fill("60")
    page.keyboard.press("Tab")
    view.get_by_role("button", name="Compare with simulation").click()
    view.get_by_text("measured and simulated differ").wait_for()


def test_a_plan_with_code(page, link) -> None:
    opened(page, link, "plan")
    page.locator("#view-plan").get_by_label("System gain K (DN/e⁻)", exact=True).fill("0.02%")
    page.keyboard.press("Tab")
    before = page.inner_text("#view-plan .card >> nth=1")
    page.locator("#view-plan").get_by_role("button", name="Compute").click()
    wait(page, "text => document.querySelectorAll('#view-plan .card')[1].innerText !== text", before)
    page.locator("#view-plan").get_by_role("button", name="Copy as Python").click()
    page.wait_for_selector("#code[open]")
    names: dict = {}
    exec(page.inner_text("#code-text").replace("print(", "str("), names)
    frames = names["plan"].protocol.frame_count
    assert f"{frames} frames" in page.inner_text("#view-plan .card >> nth=1")
    marks = page.locator("#view-plan svg.plot .mark-text").all_text_contents()
    assert {"wanted", f"planned: {frames} frames"} <= set(marks)
    page.click("#code-close")

    # Where a precision is met: at 1, between two numbers of frames of the curve.
    met = page.locator("#view-plan .key li", has_text="System gain K").inner_text()
    at = int(re.search(r"from (\d+) frames", met)[1])
    counts, ratios = precision_curves(names["plan"])
    gain = dict(zip(counts, ratios["system_gain_dn_per_e"], strict=True))
    assert max(gain[n] for n in counts if n >= at) <= 1 < min(gain[n] for n in counts if n < at)
    ring = page.locator("#view-plan svg.plot .reached.s0")
    line = page.locator("#view-plan svg.plot .mark-line").first
    assert float(ring.get_attribute("cy")) == pytest.approx(float(line.get_attribute("y1")))


@pytest.mark.parametrize("view", ["plan", "sweep"])
def test_sensor_files_of_the_folder_are_planned_and_swept(page, link, view: str) -> None:
    opened(page, link, view)
    root = page.locator(f"#view-{view}")
    root.get_by_label(re.compile("^Sensor")).select_option(label="small.sensor.yaml")
    before = page.inner_html(f"#view-{view} .card >> nth=1")
    root.get_by_role("button", name="Compute").click()
    wait(page, "([at, html]) => document.querySelectorAll(at)[1].innerHTML !== html", [f"#view-{view} .card", before])
    root.get_by_role("button", name="Copy as Python").click()
    page.wait_for_selector("#code[open]")
    assert "small.sensor.yaml" in page.inner_text("#code-text")


def test_tables_on_a_narrow_screen_are_whole_and_keep_their_roles(page, link) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    opened(page, link, "plan")
    opened(page, link, "calibrate")
    page.get_by_role("button", name="Calibrate", exact=True).click()
    page.get_by_role("heading", name="Parameters", exact=True).wait_for()
    row = page.get_by_role("row", name=re.compile("^System gain K")).first
    assert row.get_by_role("rowheader").inner_text() == "System gain K (DN/e⁻)"
    assert 0.4 < float(row.get_by_role("cell").first.inner_text()) < 0.6
    inside = """view => [...document.querySelectorAll(`#view-${view} table`)].filter(each => each.checkVisibility())
        .map(each => Math.max(...[...each.querySelectorAll('td, tbody th, td *')].map(
            cell => cell.getBoundingClientRect().right)))"""
    for view in ("calibrate", "plan"):
        page.goto(f"{link.split('/?')[0]}/#{view}")
        page.wait_for_selector(f"#view-{view} table")
        right = page.evaluate(inside, view)
        assert len(right) >= 2
        assert max(right) <= 390 - 16


def test_plots_cover_what_they_show_with_text_of_one_size(page, link) -> None:
    opened(page, link)
    for width in (390, 1024, 1600):
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_timeout(300)
        found = page.evaluate(
            """() => {
                const plot = document.querySelector('#snr-plot svg'), box = plot.getBoundingClientRect();
                const line = plot.querySelector('.line').getBoundingClientRect();
                const texts = [...plot.querySelectorAll('text')].map(each => each.getBoundingClientRect());
                return {
                    part: line.width / box.width, scale: box.width / plot.viewBox.baseVal.width,
                    cut: texts.filter(each => each.left < box.left - 1 || each.right > box.right + 1).length,
                };
            }"""
        )
        assert found["part"] > 0.7
        assert 0.85 < found["scale"] < 1.35
        assert found["cut"] == 0


def test_an_invalid_field_is_named_and_nothing_is_computed(page, link) -> None:
    opened(page, link, "plan")
    asked: list = []
    page.on("request", lambda request: request.url.split("?")[0].endswith("/api/plan") and asked.append(request))
    view, alert = page.locator("#view-plan"), page.locator("#alert")
    gain = view.get_by_label("System gain K (DN/e⁻)", exact=True)
    for label, wrong in (
        ("Longest dark frame (s)", "0"),
        ("Longest flat field (s)", ""),
        ("System gain K (DN/e⁻)", "often"),
        ("System gain K (DN/e⁻)", "0%"),
    ):
        box = view.get_by_label(label, exact=True)
        before = box.input_value()
        box.fill(wrong)
        view.get_by_role("button", name="Compute").click()
        assert alert.inner_text().startswith(f"{label}: ")
        assert page.evaluate("document.activeElement.value") == wrong
        box.fill(before)
    for name in ("Remove System gain K", "Remove PRNU"):
        view.get_by_role("button", name=name).click()
    view.get_by_role("button", name="Compute").click()
    assert alert.inner_text().startswith("Add a parameter: ")
    view.get_by_label("Add a parameter").select_option(label="System gain K (DN/e⁻)")
    assert not asked
    gain.fill("1 %")
    view.get_by_role("button", name="Compute").click()
    wait(page, "document.querySelector('#view-plan .key, #view-plan svg.plot .mark-text') !== null")
    assert len(asked) == 1
    assert alert.is_hidden()


def test_image_quality_of_frames(page, link, folder: Path) -> None:
    """Frames of the served folder, and one that is uploaded, are measured in place of simulated ones."""
    opened(page, link, "quality")
    frames = page.locator("#view-quality select").first
    frames.select_option("file:chart")
    wait(page, "document.querySelector('#view-quality input[max=\"64\"]') === null")
    page.locator("#view-quality .card").nth(1).locator("select").first.select_option("macbeth")
    assert page.locator("#view-quality").get_by_label("f-number").count() == 0
    page.locator("#view-quality").get_by_role("button", name="Measure", exact=True).click()
    wait(page, "document.querySelector('#view-quality [role=status]').textContent.startsWith('computed')")
    assert page.locator("#view-quality h3").count() > 3
    save(page, "quality-measured")
    page.locator("#view-quality input[type=file]").first.set_input_files(folder / "chart" / "1.dng")
    wait(page, "document.querySelector('#view-quality select').selectedOptions[0].textContent === '1.dng'")
    page.locator("#view-quality").get_by_role("button", name="Measure", exact=True).click()
    wait(page, "document.querySelector('#view-quality [role=status]').textContent.startsWith('computed')")
    frames.select_option("")
    wait(page, "document.querySelector('#view-quality input[max=\"64\"]') !== null")
    assert page.locator("#view-quality").get_by_label("f-number").count() == 1
