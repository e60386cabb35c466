"""The documentation: names and files that exist, every public name, and examples of file formats that load."""

from __future__ import annotations

import inspect
import operator
import re
import shlex
from collections.abc import Iterable
from pathlib import Path

import click
import numpy as np
import pytest
from public_names import public_names

import photosite as ps
from photosite.calibration.spectral.protocol import open_spectral
from photosite.camera.file import load_camera
from photosite.cli.main import cli
from photosite.frames.raw_frame import RawFrame
from photosite.studies.chart_spectral import read_chart

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.mark.parametrize("page", ["development/contributing.md", "theory/model.md", "development/design-notes.md"])
def test_files_that_a_page_names_exist(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    named = {name for name in re.findall(r"`([\w./-]+\.(?:py|yaml))`", text) if "NAME" not in name}
    folders = ROOT / "src" / "photosite", ROOT
    missing = sorted(name for name in named if not any((folder / name).exists() for folder in folders))
    assert not missing


def test_files_that_pages_link_exist() -> None:
    missing = []
    for page in [ROOT / "README.md", *DOCS.rglob("*.md")]:
        if {"_build", "gallery"}.isdisjoint(page.parts):
            linked = re.findall(r"\]\(([^)#\s]+)[^)\s]*\)", page.read_text(encoding="utf-8"))
            missing += [
                (page.name, to)
                for to in linked
                if not re.search(r"://|gallery/", to) and not (page.parent / to).exists()
            ]
    assert not missing


def commands_on(page: Path) -> Iterable[list[str]]:
    """Yield the commands on a page, in code blocks and in backticks, as words up to a comment, pipe, ; or --."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    for line in re.findall(r"^(?: {4}|!)(photosite .*)|`(photosite [^`\n]+)`", text, re.MULTILINE):
        words = shlex.shlex("".join(line).split(" 2>")[0], posix=True, punctuation_chars="|;&>")
        words.whitespace_split = True
        words.commenters = "#"
        found = list(words)
        end = next((k for k, word in enumerate(found) if word == "--" or set(word) <= set("|;&>")), len(found))
        yield found[1:end]


def test_commands_on_pages_have_the_options_that_they_name() -> None:
    wrong, count = [], 0
    pages = (page for page in DOCS.rglob("*.md") if {"_build", "gallery"}.isdisjoint(page.parts))
    for page in (ROOT / "README.md", *pages):
        if page.name in ("shell-completion.md", "changelog.md", "design-notes.md"):
            continue
        for words in commands_on(page):
            count += 1
            command, rest = cli, list(words)
            while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
                command = command.get_command(click.Context(command), rest.pop(0))
            known = {flag for parameter in (command.params if command else ()) for flag in parameter.opts}
            options = {word.split("=")[0] for word in rest if re.match(r"--?[a-z]", word)}
            if command is None or options - known - {"--help", "-h"}:
                wrong.append((page.name, words))
    assert not wrong
    assert count > 100


def documented() -> list[str]:
    text = (DOCS / "reference" / "api.rst").read_text(encoding="utf-8")
    return re.findall(r"^   photosite\.([\w.]+)$", text, re.MULTILINE)


def test_the_page_of_names_lists_the_public_names() -> None:
    rows = re.findall(
        r"^\| ([^|]+) \| (`[^|]+) \|$", (DOCS / "reference" / "names.md").read_text("utf-8"), re.MULTILINE
    )
    prefix = {subject: f"{subject[4:-1]}." if subject.startswith("`ps.") else "" for subject, _ in rows}
    listed = [prefix[subject] + name for subject, names in rows for name in re.findall(r"`(\w+)`", names)]
    assert len(listed) == len(set(listed))
    assert set(listed) == public_names()


def test_the_reference_lists_every_public_name() -> None:
    constants = {name for name in public_names() if name.rpartition(".")[2].isupper()}
    assert set(documented()) >= public_names() - constants


def test_every_public_name_has_a_docstring_with_an_example() -> None:
    public = public_names() & set(documented())
    assert not [name for name in public if ">>>" not in (inspect.getdoc(operator.attrgetter(name)(ps)) or "")]


# Formats: the examples of a page load, and its tables name every field.


def example(page: str, language: str = "yaml", number: int = 0) -> str:
    text = (DOCS / "formats" / f"{page}.md").read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)[number]


def fields_in_tables(page: str) -> set[str]:
    rows = [
        line.split("|")[1:3]
        for line in (DOCS / "formats" / f"{page}.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    return {name for row in rows for cell in row for name in re.findall(r"`(\w+)`", cell)}


def write_frames(folder: Path, names: Iterable[str], level: int = 900) -> None:
    noise = np.random.default_rng(1)
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        dn = noise.integers(level, level + 20, (16, 16)).astype(np.uint16)
        RawFrame(dn, bits=12, cfa=(("R", "G"), ("G", "B"))).save(folder / name)


def test_the_example_of_a_camera_file_loads(tmp_path: Path) -> None:
    from photosite.camera.file import _KEYS, _SCENE_KEYS

    (tmp_path / "a.camera.yaml").write_text(example("camera"))
    set_up = load_camera(tmp_path / "a.camera.yaml")
    assert set_up.exposure_s == 1 / 60
    assert set_up.camera.optics.f_number == 4
    assert fields_in_tables("camera") >= {*_KEYS, *_SCENE_KEYS, "alpha"}


def test_the_example_of_an_optics_file_loads(tmp_path: Path) -> None:
    from photosite.optics.io.design_index import _File, _Index
    from photosite.optics.io.optics_file import (
        KINDS,
        DistortionSection,
        Glare,
        LateralColorSection,
        OpticsModel,
        PupilSection,
        RelativeIllumination,
    )

    (tmp_path / "a.optics.yaml").write_text(example("optics"))
    lens = ps.load_optics(tmp_path / "a.optics.yaml")
    assert lens.veiling_glare.spread_m == pytest.approx(3e-3)
    assert lens.blur.coefficients == {8: 50, 11: -20}
    models = [OpticsModel, RelativeIllumination, DistortionSection, LateralColorSection, Glare, *KINDS.values()]
    names = {name for model in [*models, _File, _Index] for name in model.model_fields} - {"kind"}
    text = (DOCS / "formats" / "optics.md").read_text(encoding="utf-8")
    assert names <= fields_in_tables("optics")
    assert all(f"`{name}`" in text for name in PupilSection.model_fields)


def test_the_example_of_a_measurement_protocol_loads(tmp_path: Path) -> None:
    from photosite.frames.io.protocol import _FRAME_KEYS, _KEYS

    (tmp_path / "protocol.yaml").write_text(example("measurement-protocol"))
    write_frames(tmp_path, ("dark/1.png", "dark/2.png"), 64)
    write_frames(tmp_path, ("flat/a.png", "flat/b.png", "iso400/1.png"))
    ps.load_sensor("nikon-d200").with_(rows=16, cols=16, black_level_dn=64).save(tmp_path / "nikon-d200.sensor.yaml")
    frames = ps.open_frames(tmp_path / "protocol.yaml")
    assert {(group.kind, len(group)) for group in frames.groups} == {("dark", 2), ("light", 2), ("light", 1)}
    assert frames.gain_settings[-1] == 400 or 400 in frames.gain_settings
    assert fields_in_tables("measurement-protocol") >= {*_KEYS, *_FRAME_KEYS}


def test_the_examples_of_spectral_protocols_load(tmp_path: Path) -> None:
    from photosite.calibration.spectral.protocol import _Band, _Bands
    from photosite.studies.chart_spectral import _ChartProtocol, _Light

    sensor = ps.load_sensor("nikon-d200").with_(rows=16, cols=16, black_level_dn=64)
    sensor.save(tmp_path / "mine.sensor.yaml")
    (tmp_path / "diode.csv").write_text("wavelength_nm,responsivity_a_per_w\n380,0.1\n780,0.5\n")
    write_frames(tmp_path, ("dark/1.png", "dark/2.png"), 64)
    write_frames(tmp_path, ("400/1.png", "410/1.png"))
    (tmp_path / "bands.yaml").write_text(example("spectral-protocol"))
    bands = open_spectral(tmp_path / "bands.yaml").bands
    assert [band.passband.centre_nm for band in bands] == pytest.approx([400, 410])

    sensor = sensor.with_(rows=66, cols=98)
    sensor.save(tmp_path / "mine.sensor.yaml")
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    for light in ("A", "D65"):
        (tmp_path / light.lower()).mkdir()
        camera.capture(ps.charts.macbeth(light, 40), 1 / 5).save(tmp_path / light.lower() / "1.dng")
    (tmp_path / "chart.yaml").write_text(example("spectral-protocol", number=1))
    views, _ = read_chart(tmp_path / "chart.yaml")
    assert views.wavelength_nm.tolist() == list(range(400, 701, 20))
    names = {name for model in (_Bands, _Band, _ChartProtocol, _Light) for name in model.model_fields}
    assert names <= fields_in_tables("spectral-protocol")


def test_the_example_of_a_scene_file_loads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(example("scene-files", "python"), {})
    scene = ps.read_scene("field.h5")
    assert scene.shape == (6, 8)
    assert scene.radiance(5, 7) == pytest.approx(np.full(31, 1e15))


def test_the_example_of_a_sweep_file_loads(tmp_path: Path) -> None:
    from photosite.studies.sweep_file import _Measure, _SensorFigures, _Snr, _SweepFile, load_sweep

    (tmp_path / "a.sweep.yaml").write_text(example("sweep"))
    wanted = load_sweep(tmp_path / "a.sweep.yaml")
    assert [len(entries) for entries in wanted.values.values()] == [5, 3]
    assert wanted.camera.optics.f_number == 2.8
    names = {name for model in (_SweepFile, _Snr, _SensorFigures) for name in model.model_fields}
    assert names <= fields_in_tables("sweep")
    assert all(f"Settings of `{name}`" in (DOCS / "formats" / "sweep.md").read_text() for name in _Measure.model_fields)
