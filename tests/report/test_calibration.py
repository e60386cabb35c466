"""The report of a calibration: content, self-containment, reproducibility."""

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

from photosite.calibration.effect import effects
from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.calibration.result import Calibration
from photosite.errors import FileError
from photosite.frames.frame_set import FrameSource
from photosite.report.calibration import plot_sections
from photosite.report.effect import effect_figures
from photosite.report.tables import correlation_table
from photosite.values.diagnostic import Diagnostic


@pytest.fixture(scope="module")
def loop_report(loop, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the virtual D200, with all figures."""
    path = tmp_path_factory.mktemp("report") / "loop.html"
    loop.calibration.report(path)
    return path


@pytest.fixture(scope="module", params=["loop", "darks_only"])
def reported(request: pytest.FixtureRequest, read_page, tmp_path_factory: pytest.TempPathFactory):
    """A calibration and its page."""
    if request.param == "loop":
        calibration, path = request.getfixturevalue("loop").calibration, request.getfixturevalue("loop_report")
    else:
        calibration, path = request.getfixturevalue("darks_only"), tmp_path_factory.mktemp("report") / "darks.html"
        calibration.report(path)
    return calibration, read_page(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def page(reported):
    return reported[1]


def without_figures(calibration: Calibration) -> Calibration:
    """Return the same calibration without figures, whose page is written quickly."""
    return replace(calibration, curves={}, snr={}, linearity={}, general={}, spatial={}, base=None)


def test_page_is_self_contained(page) -> None:
    tags = {tag for tag, _ in page.elements}
    assert not tags & {"link", "iframe", "object", "embed"}
    assert [attributes for tag, attributes in page.elements if tag == "script"] == [{}], "one, in the page itself"
    assert all(address.startswith("#") for address in page.values("href"))
    assert all(source.startswith("data:image/") for source in page.values("src"))
    assert "srcset" not in {name for _, attributes in page.elements for name in attributes}
    for drawing in page.images("image/svg+xml"):
        assert b"dc:date" not in drawing
        assert b"<text" not in drawing, "text must be outlines, independent of installed fonts"
        root = ElementTree.fromstring(drawing)
        for element in root.iter():
            for name, value in element.attrib.items():
                if name.endswith("href"):
                    assert value.startswith("#"), value
                assert "url(http" not in value


def test_style_sheet_loads_nothing() -> None:
    import photosite.report

    css = (Path(photosite.report.__path__[0]) / "templates" / "page.css").read_text()
    assert "url(" not in css
    assert "@import" not in css


def test_every_parameter_appears_once_with_value_or_reason(reported) -> None:
    calibration, page = reported
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
    assert set(shown.values()) == {1}, "parameters must differ in name or unit"


def test_numbers_shown_are_those_estimated(loop, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    entry = replace(loop.calibration.read_noise_mv, value=0.51987, standard_uncertainty=0.0031, interval_95=None)
    replace(without_figures(loop.calibration), read_noise_mv=entry).report(path)
    row = next(r for r in read_page(path.read_text(encoding="utf-8")).rows if r[::2][:2] == ["Read noise", "mV"])
    assert row[1] == "0.5199 ± 0.0031"
    assert row[3].split() == ["0.5138", "to", "0.5259"]


def test_ids_of_diagnostics_lead_to_their_explanation(reported) -> None:
    calibration, page = reported
    links = [
        attributes["href"] for tag, attributes in page.elements if tag == "a" and "#diagnostic-" in attributes["href"]
    ]
    shown = [entry.id for entry in calibration.diagnostics if entry.severity in ("note", "warning")]
    assert links == [f"#diagnostic-{name}" for name in shown]
    anchors = {attributes["id"] for tag, attributes in page.elements if tag == "dt" and "id" in attributes}
    assert anchors == {f"diagnostic-{entry.id}" for entry in calibration.diagnostics}


def test_warnings_rejected_frames_and_digests(loop, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    nasty = tuple(f'warning <{n}> & "so" on' for n in range(30))
    rejected = ("a<b>.tif repeats c.tif",)
    found = (
        *(Diagnostic("odd", "warning", text) for text in nasty),
        *(Diagnostic("odd", "left out", text) for text in rejected),
    )
    calibration = replace(without_figures(loop.calibration), raised=found, source="<i>here</i>")
    calibration.report(path)
    page = read_page(path.read_text(encoding="utf-8"))
    for text in nasty:
        assert text[1:] in page.text
    assert "18 more warnings" in page.text
    assert "a<b>.tif repeats c.tif" in page.text
    assert "<i>here</i>" in page.text
    assert "i" not in {tag for tag, _ in page.elements}
    for digest in calibration.frames_sha256:
        assert digest in page.text


@pytest.mark.parametrize("name", ["darks_only", pytest.param("loop", marks=pytest.mark.slow)])
def test_bytes_do_not_depend_on_the_users_settings(request, name: str, tmp_path: Path) -> None:
    made = request.getfixturevalue(name)
    calibration = getattr(made, "calibration", made)
    calibration.report(tmp_path / "report.html")
    with matplotlib.rc_context({"font.size": 23.0, "svg.hashsalt": None, "axes.grid": False, "svg.fonttype": "none"}):
        before = dict(matplotlib.rcParams)
        calibration.report(tmp_path / "again.html")
        assert dict(matplotlib.rcParams) == before, "the user's settings must not change"
    content = (tmp_path / "report.html").read_bytes()
    assert content == (tmp_path / "again.html").read_bytes()
    assert not re.search(rb"20\d\d-\d\d-\d\d", content), "no date"
    assert len(content) < 2_500_000


def test_dark_frames_alone_have_no_empty_figures(darks_only, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    darks_only.report(path)
    page = read_page(path.read_text(encoding="utf-8"))
    figures = [attributes["alt"] for tag, attributes in page.elements if tag == "img"]
    bands = "points and fitted lines with 95 % bands"
    assert figures == [f"Dark signal: {bands}", f"Dark temporal variance: {bands}"]
    assert page.text.count("Not shown: No light frames.") == 4, "response, photon transfer, noise, linearity"
    assert "none; all frames are dark frames" in page.text


def test_curve_of_one_point_has_no_figure(darks_only, read_page, tmp_path: Path) -> None:
    found = darks_only.curves["M"]["dark_signal"]
    single = replace(found, **{name: getattr(found, name)[:1] for name in ("x", "y", "y_uncertainty", "used")})
    path = tmp_path / "report.html"
    replace(darks_only, curves={"M": {"dark_signal": single}}).report(path)
    page = read_page(path.read_text(encoding="utf-8"))
    assert page.values("src") == []
    assert "Not shown: Dark frames at only one exposure time" in page.text


def test_every_figure_has_an_alternative_text(page) -> None:
    shown = [attributes["alt"] for tag, attributes in page.elements if tag == "img"]
    assert len(shown) == len(set(shown)) > 1
    assert all(len(words.split()) > 3 for words in shown)


def test_tables_have_captions_and_heads(page) -> None:
    tags = [tag for tag, _ in page.elements]
    assert tags.count("caption") == tags.count("table") > 4
    scopes = {attributes.get("scope") for tag, attributes in page.elements if tag == "th"}
    assert scopes == {"col", "row", "rowgroup"}


def test_sections_follow_the_data_sheet(loop_report, read_page) -> None:
    page = read_page(loop_report.read_text(encoding="utf-8"))
    assert [attributes["id"] for tag, attributes in page.elements if tag == "section"] == [
        "data-sheet",
        "warnings-and-rejected-frames",
        "sensitivity",
        "photon-transfer",
        "signal-to-noise-ratio",
        "linearity",
        "general-model",
        "dark-current",
        "noise-in-the-dark",
        "nonuniformity",
        "rows-columns-and-readout-channels",
        "defects",
        "2008-paper",
        "all-parameters",
        "channels",
        "provenance",
        "how-to-read-this-report",
    ]


def test_each_frame_is_listed_with_its_digest(loop, read_page, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    without_figures(loop.calibration).report(path)
    rows = {tuple(row) for row in read_page(path.read_text(encoding="utf-8")).rows if len(row) == 2}
    for frame in loop.calibration.frames_used[::7]:
        digest = hashlib.sha256(np.ascontiguousarray(frame.source.read(), "<u2").data).hexdigest()
        assert any(name and frame.name.endswith(name) and found == digest for name, found in rows)


def test_missing_frames_are_reported(darks_only, read_page, tmp_path: Path) -> None:
    def gone() -> np.ndarray:
        raise FileError("dark-7.tif", "is not there any more")

    frame = replace(darks_only.frames_used[0], source=FrameSource("dark-7.tif", gone))
    path = tmp_path / "report.html"
    replace(darks_only, frames_used=(frame,)).report(path)
    page = read_page(path.read_text(encoding="utf-8"))
    assert "No digests of the frames: dark-7.tif: is not there any more." in page.text


def test_a_temporary_folder_of_frames_is_not_named(darks_only, read_page, tmp_path: Path) -> None:
    """The frames of `photosite demo` are removed, or take another name, when its report is written."""
    name = "/demo/.photosite-0f1e2d3c-4711-123456-89abcdef/frames/dark-7.tif"
    frame = replace(darks_only.frames_used[0], source=FrameSource(name, darks_only.frames_used[0].source.read))
    path = tmp_path / "report.html"
    replace(darks_only, frames_used=(frame,)).report(path)
    page = read_page(path.read_text(encoding="utf-8"))
    assert "dark-7.tif" in page.text
    assert ".photosite-" not in path.read_text(encoding="utf-8")


def test_correlations_are_those_of_the_covariance(loop) -> None:
    table = correlation_table(loop.calibration)
    titles = [column.title for column in table.columns]
    row = next(row for row in table.rows if row[0] == "Temporal dark noise")
    joint = loop.calibration.covariance.among(["system_gain_dn_per_e", "temporal_dark_noise_e"])
    expected = joint[0, 1] / np.sqrt(joint[0, 0] * joint[1, 1])
    assert float(row[titles.index("K")].replace("−", "-")) == pytest.approx(expected, abs=0.005)
    assert row[titles.index("σd")] == ""
    assert expected < -0.5, "electrons are DN divided by the gain"


def test_figures_are_of_effects_and_lie_in_sections_of_the_report(darks_only: Calibration) -> None:
    titles = {section.title for section in plot_sections(darks_only)}
    for name, figure in effect_figures().items():
        assert name in effects()
        assert figure.section in titles
