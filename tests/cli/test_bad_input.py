"""Bad input: exit status 2, one clear line, nothing written, nothing lost."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photosite as ps
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.io.protocol import Protocol, ProtocolFrames, write_protocol
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.io.sensor_file import dump_sensor, preset_names

SMALL = ("--rows", 66, "--cols", 98)


@pytest.fixture
def refused(photosite: Any, tmp_path: Path) -> Callable[..., str]:
    """Runs a command that must be refused; returns its one line."""

    def call(*arguments: object) -> str:
        before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*")}
        done = photosite(*arguments)
        assert done.status == 2, done
        assert done.out == ""
        assert done.err.startswith("photosite: ")
        assert done.err.count("\n") == 1, done.err
        assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*")} == before
        return done.err

    return call


def _frame(rows: int = 22, cols: int = 32, *, mean: float = 64, seed: int = 0, exposure_s: float = 0.01) -> RawFrame:
    noise = np.random.default_rng(seed).normal(mean, 2.5, (rows, cols))
    return RawFrame(np.clip(np.rint(noise), 0, 4095).astype(np.uint16), bits=12, exposure_s=exposure_s)


def _stack(folder: Path, frames: dict[tuple[str, float], list[RawFrame]]) -> Path:
    """Frames and their protocol."""
    entries = []
    for number, ((kind, exposure_s), group) in enumerate(frames.items()):
        for index, frame in enumerate(group):
            frame.save(folder / f"{number}_{index}.tif")
        entries.append(
            ProtocolFrames((f"{number}_*.tif",), FrameSettings("dark" if kind == "dark" else "light", exposure_s))
        )
    write_protocol(Protocol(tuple(entries)), folder / "protocol.yaml")
    return folder


@pytest.mark.parametrize("exposure", ["0", "-1", "abc", "1/0", "nan", "inf"])
def test_exposure(refused: Any, tmp_path: Path, exposure: str) -> None:
    message = refused("simulate", *SMALL, f"--exposure={exposure}", "-o", tmp_path / "shot.dng")
    assert "--exposure" in message
    assert "a number of seconds above 0" in message


@pytest.mark.parametrize("command", ["simulate", "shoot", "demo"])
def test_unknown_preset_lists_them(refused: Any, tmp_path: Path, command: str) -> None:
    message = refused(command, "--sensor", "nikon-d300", "-o", tmp_path / "out.dng")
    assert "nikon-d300" in message
    assert ", ".join(preset_names()) in message


def test_misspelt_field_names_line_and_meaning(refused: Any, tmp_path: Path) -> None:
    text = dump_sensor(ps.load_sensor("nikon-d200")).replace("fill_factor:", "fil_factor:")
    line = 1 + text.splitlines().index(next(entry for entry in text.splitlines() if "fil_factor" in entry))
    file = tmp_path / "mine.sensor.yaml"
    file.write_text(text, encoding="utf-8")
    for arguments in (["sensors", "check", file], ["simulate", *SMALL, "--sensor", file, "-o", tmp_path / "s.dng"]):
        message = refused(*arguments)
        assert f"{file}:{line}: " in message
        assert "Did you mean 'fill_factor'?" in message


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--illuminant", "D66", "Did you mean 'D65'?"),
        ("--scene", "macbet", "'macbeth'"),
        ("--luminance", "0", "above 0"),
        ("--f-number", "-8", "above 0"),
        ("--focal-length", "nan", "above 0"),
        ("--distance", "0.01", "focal length"),
        ("--black-level", "4096", "--black-level must be below"),
        ("--rows", "0", "--rows"),
        ("--flicker", "100Hz", "100Hz:0.2, 250Hz:duty=0.3 or 100Hz:table=1,2,1"),
        ("--flicker", "100Hz:1.5", "depth must be from 0 to 1"),
        ("--motion", "5", "ROWS,COLS"),
        ("--fps", "30", "at most 1 / fps"),
        ("--seed", "18446744073709551616", "--seed"),
    ],
)
def test_simulate(refused: Any, tmp_path: Path, option: str, value: str, said: str) -> None:
    message = refused("simulate", "--cols", 98, option, value, "-o", tmp_path / "shot.dng")
    assert said in message


@pytest.mark.parametrize("name", ["nowhere/shot.dng", "file/shot.dng", "shot.jpg", "."])
def test_unwritable_output(refused: Any, tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    message = refused("simulate", *SMALL, "-o", tmp_path / name)
    assert str(Path(name).name) in message


def test_preview_that_fails_leaves_no_raw_frame(refused: Any, tmp_path: Path) -> None:
    message = refused("simulate", *SMALL, "-o", tmp_path / "shot.dng", "--preview", tmp_path / "shot.gif")
    assert ".png" in message


@pytest.mark.parametrize("command", ["shoot", "demo"])
def test_unwritable_folder(refused: Any, tmp_path: Path, command: str) -> None:
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    message = refused(command, "--rows", 8, "--cols", 8, "-o", tmp_path / "file" / "out")
    assert "cannot be written" in message


@pytest.mark.parametrize("arguments", [["calibrate"], ["develop", "-o", "x.png"], ["sensors", "check"]])
def test_missing_file(refused: Any, tmp_path: Path, arguments: list[str]) -> None:
    message = refused(*arguments, tmp_path / "gone.yaml")
    assert f"{tmp_path / 'gone.yaml'}: there is no such" in message


@pytest.mark.parametrize("suffix", [".dng", ".tif", ".png"])
@pytest.mark.parametrize("keep", [0.0, 0.02, 0.5, 0.95])
def test_truncated_frame(refused: Any, tmp_path: Path, suffix: str, keep: float) -> None:
    whole = tmp_path / f"frame{suffix}"
    _frame().save(whole)
    data = whole.read_bytes()
    whole.write_bytes(data[: int(keep * len(data))])
    message = refused("develop", whole, "-o", tmp_path / "picture.png")
    assert str(whole) in message


def test_truncated_frame_of_a_stack(refused: Any, tmp_path: Path) -> None:
    darks = [_frame(seed=seed) for seed in range(3)]
    stack = _stack(tmp_path, {("dark", 0.01): darks, ("light", 0.01): [_frame(mean=900, seed=9)]})
    data = (tmp_path / "0_1.tif").read_bytes()
    (tmp_path / "0_1.tif").write_bytes(data[: len(data) // 2])
    assert "0_1.tif" in refused("calibrate", stack)


def test_missing_frame_of_a_stack(refused: Any, tmp_path: Path) -> None:
    protocol = Protocol((ProtocolFrames(("a.tif", "b.tif"), FrameSettings("dark", 0.01)),))
    _frame().save(tmp_path / "a.tif")
    write_protocol(protocol, tmp_path / "protocol.yaml")
    assert "b.tif" in refused("calibrate", tmp_path)


def test_mixed_sizes(refused: Any, tmp_path: Path) -> None:
    darks = [_frame(seed=1), _frame(cols=34, seed=2), _frame(seed=3)]
    message = refused("calibrate", _stack(tmp_path, {("dark", 0.01): darks}))
    assert "22 x 32" in message
    assert "22 x 34" in message


def test_darks_clipped_to_nothing(refused: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    black = (rng.random((6, 32, 48)) < 0.01).astype(np.uint16)  # a hundredth of the numbers above 0
    frames = {("dark", 0.01): [RawFrame(dn, bits=12) for dn in black]}
    for time_s in (0.01, 0.02):
        frames["light", time_s] = [_frame(32, 48, seed=seed, exposure_s=time_s) for seed in (1, 2)]
    stack = _stack(tmp_path, frames)
    message = refused("calibrate", stack, "--report", tmp_path / "report.html")
    assert "0 DN" in message
    assert "black level" in message
    assert not (tmp_path / "report.html").exists()


def test_exposure_in_a_protocol(refused: Any, tmp_path: Path) -> None:
    stack = _stack(tmp_path, {("dark", 0.01): [_frame(seed=seed) for seed in range(2)]})
    text = (stack / "protocol.yaml").read_text(encoding="utf-8")
    (stack / "protocol.yaml").write_text(text.replace("exposure: 1/100", "exposure: -1/100"), encoding="utf-8")
    message = refused("calibrate", stack)
    assert "protocol.yaml:3: " in message
    assert "above 0" in message


def test_sensor_file_without_a_sensor(refused: Any, tmp_path: Path) -> None:
    stack = _stack(tmp_path, {("dark", 0.01): [_frame(seed=seed) for seed in range(2)]})
    assert "--sensor" in refused("calibrate", stack, "-o", tmp_path / "mine.sensor.yaml")


def test_frames_that_cannot_be_compared(refused: Any, tmp_path: Path) -> None:
    _frame(132, 196).save(tmp_path / "a.tif")
    _frame(132, 198).save(tmp_path / "b.tif")
    assert "132 x 198" in refused("validate", tmp_path / "a.tif", tmp_path / "b.tif")


@pytest.mark.parametrize("balance", ["grey-world", "1,2", "1,x,2", "0,1,1"])
def test_white_balance(refused: Any, tmp_path: Path, balance: str) -> None:
    dn = np.full((24, 32), 700, np.uint16)
    RawFrame(dn, bits=12, cfa=(("R", "G"), ("G", "B"))).save(tmp_path / "a.tif")
    refused("develop", tmp_path / "a.tif", "-o", tmp_path / "a.png", "--white-balance", balance)
