"""Names of files: nothing outside the served folder is read, and uploads are limited."""

from __future__ import annotations

import errno
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.app.files import listed
from photosite.app.places import Places, inside
from photosite.app.state import SensorState, changed_sensor
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame

OUTSIDE = [
    *(
        "../secret.sensor.yaml",
        "inner/../../secret.sensor.yaml",
        "/etc/passwd",
        "//server/share/x",
        "\\\\server\\share",
    ),
    *("C:/windows", "C:secret", "..", ".", "", "inner//mine.sensor.yaml", "inner/./mine.sensor.yaml", "~/x", "a\0b"),
    *("%2e%2e/secret.sensor.yaml", "..%2fsecret.sensor.yaml", "..\\secret.sensor.yaml", "link.sensor.yaml"),
    *(
        "up/secret.sensor.yaml",
        "inner/mine.sensor.yaml:stream",
        "/proc/self/environ",
        "x" * 5000,
        "file:x",
        "\uff0e\uff0e/x",
    ),
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_no_name_leads_out_of_the_folder(served: Path, client, name: str) -> None:
    with pytest.raises(InputError):
        inside(served, name)
    for part in ({"sensor": {"source": f"file:{name}"}}, {"scene": f"file:{name}"}):
        if "sensor" in part or name:
            answer = client.post("/api/form", json=part)
            assert answer.status_code in (200, 422)
            assert "secret" not in str(answer.json().get("sensor", ""))
    state = {"sensor": {"source": f"file:{name}"}, "lens": {}, "scene": {}}
    assert client.post("/api/view", json={"state": state}).status_code == 422
    state = {"lens": {"source": name or "x"}}
    assert client.post("/api/view", json={"state": state}).status_code == 422


def test_a_state_names_no_path_by_itself(served: Path, client) -> None:
    path = str(served.parent / "secret.sensor.yaml")
    for state in (
        {"sensor": {"source": path}},
        {"scene": {"source": path}},
        {"lens": {"source": path}},
        {"scene": {"illuminant": str(served.parent / "lamp.csv")}},
        {"sensor": {"changes": {"maps": {"file": path, "sha256": "0" * 64}}}},
    ):
        assert client.post("/api/view", json={"state": state}).status_code == 422, state


@pytest.mark.parametrize("name", ["../secret.sensor.yaml", "0123456789abcdef/../x", "0123456789abcdef/x", "", "/x"])
def test_no_name_of_a_result_leads_out_of_the_results(served: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "results" / "0123456789abcdef").mkdir(parents=True)
    (tmp_path / "x").write_text("secret")
    with pytest.raises(InputError):
        Places(folder=served, results=tmp_path / "results").path(f"result:{name}")
    with pytest.raises(InputError):
        Places(folder=served).path(f"result:{name}")


def test_only_yaml_that_names_its_format_is_listed(tmp_path: Path) -> None:
    ps.load_sensor("nikon-d200").save(tmp_path / "mine.yaml")
    ps.Lens(ps.DiffractionLimited(4, 50)).save(tmp_path / "fast.yaml")
    (tmp_path / "protocol.yaml").write_text("photosite_protocol: 1\nsensor: mine.yaml\n")
    assert [entry.name for entry in listed(tmp_path, "sensor")] == ["mine.yaml"]
    assert [entry.name for entry in listed(tmp_path, "lens")] == ["fast.yaml"]


def test_files_of_the_folder_are_listed_and_read(served: Path, client) -> None:
    assert [entry["name"] for entry in client.get("/api/files?kind=sensor").json()] == ["inner/mine.sensor.yaml"]
    found = changed_sensor(SensorState(source="file:inner/mine.sensor.yaml"), Places(folder=served))
    assert found.name == "Mine"


def test_an_upload_is_checked_and_can_be_used(client, tmp_path: Path) -> None:
    path = tmp_path / "my sensor.sensor.yaml"
    ps.load_sensor("nikon-d200").with_(name="Uploaded", rows=48, cols=64).save(path)
    answer = client.post("/api/uploads?kind=sensor&name=../my sensor.sensor.yaml", content=path.read_bytes())
    stored = answer.json()
    assert answer.status_code == 201
    assert (stored["holds"], stored["file_name"]) == ("Uploaded", "my_sensor.sensor.yaml")
    form = client.post("/api/form", json={"sensor": {"source": stored["name"]}}).json()
    assert form["sensor"][0]["fields"][0]["value"] == 48


@pytest.mark.parametrize(
    ("name", "content", "status"),
    [
        ("x.exe", b"MZ", 422),
        ("x", b"", 422),
        ("x.sensor.yaml", b"photosite_sensor: 1\nname: [", 422),
        ("x.sensor.yaml", b"a" * ((1 << 20) + 1), 413),
        ("..", b"", 422),
    ],
)
def test_bad_uploads_are_refused_and_deleted(client, workbench, name: str, content: bytes, status: int) -> None:
    folder = workbench.folder / "uploads"
    before = set(folder.rglob("*")) if folder.exists() else set()
    answer = client.post("/api/uploads", params={"kind": "sensor", "name": name}, content=content)
    assert answer.status_code == status
    assert answer.json()["error"]
    left = {path for path in (set(folder.rglob("*")) if folder.exists() else set()) - before if path.is_file()}
    assert not left


def test_a_damaged_scene_is_refused(client) -> None:
    rng = np.random.default_rng(1)
    for suffix in (".png", ".h5", ".exr", ".tif", ".mat"):
        content = rng.integers(0, 256, 3000, np.uint8).tobytes()
        assert client.post(f"/api/uploads?kind=scene&name=x{suffix}", content=content).status_code == 422, suffix


def test_a_full_disk_is_an_error_of_the_upload(client, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "mkdir", full)
    answer = client.post("/api/uploads?kind=sensor&name=x.sensor.yaml", content=b"x")
    assert answer.status_code == 422
    assert os.strerror(errno.ENOSPC) in answer.json()["error"]


def frame_bytes(tmp_path: Path) -> bytes:
    path = tmp_path / "frame.png"
    RawFrame(np.full((6, 8), 64, np.uint16), bits=12).save(path)
    return path.read_bytes()


def test_frames_are_uploaded_to_one_folder(client, workbench, tmp_path: Path) -> None:
    content = frame_bytes(tmp_path)
    first = client.post("/api/uploads?kind=frames&name=stack/dark_10ms_0.png", content=content).json()
    assert first["holds"] == "6 x 8 pixels"
    rest = {"kind": "frames", "folder": first["name"]}
    names = ["flat_10ms_0.png", "../../flat_20ms_0.png", "a/b/../c/flat_30ms_0.png", "/etc/flat_40ms_0.png"]
    for name in names:
        assert client.post("/api/uploads", params=rest | {"name": name}, content=content).status_code == 201, name
    folder = workbench.places.path(first["name"])
    stored = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.png"))
    assert stored == [
        *("c/flat_30ms_0.png", "etc/flat_40ms_0.png", "flat_10ms_0.png", "flat_20ms_0.png", "stack/dark_10ms_0.png")
    ]
    assert not list(folder.parent.parent.glob("*.png"))


@pytest.mark.parametrize("name", ["protocol.yaml", "x.csv", "x.exe", ".png", "..", ""])
def test_an_uploaded_folder_holds_frames_only(client, tmp_path: Path, name: str) -> None:
    answer = client.post("/api/uploads", params={"kind": "frames", "name": name}, content=frame_bytes(tmp_path))
    assert answer.status_code == 422
    assert answer.json()["error"]


def test_frames_that_cannot_be_read_are_refused_and_deleted(client, workbench, tmp_path: Path) -> None:
    good = client.post("/api/uploads?kind=frames&name=dark_10ms_0.png", content=frame_bytes(tmp_path)).json()
    rest = {"kind": "frames", "folder": good["name"]}
    damaged = np.random.default_rng(1).integers(0, 256, 3000, np.uint8).tobytes()
    for name in ("dark_10ms_1.png", "dark.dng", "dark.h5", "dark.fits", "dark.nef"):
        assert client.post("/api/uploads", params=rest | {"name": name}, content=damaged).status_code == 422, name
    twice = client.post("/api/uploads", params=rest | {"name": "dark_10ms_0.png"}, content=frame_bytes(tmp_path))
    assert twice.status_code == 422
    assert [path.name for path in workbench.places.path(good["name"]).iterdir()] == ["dark_10ms_0.png"]


@pytest.mark.parametrize("folder", ["upload:0000000000000000", "file:inner", "inner/mine.sensor.yaml", "../x"])
def test_frames_are_uploaded_to_no_other_folder(client, served: Path, tmp_path: Path, folder: str) -> None:
    rest = {"kind": "frames", "folder": folder, "name": "a.png"}
    assert client.post("/api/uploads", params=rest, content=frame_bytes(tmp_path)).status_code == 422
    assert not list(served.rglob("a.png"))


@pytest.mark.skipif(sys.platform != "linux", reason="names of any bytes, and pipes")
def test_names_that_cannot_be_asked_for_are_not_listed(tmp_path: Path) -> None:
    for name in (b"a.csv", b"\xff\x1b[31m.csv", b"a\nb.csv", b"folder"):
        (tmp_path / os.fsdecode(name)).mkdir() if name == b"folder" else (tmp_path / os.fsdecode(name)).touch()
    os.symlink(tmp_path / "folder", tmp_path / "link")
    os.mkfifo(tmp_path / "pipe.csv")
    os.mkfifo(tmp_path / "pipe.sensor.yaml")
    assert [entry.name for entry in listed(tmp_path, "lamp")] == ["a.csv"]
    assert [entry.name for entry in listed(tmp_path, "folder")] == ["folder"]
    assert listed(tmp_path, "sensor") == []


def test_only_files_of_results_are_sent(client, workbench) -> None:
    folder = workbench.folder / "results" / ("0" * 16)
    folder.mkdir(parents=True)
    (folder / "report.html").write_text("<p>result</p>")
    (workbench.folder / "results" / "secret").write_text("x")
    answer = client.get(f"/api/results/{'0' * 16}/report.html")
    assert (answer.status_code, answer.text) == (200, "<p>result</p>")
    assert answer.headers["content-disposition"].startswith("attachment")
    (folder / ".calibration.pickle").write_bytes(b"kept")
    for path in (
        f"{'0' * 16}/other",
        f"{'0' * 16}/.calibration.pickle",
        f"{'1' * 16}/report.html",
        "../secret",
        f"{'0' * 16}/..%2f..%2fsecret",
        "x/y",
    ):
        assert client.get(f"/api/results/{path}").status_code in (404, 422), path


def test_the_limit_of_uploads_holds_for_parallel_ones_and_uploads_can_be_deleted(
    client, workbench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import photosite.app.server as server

    monkeypatch.setattr(server, "_MOST_UPLOADS", len(workbench.uploads) + 2)
    path = tmp_path / "x.sensor.yaml"
    ps.load_sensor("nikon-d200").with_(rows=48, cols=64).save(path)
    content = path.read_bytes()

    def send(_: object):
        return client.post("/api/uploads?kind=sensor&name=x.sensor.yaml", content=content)

    with client, ThreadPoolExecutor(6) as threads:
        monkeypatch.setattr(workbench, "close", lambda: None)
        answers = list(threads.map(send, range(6)))
        assert sorted(answer.status_code for answer in answers) == [201, 201, 422, 422, 422, 422]
        first, second = (answer.json()["name"] for answer in answers if answer.status_code == 201)
        listed = {each["name"]: each for each in client.get("/api/uploads").json()}
        assert {"kind": "sensor", "file_name": "x.sensor.yaml", "holds": "Nikon D200"}.items() <= listed[first].items()
        stored = workbench.places.path(first)
        assert client.delete(f"/api/uploads/{first.removeprefix('upload:')}").status_code == 204
        assert not stored.parent.exists()
        assert client.delete(f"/api/uploads/{first.removeprefix('upload:')}").status_code == 422
        assert listed.keys() - {each["name"] for each in client.get("/api/uploads").json()} == {first}
        assert client.post("/api/form", json={"sensor": {"source": first}}).status_code == 422
        assert workbench.places.path(second).is_file()
        assert send(None).status_code == 201


def test_an_uploaded_folder_of_frames_can_be_deleted(client, workbench, tmp_path: Path) -> None:
    content = frame_bytes(tmp_path)
    name = client.post("/api/uploads?kind=frames&name=a/dark_10ms_0.png", content=content).json()["name"]
    folder = workbench.places.path(name)
    rest = {"kind": "frames", "folder": name, "name": "dark_10ms_1.png"}
    assert client.post("/api/uploads", params=rest, content=content).status_code == 201
    (found,) = [each for each in client.get("/api/uploads").json() if each["name"] == name]
    assert (found["kind"], found["bytes"], found["holds"][:9]) == ("frames", 2 * len(content), "2 frames,")
    assert client.delete(f"/api/uploads/{name.removeprefix('upload:')}").status_code == 204
    assert not folder.exists()
    assert client.post("/api/uploads", params=rest, content=content).status_code == 422
    assert not folder.exists()


def test_names_are_cut_by_bytes(client, tmp_path: Path) -> None:
    for letter in ("\u00e9", "\u5149", "\U00020000"):
        params = {"kind": "frames", "name": letter * 150 + "/" + letter * 40 + ".png"}
        answer = client.post("/api/uploads", params=params, content=frame_bytes(tmp_path))
        assert answer.status_code == 201, answer.text
        assert 90 < len(answer.json()["file_name"].encode()) <= 100 or letter == "\u00e9"


def test_errors_of_uploads_name_the_file_of_the_user(client, workbench) -> None:
    damaged = {"mine.sensor.yaml": "sensor", "mine.optics.yaml": "lens", "mine.csv": "lamp", "mine.png": "scene"}
    for name, kind in damaged.items():
        answer = client.post("/api/uploads", params={"kind": kind, "name": name}, content=b"name: [")
        assert answer.status_code == 422
        assert name in answer.json()["error"]
        assert str(workbench.folder) not in answer.json()["error"]
