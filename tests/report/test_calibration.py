from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.calibration.result import Calibration
from photosite.errors import FileError
from photosite.frames.frame_set import FrameSource
from photosite.report.calibration import write_calibration_report
from photosite.report.tables import correlation_table


@pytest.fixture(scope="module", params=["loop", "darks_only"])
def calibration(request: pytest.FixtureRequest):
    found = request.getfixturevalue(request.param)
    return found if request.param == "darks_only" else found.calibration


@pytest.fixture(scope="module")
def page(calibration, read_page, tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_calibration_report(calibration, path)
    return read_page(path.read_text(encoding="utf-8"))


def without_figures(calibration: Calibration) -> Calibration:
    """The same numbers; its page is written in a moment."""
    return replace(calibration, curves={}, snr={}, linearity={}, general={}, spatial={}, base=None)


def test_page_needs_no_other_file(page) -> None:
    tags = {tag for tag, _ in page.elements}
    assert not tags & {"script", "link", "iframe", "object", "embed"}
    assert all(address.startswith("#") for address in page.values("href"))
    assert all(source.startswith("data:image/") for source in page.values("src"))
    assert "srcset" not in {name for _, attributes in page.elements for name in attributes}
    for drawing in page.images("image/svg+xml"):
        root = ElementTree.fromstring(drawing)
        for element in root.iter():
            for name, value in element.attrib.items():
                if name.endswith("href"):
                    assert value.startswith("#"), value
                assert "url(http" not in value


def test_style_sheet_fetches_nothing() -> None:
    import photosite.report

    css = (Path(photosite.report.__path__[0]) / "templates" / "page.css").read_text()
    assert "url(" not in css
    assert "@import" not in css


def test_every_parameter_is_there_once_with_its_value_or_its_reason(calibration, page) -> None:
    by_channel = 0 if not calibration.channels else len(calibration.channels)
    reasons = {(row[0], row[1]): row[2] for row in page.rows if len(row) == 3}
    values = {(row[0], row[2]): row for row in page.rows if len(row) == 5 and row[0] != "Parameter"}
    assert by_channel in (0, 3)
    shown: Counter[tuple[str, str]] = Counter()
    for name, estimate in calibration.estimates().items():
        key = PARAMETER_LABELS[name].label, PARAMETER_LABELS[name].unit
        if estimate.value is None:
            assert reasons[key] == estimate.reason
            assert estimate.reason
        else:
            assert values[key][4] == estimate.method
            assert values[key][1]
        shown[key] += 1
    assert set(shown.values()) == {1}, "two parameters of one name and unit cannot be told apart"


def test_numbers_shown_are_those_estimated(loop, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    entry = replace(loop.calibration.read_noise_mv, value=0.51987, standard_uncertainty=0.0031, interval_95=None)
    write_calibration_report(replace(without_figures(loop.calibration), read_noise_mv=entry), path)
    row = next(r for r in read_page(path.read_text(encoding="utf-8")).rows if r[::2][:2] == ["Read noise", "mV"])
    assert row[1] == "0.5199 ± 0.0031"
    assert row[3].split() == ["0.5138", "to", "0.5259"]


def test_warnings_rejected_frames_and_digests_are_there(loop, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    nasty = tuple(f'warning <{n}> & "so" on' for n in range(30))
    left_out = ("a<b>.tif repeats c.tif",)
    calibration = replace(without_figures(loop.calibration), warnings=nasty, rejected=left_out, source="<i>here</i>")
    write_calibration_report(calibration, path)
    page = read_page(path.read_text(encoding="utf-8"))
    for text in nasty:
        assert text[1:] in page.text
    assert "18 more warnings" in page.text
    assert "a<b>.tif repeats c.tif" in page.text
    assert "<i>here</i>" in page.text
    assert "i" not in {tag for tag, _ in page.elements}
    for digest in calibration.frames_sha256:
        assert digest in page.text


def test_frames_of_a_virtual_camera_are_said_to_be(loop, read_page, tmp_path: Path) -> None:
    for virtual in (True, False):
        path = tmp_path / f"{virtual}.html"
        write_calibration_report(without_figures(loop.calibration), path, virtual_camera=virtual)
        assert ("made by a virtual camera" in read_page(path.read_text(encoding="utf-8")).text) is virtual


def test_same_calibration_gives_the_same_bytes_whatever_the_users_settings(loop, tmp_path: Path) -> None:
    write_calibration_report(loop.calibration, tmp_path / "one.html")
    with matplotlib.rc_context({"font.size": 23.0, "svg.hashsalt": None, "axes.grid": False, "svg.fonttype": "none"}):
        before = dict(matplotlib.rcParams)
        write_calibration_report(loop.calibration, tmp_path / "two.html")
        assert dict(matplotlib.rcParams) == before, "the user's settings are as they were"
    one, two = ((tmp_path / name).read_bytes() for name in ("one.html", "two.html"))
    assert one == two
    assert not re.search(rb"20\d\d-\d\d-\d\d", one), "no date"


def test_darks_alone_have_the_figures_of_darks_and_no_empty_ones(darks_only, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_calibration_report(darks_only, path)
    page = read_page(path.read_text(encoding="utf-8"))
    figures = [attributes["alt"] for tag, attributes in page.elements if tag == "img"]
    bands = "points and fitted lines with 95 % bands"
    assert figures == [f"Dark signal: {bands}", f"Dark temporal variance: {bands}"]
    assert page.text.count("Not shown: No light frames.") == 4, "response, photon transfer, noise, linearity"
    assert "none: all frames are dark ones" in page.text


def test_curve_of_one_point_has_no_figure(darks_only, read_page, tmp_path: Path) -> None:
    found = darks_only.curves["M"]["dark_signal"]
    single = replace(found, **{name: getattr(found, name)[:1] for name in ("x", "y", "y_uncertainty", "used")})
    path = tmp_path / "report.html"
    write_calibration_report(replace(darks_only, curves={"M": {"dark_signal": single}}), path)
    page = read_page(path.read_text(encoding="utf-8"))
    assert page.values("src") == []
    assert "Not shown: Darks at one exposure only" in page.text


def test_every_figure_says_in_words_what_it_shows(page) -> None:
    shown = [attributes["alt"] for tag, attributes in page.elements if tag == "img"]
    assert len(shown) == len(set(shown)) > 1
    assert all(len(words.split()) > 3 for words in shown)


def test_tables_have_captions_and_heads(page) -> None:
    tags = [tag for tag, _ in page.elements]
    assert tags.count("caption") == tags.count("table") > 4
    scopes = {attributes.get("scope") for tag, attributes in page.elements if tag == "th"}
    assert scopes == {"col", "row", "rowgroup"}


def test_sections_follow_the_data_sheet(loop, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_calibration_report(loop.calibration, path)
    assert read_page(path.read_text(encoding="utf-8")).values("id") == [
        "data-sheet",
        "warnings-and-frames-left-out",
        "sensitivity",
        "photon-transfer",
        "signal-to-noise-ratio",
        "linearity",
        "general-model",
        "dark-current",
        "noise-in-the-dark",
        "non-uniformity",
        "defects",
        "2008-paper",
        "all-parameters",
        "channels",
        "provenance",
        "how-to-read-this-report",
    ]


def test_each_frame_stands_beside_its_digest(loop, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_calibration_report(without_figures(loop.calibration), path)
    rows = {tuple(row) for row in read_page(path.read_text(encoding="utf-8")).rows if len(row) == 2}
    for frame in loop.calibration.frames_used[::7]:
        digest = hashlib.sha256(np.ascontiguousarray(frame.source.read(), "<u2").data).hexdigest()
        assert any(name and frame.name.endswith(name) and found == digest for name, found in rows)


def test_frames_that_are_gone_are_said_to_be(darks_only, read_page, tmp_path: Path) -> None:
    def gone() -> np.ndarray:
        raise FileError("dark-7.tif", "is not there any more")

    frame = replace(darks_only.frames_used[0], source=FrameSource("dark-7.tif", gone))
    path = tmp_path / "report.html"
    write_calibration_report(replace(darks_only, frames_used=(frame,)), path)
    page = read_page(path.read_text(encoding="utf-8"))
    assert "The frames could not be hashed: dark-7.tif: is not there any more." in page.text


def test_page_is_light(loop, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_calibration_report(loop.calibration, path)
    assert path.stat().st_size < 2_500_000


def test_correlations_are_those_of_the_covariance(loop) -> None:
    table = correlation_table(loop.calibration)
    titles = [column.title for column in table.columns]
    row = next(row for row in table.rows if row[0] == "Temporal dark noise")
    joint = loop.calibration.covariance.among(["system_gain_dn_per_e", "temporal_dark_noise_e"])
    expected = joint[0, 1] / np.sqrt(joint[0, 0] * joint[1, 1])
    assert float(row[titles.index("K")].replace("−", "-")) == pytest.approx(expected, abs=0.005)
    assert row[titles.index("σd")] == ""
    assert expected < -0.5, "electrons are numbers over the gain"
