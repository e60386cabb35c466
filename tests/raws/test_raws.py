"""The table of `make test-raws`, on frames that photosite wrote: one measurement, one file that is none."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from photosite.frames.raw_frame import RawFrame

sys.path.insert(0, str(Path(__file__).parent))
import raw_folder


def _measurement(folder: Path) -> None:
    """Frames of a gain of 0.25 DN/e- and a read noise of 2 DN."""
    rng = np.random.default_rng(3)
    folder.mkdir()
    for exposure_s in (0.01, 0.02, 0.04):
        for kind, electrons in (("dark", 0.0), ("light", 1e5 * exposure_s)):
            for number in range(2):
                dn = 64 + 0.25 * rng.poisson(electrons, (40, 60)) + rng.normal(0, 2, (40, 60))
                frame = RawFrame(np.rint(dn).astype(np.uint16), bits=12, exposure_s=exposure_s, black_level_dn=64)
                frame.save(folder / f"{kind}_{exposure_s * 1e3:g}ms_{number}.dng")


def test_a_folder_of_raw_frames(tmp_path: Path) -> None:
    _measurement(tmp_path / "stack")
    (tmp_path / "cut.nef").write_bytes(b"II*\0" + bytes(40))
    rows = raw_folder.check(tmp_path, most_files=2)
    status = {row.path: row.status for row in rows}
    assert status == {"cut.nef": "refused", os.path.join("stack", "dark_10ms_0.dng"): "ok", "stack/": "ok"}
    calibrated = next(row.result for row in rows if row.path == "stack/")
    gain = float(calibrated.split("gain ")[1].split()[0])
    assert abs(gain - 0.25) < 0.02  # 2400 pixels and 6 flat fields give 2 %


def test_the_table_to_send_has_levels_and_noise_and_no_names(tmp_path: Path) -> None:
    _measurement(tmp_path / "secret stack")
    RawFrame(np.zeros((40, 60), np.uint16), bits=12, exposure_s=0.01).save(tmp_path / "dark_clipped.png")
    (tmp_path / "secret.nef").write_bytes(b"II*\0" + bytes(40))
    shown = raw_folder.table(raw_folder.check(tmp_path), tmp_path)
    assert "secret" not in shown
    assert str(tmp_path) not in shown
    cells = [[cell.strip() for cell in line.strip("| ").split("|")] for line in shown.splitlines()]
    lines = {(line[0], line[1]): line for line in cells if len(line) == 2 + len(raw_folder.HEADINGS)}
    stack = lines["12", "DNG (.dng)"]
    low, high = map(float, stack[9].split(" to "))
    assert 1.9 < low <= high < 2.15  # 2 DN and rounding; 2400 pixels: 1.4 %
    assert stack[4:9] == ["40 x 60", "12", "M", "64", "4095"]
    assert lines["1", "PNG (.png)"][9] == "0 (100% are 0)"
    assert lines["1", "camera raw (.nef)"][10].startswith("refused: ")
    assert "- 12 frames; gain 0.2" in shown


def test_an_unexpected_exception_is_an_error() -> None:
    def broken(path: Path) -> str:
        raise KeyError(path.name)

    assert raw_folder.attempt(broken, Path("a")) == ("error", "KeyError: 'a'", ("",))
