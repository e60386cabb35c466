"""Time and memory of the workbench in Chromium: slider to picture, first load, and ten tabs at once.

    python benchmarks/workbench.py [--moves 40] [--tabs 10]

Each slider moves by one step at a time, as by a key; the time is from the event to the picture drawn on the canvas. The
sensor is the D200 with 10 megapixels, the picture 900 x 600 pixels on the screen. Needs Playwright and Chromium.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

SWITCHES = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
]
SLIDERS = ("f-number", "Mean luminance", "Exposure", "Read noise")
TIMES = "performance.getEntriesByName('slider-to-picture').map(entry => entry.duration)"


def megabytes(pid: int) -> float:
    """Return the proportional memory of a process and its children in MB (Linux)."""
    total = 0.0
    for line in subprocess.run(
        ["ps", "-eo", "pid,ppid"], capture_output=True, text=True, check=True
    ).stdout.splitlines()[1:]:
        child, parent = map(int, line.split())
        if parent == pid:
            total += megabytes(child)
    rollup = Path(f"/proc/{pid}/smaps_rollup")
    try:
        kilobytes = next(int(line.split()[1]) for line in rollup.read_text().splitlines() if line.startswith("Pss:"))
    except OSError:
        kilobytes = 0
    return total + kilobytes / 1024


MOVES = """async ([slider, count]) => {
    const times = () => performance.getEntriesByName('slider-to-picture');
    slider.closest('details').open = true;
    performance.clearMeasures();
    for (let number = 0; number < count; number++) {
        slider.value = Number(slider.value) + (number % 20 < 10 ? 1 : -1);
        slider.dispatchEvent(new Event('input', { bubbles: true }));
        while (times().length <= number) await new Promise(requestAnimationFrame);
    }
    return times().map(entry => entry.duration);
}"""


def moves(page: Page, label: str, count: int) -> list[float]:
    """Move a slider step by step, each after the last picture, and return the times in ms.

    The page moves it, because the messages of a driver that moves it and polls would take processor time.
    """
    slider = page.get_by_label(f"{label} slider").first.element_handle()
    found: list[float] = page.evaluate(MOVES, [slider, count])
    return found


def quantiles(times: list[float]) -> str:
    return f"p50 {np.percentile(times, 50):4.0f} ms, p95 {np.percentile(times, 95):4.0f} ms of {len(times)}"


def main() -> None:
    """Run the measurement and print its results."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--moves", type=int, default=40)
    parser.add_argument("--tabs", type=int, default=10)
    options = parser.parse_args()
    command = [sys.executable, "-m", "photosite", "serve", "--json"]
    path = shutil.which("chromium") or shutil.which("google-chrome")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            measure(server, options, path)
        finally:
            server.terminate()


def measure(server: subprocess.Popen[str], options: argparse.Namespace, path: str | None) -> None:
    """Measure a server."""
    with sync_playwright() as driver:
        assert server.stdout is not None
        begun = time.perf_counter()
        link = json.loads(server.stdout.readline())["link"]
        print(f"server answers after {time.perf_counter() - begun:.1f} s on {os.cpu_count()} cores")
        browser = driver.chromium.launch(executable_path=path, args=SWITCHES)
        page = browser.new_page(viewport={"width": 1280, "height": 968})
        page.goto(link)
        page.wait_for_selector("#badge.exact, #badge.preview", timeout=90_000)
        print(f"first picture {time.perf_counter() - begun:.1f} s after the command")
        page.wait_for_selector("#badge.exact", timeout=120_000)
        print("picture on screen: " + page.evaluate("`${picture.width} x ${picture.height}`"))
        begun = time.perf_counter()
        page.reload()
        page.wait_for_selector("#badge.exact, #badge.preview", timeout=90_000)
        print(f"page loaded again, with picture: {time.perf_counter() - begun:.2f} s")
        for view in ("whole frame", "single pixels"):
            if view == "single pixels":
                page.click("#zoom-one")
                page.wait_for_timeout(500)
            for label in SLIDERS:
                moves(page, label, 5)
                print(f"{view}, {label}: {quantiles(moves(page, label, options.moves))}")
        print(f"memory of the server and its processes: {megabytes(server.pid):.0f} MB")
        pages = [page, *(browser.new_page(viewport={"width": 1280, "height": 968}) for _ in range(options.tabs - 1))]
        for other in pages[1:]:
            other.context.add_cookies(page.context.cookies())
            other.goto(link.split("/?")[0])
        for other in pages[1:]:
            other.wait_for_selector("#badge.exact, #badge.preview", timeout=120_000)
        times: list[float] = []
        for number in range(6):  # all tabs at once: a key press in each, then the pictures
            for other in pages:
                other.evaluate("performance.clearMeasures()")
                other.get_by_label("f-number slider").focus()
                other.keyboard.press("ArrowRight" if number % 2 else "ArrowLeft")
            for other in pages:
                while not other.evaluate(f"{TIMES}.length"):
                    other.wait_for_timeout(10)
                times += other.evaluate(TIMES)[:1]
        print(f"{len(pages)} tabs at once: {quantiles(times)}; memory {megabytes(server.pid):.0f} MB")
        browser.close()


if __name__ == "__main__":
    main()
