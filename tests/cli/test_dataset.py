"""`photosite dataset`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import photosite as ps


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    codes = np.random.default_rng(1).integers(0, 256, (60, 80, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.png")
    return tmp_path / "a.png"


def test_pairs_of_pictures_and_charts(photosite: Any, picture: Path, tmp_path: Path) -> None:
    call = ["dataset", picture, "macbeth", "--sensor", "vendor-2.2um", "--crop", "32x48", "--crops", 2, "--draws", 2]
    call += ["--exposure", "1/1000:1/30", "--illuminant", "A", "--illuminant", "5000K", "--flips", "--seed", 5]
    call += ["--f-number", 2.8, "--focal-length", 4, "--chips", 3, "--pairs-per-shard", 3, "--license", "CC0 1.0"]
    done = photosite(*call, "-o", tmp_path / "pairs", "--json")
    assert done.status == 0
    assert (done.json["pairs"], done.json["shards"], done.json["rows"], done.json["cols"]) == (8, 3, 32, 48)
    stored = ps.training.ShardDataset(tmp_path / "pairs")
    facts = [pair.metadata for pair in stored]
    assert {fact["scene"] for fact in facts} >= {"a"}
    assert all(1 / 1000 <= fact["exposure_s"] <= 1 / 30 for fact in facts)
    assert {fact["serial"] for fact in facts} <= {"0", "1", "2"}
    assert json.loads((tmp_path / "pairs" / "manifest.json").read_text())["license_of_inputs"] == "CC0 1.0"
    (tmp_path / "pairs" / "shard-000001.h5").unlink()
    again = [photosite(*call, "-o", tmp_path / "pairs", "--json").json["shards_written"] for _ in range(2)]
    assert [done.json["shards_written"], *again] == [3, 1, 0]
    once_more = photosite(*call, "-o", tmp_path / "pairs")
    assert once_more.status == 0
    assert once_more.out.startswith("checked 8 pairs of 32 x 48 pixels in 3 shards ")


@pytest.mark.smoke("dataset")
def test_pairs_of_raw_frames_and_electrons(photosite: Any, tmp_path: Path) -> None:
    np.save(tmp_path / "e.npy", np.full((16, 16), 500.0, np.float32))
    call = ["--sensor", "vendor-2.2um", "--crop", "16x16", "--crops", 1]
    of_arrays = photosite("dataset", tmp_path / "e.npy", "--inputs-are", "electrons", *call, "-o", tmp_path / "a")
    assert of_arrays.status == 0
    sensor = ps.load_sensor("vendor-2.2um").with_(rows=32, cols=32)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    camera.expose(np.full((32, 32), 500.0, np.float32), 0.01).save(tmp_path / "a.dng")
    raw = ["dataset", tmp_path / "a.dng", "--inputs-are", "raw", *call, "--input-sensor", "vendor-2.2um"]
    assert photosite(*raw, "--light", "0.5", "--format", "webdataset", "-o", tmp_path / "b").status == 0
    assert ps.training.ShardDataset(tmp_path / "b")[0].metadata["own_shot"] == 0.5
    refused = photosite(*raw, "--light", "0.5:2", "-o", tmp_path / "c")
    assert refused.status == 2
    assert "--light must be at most 0.998" in refused.err


def test_bad_calls(photosite: Any, picture: Path, tmp_path: Path) -> None:
    for more, message in (
        (["--crop", "512"], "--crop must be ROWSxCOLS, such as 512x512, got '512'"),
        (["--crop", "33x32"], "--crop must be multiples of the filter array's tile"),
        (["--exposure", "1:1/2"], "--exposure must be a range"),
        (["--optics", "missing.yaml"], "missing.yaml"),
        (["a.npy"], "a.npy: an array of numbers is not a scene. Add --inputs-are electrons"),
    ):
        done = photosite("dataset", picture, "--crop", "32x32", *more, "-o", tmp_path / "pairs")
        assert done.status == 2
        assert message in done.err
        assert not (tmp_path / "pairs").exists()
