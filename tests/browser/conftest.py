"""A server of the workbench and Chromium; tests are skipped with a message where something is missing."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
AXE = Path(os.environ.get("AXE", ROOT / ".venv" / "axe" / "node_modules" / "axe-core" / "axe.min.js"))
SWITCHES = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The served folder: a small sensor, a picture, and frames of a calibration."""
    import numpy as np

    import photosite as ps
    from photosite.develop.develop import save_picture
    from photosite.frames.raw_frame import RawFrame

    found = tmp_path_factory.mktemp("served")
    ps.load_sensor("vendor-2.2um").with_(name="Small", rows=130, cols=194).save(found / "small.sensor.yaml")
    shade = np.linspace(0, 1, 90, dtype=np.float32)
    save_picture(np.stack(np.broadcast_arrays(shade[:60, None], shade, np.float32(0.4)), axis=2), found / "picture.png")
    small = ps.load_sensor("nikon-d200").with_(name="Chart", rows=264, cols=392, black_level_dn=64)
    small.save(found / "chart.sensor.yaml")
    (found / "chart").mkdir()
    camera = ps.Camera(ps.DiffractionLimited(4, 50), small.with_(serial="measured"))
    for seed in (1, 2):
        camera.capture(ps.charts.macbeth("A", 40), 1 / 20, seed=seed).save(found / "chart" / f"{seed}.dng")
    noise = np.random.default_rng(3)
    (found / "stack").mkdir()
    for kind, time_ms in [("dark", 10), *(("flat", t) for t in (10, 20, 30, 40))]:
        for number in range(3):
            electrons = 0 if kind == "dark" else noise.poisson(100 * time_ms, (64, 64))
            dn = np.uint16(64.5 + 0.5 * electrons + noise.normal(0, 2, (64, 64)))
            RawFrame(dn, bits=12).save(found / "stack" / f"{kind}_{time_ms}ms_{number}.png")
    (found / "modes").mkdir()
    for mode, gain in (("fast", 0.5), ("slow", 0.25)):
        for kind, time_ms in [("dark", 10), *(("flat", t) for t in (10, 20, 30))]:
            for number in range(3):
                electrons = 0 if kind == "dark" else noise.poisson(100 * time_ms, (64, 64))
                dn = np.uint16(64.5 + gain * electrons + noise.normal(0, 2, (64, 64)))
                frame = RawFrame(dn, bits=12, metadata={"read_mode": mode})
                frame.save(found / "modes" / f"{kind}_{time_ms}ms_{mode}_{number}.tif")
    return found


@pytest.fixture(scope="session")
def link(folder: Path) -> Iterator[str]:
    """The link that `photosite serve` prints."""
    pytest.importorskip("fastapi", reason="the extra app is not installed")
    command = [sys.executable, "-m", "photosite", "serve", str(folder), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdout is not None
        try:
            yield json.loads(server.stdout.readline())["link"]
        finally:
            server.terminate()
            server.wait(20)


@pytest.fixture(scope="session")
def browser() -> Iterator[object]:
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="Playwright is missing: make test-browser installs it"
    )
    path = next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
    )
    if path is None:
        pytest.skip("Chromium is missing: apt-get install chromium")
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=path, args=SWITCHES)
        yield found
        found.close()


@pytest.fixture
def page(browser, link: str, request: pytest.FixtureRequest) -> Iterator[object]:
    """A page of its own profile; errors of scripts and requests to other hosts fail the test."""
    context = browser.new_context(viewport={"width": 1600, "height": 1000}, permissions=["clipboard-write"])
    opened, problems = context.new_page(), []
    base = link.split("/?")[0]
    opened.on("pageerror", lambda error: problems.append(str(error)))
    opened.on("console", lambda message: message.type == "error" and problems.append(message.text))
    opened.on("request", lambda request: request.url.startswith((base, "blob:")) or problems.append(request.url))
    opened.set_default_timeout(180_000)
    yield opened
    context.close()
    if request.node.get_closest_marker("refused"):  # the browser reports answers with an error, too
        problems = [text for text in problems if "422" not in text and "503" not in text]
    assert not problems


@pytest.fixture(scope="session")
def axe() -> str:
    """The source of axe-core."""
    if not AXE.exists():
        pytest.skip("axe-core is missing: make test-browser installs it")
    return AXE.read_text(encoding="utf-8")
