"""Shards appear whole or not at all; an interrupted folder is completed to the same bytes."""

from __future__ import annotations

import hashlib
import json
import pickle
import signal
import subprocess
import sys
import tarfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from killed_writers import kill_while_writing
from process_groups import members
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.training import Electrons, PairDataset, RawFrames, Scenes, ShardDataset, write_shards
from photosite.training.digest import sha256_of

RAMP = np.linspace(0, 3000, 64 * 64, dtype=np.float32).reshape(64, 64)
SENSOR = ps.load_sensor("vendor-2.2um").with_(rows=64, cols=64)


def dataset(**settings: Any) -> PairDataset:
    return PairDataset(Electrons([RAMP]), SENSOR, **{"crop": (16, 32), "crops": 5, "draws": 2} | settings)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("shard_format", ["hdf5", "webdataset"])
def test_shards_hold_the_pairs(shard_format: Any, tmp_path: Path) -> None:
    pairs, seen = dataset(), []
    manifest = write_shards(
        pairs, tmp_path, shard_format=shard_format, pairs_per_shard=4, report=lambda *done: seen.append(done)
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]
    stored = ShardDataset(tmp_path)
    assert len(stored) == 10
    for one, other in zip(stored, pairs, strict=True):
        assert (one.clean == other.clean).all()
        assert (one.noisy == other.noisy).all()
        assert one.noisy.dtype == other.noisy.dtype
        assert one.metadata == other.metadata
    listed = json.loads(manifest.read_text())["shards"]
    assert [entry["pairs"] for entry in listed] == [4, 4, 2]
    if shard_format == "webdataset":
        with tarfile.open(tmp_path / "shard-000002.tar") as tar:
            assert tar.getnames()[:3] == ["0000000008.clean.npy", "0000000008.noisy.npy", "0000000008.json"]


def test_a_broken_off_folder_is_completed_to_the_same_bytes(tmp_path: Path) -> None:
    whole, part = tmp_path / "whole", tmp_path / "part"
    write_shards(dataset(), whole, pairs_per_shard=2)

    def stop(done: int, count: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_shards(dataset(), part, pairs_per_shard=2, report=stop)
    with pytest.raises(FileError):
        ShardDataset(part)
    left = kill_while_writing(part / "shard-000002.h5")
    first = (part / "shard-000000.h5").stat().st_mtime_ns
    write_shards(dataset(), part, pairs_per_shard=2)
    assert contents(part) == contents(whole)
    assert not left.exists()
    assert (part / "shard-000000.h5").stat().st_mtime_ns == first


_SCRIPT = """
import sys
from test_shards_script import big
from photosite.training import write_shards
if __name__ == "__main__":
    write_shards(big(), sys.argv[1], pairs_per_shard=2, processes=2)
"""
_MODULE = """
import numpy as np
import photosite as ps
from photosite.training import Electrons, PairDataset
def big():
    sensor = ps.load_sensor("vendor-2.2um").with_(rows=256, cols=256)
    return PairDataset(Electrons([np.full((256, 256), 500.0)]), sensor, draws=200)
"""


@pytest.mark.slow
def test_a_killed_writer_leaves_whole_shards_and_is_resumed(tmp_path: Path) -> None:
    (tmp_path / "test_shards_script.py").write_text(_MODULE)
    (tmp_path / "write.py").write_text(_SCRIPT)
    folder = tmp_path / "pairs"
    process = subprocess.Popen([sys.executable, str(tmp_path / "write.py"), str(folder)], start_new_session=True)
    while len(list(folder.glob("shard-*"))) < 5:
        time.sleep(0.01)
        assert process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.wait()
    deadline = time.monotonic() + 20
    while members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not members(process.pid), "the workers outlive their killed parent"
    left = len(list(folder.glob("shard-*")))
    assert 5 <= left < 100
    subprocess.run([sys.executable, str(tmp_path / "write.py"), str(folder)], check=True)
    again = tmp_path / "again"
    subprocess.run([sys.executable, str(tmp_path / "write.py"), str(again)], check=True)
    assert contents(folder) == contents(again)
    assert len(ShardDataset(folder)) == 200


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    write_shards(dataset(), tmp_path / "a", pairs_per_shard=5)
    before = contents(tmp_path / "a")
    changed = PairDataset(Electrons([RAMP]), SENSOR.with_(serial="7"), crop=(16, 32), crops=5, draws=2)
    for other, settings, name, value in (
        (dataset(seed=2), {}, "seed", 2),
        (dataset(crops=3), {}, "crops", 3),
        (dataset(), {"shard_format": "webdataset"}, "shard_format", "webdataset"),
        (changed, {}, "dataset.sensors[0].serial", "7"),
    ):
        with raises(FileError, name, value=value):
            write_shards(other, tmp_path / "a", pairs_per_shard=5, **settings)
    assert contents(tmp_path / "a") == before
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "photo.jpg").write_bytes(b"")
    with pytest.raises(FileError) as caught:
        write_shards(dataset(), tmp_path / "b")
    assert caught.value.what.startswith("holds 'photo.jpg'")
    with raises(InputError, "pairs_per_shard"):
        write_shards(dataset(), tmp_path / "c", pairs_per_shard=0)


def test_the_changed_input_is_named(tmp_path: Path) -> None:
    file = tmp_path / "light.npy"
    np.save(file, RAMP)
    write_shards(PairDataset(Electrons([str(file)]), SENSOR, crop=(16, 32)), tmp_path / "a")
    np.save(file, RAMP[::-1])
    with pytest.raises(FileError) as caught:
        write_shards(PairDataset(Electrons([str(file)]), SENSOR, crop=(16, 32)), tmp_path / "a")
    assert str(file) in caught.value.what


@pytest.mark.parametrize("is_new", [True, False])
def test_an_error_before_the_first_shard_leaves_nothing(tmp_path: Path, is_new: bool) -> None:
    folder = tmp_path / "a"
    if not is_new:
        folder.mkdir()
    np.save(tmp_path / "light.npy", np.full(RAMP.shape, np.nan))
    with pytest.raises(InputError):
        write_shards(PairDataset(Electrons([str(tmp_path / "light.npy")]), SENSOR, crop=(16, 32)), folder)
    assert folder.exists() != is_new
    assert is_new or not list(folder.iterdir())


def test_a_folder_without_shards_takes_other_settings(tmp_path: Path) -> None:
    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_shards(dataset(seed=2), tmp_path / "a", pairs_per_shard=20, report=stop)
    (tmp_path / "a" / "shard-000000.h5").unlink()
    write_shards(dataset(), tmp_path / "a", pairs_per_shard=5)
    write_shards(dataset(), tmp_path / "b", pairs_per_shard=5)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_a_shard_that_has_changed_is_not_accepted(tmp_path: Path) -> None:
    write_shards(dataset(), tmp_path, pairs_per_shard=5)
    before = contents(tmp_path)
    shard = tmp_path / "shard-000000.h5"
    whole = bytearray(shard.read_bytes())
    whole[-1] ^= 1
    shard.write_bytes(whole)
    with pytest.raises(FileError) as caught:
        write_shards(dataset(), tmp_path, pairs_per_shard=5)
    assert caught.value.path == str(shard)
    shard.unlink()
    write_shards(dataset(), tmp_path, pairs_per_shard=5)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("damage", ["cut", "pairs of another shard"])
@pytest.mark.parametrize("shard_format", ["hdf5", "webdataset"])
def test_a_damaged_shard_is_not_accepted_without_a_manifest(shard_format: Any, damage: str, tmp_path: Path) -> None:
    def write() -> None:
        write_shards(dataset(), tmp_path, shard_format=shard_format, pairs_per_shard=4)

    write()
    (tmp_path / "manifest.json").unlink()
    first, shard, _ = sorted(tmp_path.glob("shard-*"))
    whole = shard.read_bytes()
    shard.write_bytes(whole[: len(whole) // 2] if damage == "cut" else first.read_bytes())
    with pytest.raises(FileError) as caught:
        write()
    assert caught.value.path == str(shard)
    shard.unlink()
    write()
    assert shard.read_bytes() == whole


@pytest.mark.parametrize(
    "source",
    [
        lambda name: Electrons([np.ones((8, 8)), name]),
        lambda name: RawFrames([name]),
        lambda name: Scenes(["macbeth", name], ps.DiffractionLimited(2.8, 4)),
    ],
)
def test_a_missing_input_is_an_error_at_once(source: Any, tmp_path: Path) -> None:
    with pytest.raises(FileError) as caught:
        source(str(tmp_path / "none.png"))
    assert caught.value.path == str(tmp_path / "none.png")


def test_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    with raises(FileError, "there is no such folder"):
        ps.training.ShardDataset(tmp_path / "nosuch")


def test_the_card_says_what_the_pairs_are(tmp_path: Path) -> None:
    lens = ps.DiffractionLimited(f_number=2.8, focal_length_mm=4)
    pairs = PairDataset(
        Scenes(["macbeth"], lens, illuminants=("A", "D65")), SENSOR, crop=(16, 16), exposure_s=(0.01, 0.1), light=0.5
    )
    write_shards(pairs, tmp_path / "scenes", license="CC0 1.0")
    card = (tmp_path / "scenes" / "CARD.md").read_text()
    for text in (
        "1 pairs of 16 x 16",
        "| Vendor 2.2 um |",
        "1/100 to 1/10 s",
        "Illuminants: A, D65",
        "CC0 1.0",
        "- macbeth",
    ):
        assert text in card
    write_shards(dataset(), tmp_path / "other")
    assert "License: not stated" in (tmp_path / "other" / "CARD.md").read_text()


@pytest.mark.parametrize("shard_format", ["hdf5", "webdataset"])
def test_a_shard_that_is_not_the_manifests_is_an_error(shard_format: Any, tmp_path: Path) -> None:
    manifest = write_shards(dataset(), tmp_path, shard_format=shard_format, pairs_per_shard=5)
    listed = json.loads(manifest.read_text())["shards"][1]
    shard = tmp_path / listed["file"]
    whole = shard.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    for content, what in ((whole[:3000], "bytes"), (whole + b"0", "bytes"), (bytes(flipped), "sha256")):
        shard.write_bytes(content)
        stored = ShardDataset(tmp_path)
        stored[4]  # of the other shard
        with pytest.raises(FileError) as caught:
            stored[5]
        error, found = caught.value, {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        assert (error.path, error.what, error.value) == (str(shard), what, found[what])
        assert str(listed[what]) in (error.expected or "")
        assert error.hint
    shard.unlink()
    with pytest.raises(FileError) as caught:
        ShardDataset(tmp_path)[5]
    assert caught.value.path == str(shard)
    write_shards(dataset(), tmp_path, shard_format=shard_format, pairs_per_shard=5)
    assert shard.read_bytes() == whole


def test_a_shard_is_checked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_shards(dataset(), tmp_path, pairs_per_shard=5)
    stored, read = ShardDataset(tmp_path), []
    monkeypatch.setattr("photosite.training.shards.sha256_of", lambda path: read.append(path.name) or sha256_of(path))
    for index in (0, 4, 9, 1, 5):
        stored[index]
    pickle.loads(pickle.dumps(stored))[2]
    assert read == ["shard-000000.h5", "shard-000001.h5"]
