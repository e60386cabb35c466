"""The transfers of a lens on disk: a second process does not compute them, and its frames have the same bits."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from photosite.files.cache import CACHE_VARIABLE

_FRAME = """
import sys
import numpy as np
import photosite as ps

axis = np.arange(-10, 11) * 0.8
r2 = axis[:, None] ** 2 + axis**2
sizes = np.array([[1.0, 1.3], [1.8, 1.5]])
psf = np.exp(-r2 / (2 * sizes[:, :, None, None] ** 2))
blurs = {
    "design": ps.optics.LensDesign([450.0, 600.0], psf, 0.8, [0.0, 0.0], [0.0, 0.4]),
    "wavefront": ps.optics.Wavefront({7: 40.0}),
    "table": ps.optics.PsfTable([450.0, 600.0], psf[0] / psf[0].sum(axis=(1, 2), keepdims=True), 0.8),
}
sensor = ps.load_sensor("nikon-d200").with_(rows=24, cols=32)
scene = ps.charts.macbeth("A", 40, wavelength_nm=np.linspace(400, 700, 7))
parts = set()
for name in sys.argv[2:]:
    lens = ps.Lens(ps.DiffractionLimited(4, 50), blurs[name])
    mean = ps.Camera(lens, sensor).mean_electrons(scene, 0.1, progress=lambda done, of, what: parts.add(what))
    np.save(f"{sys.argv[1]}-{name}.npy", mean)
print(*sorted(parts))
"""


def run(cache: Path | str, target: Path, *names: str) -> set[str]:
    """Compute frames in a process; return what it reported as progress."""
    environment = os.environ | {CACHE_VARIABLE: str(cache)}
    command = [sys.executable, "-c", _FRAME, str(target), *names]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return set(done.stdout.split())


def test_second_process_reads_the_same_bits(tmp_path: Path) -> None:
    names = "design", "wavefront", "table"
    first = run(tmp_path / "cache", tmp_path / "first", *names)
    second = run(tmp_path / "cache", tmp_path / "second", *names)
    without = run("off", tmp_path / "without", *names)
    # Wavelengths are reported where transfer functions are computed, transforms with every frame.
    assert first == without == {"transforms", "wavelengths"}
    assert second == {"transforms"}
    for name in names:
        frames = [np.load(tmp_path / f"{run}-{name}.npy") for run in ("first", "second", "without")]
        assert frames[0].max() > 0
        assert frames[0].tobytes() == frames[1].tobytes() == frames[2].tobytes()


def test_damaged_entries_are_computed_again(tmp_path: Path) -> None:
    run(tmp_path / "cache", tmp_path / "first", "design")
    entries = sorted((tmp_path / "cache").iterdir())
    assert len(entries) == 2  # modes and transfers
    for target in ("truncated", "flipped"):
        for path in entries:
            whole = path.read_bytes()
            middle = len(whole) // 2
            flipped = bytes([whole[middle] ^ 8]) + whole[middle + 1 :]
            path.write_bytes(whole[:middle] + (b"" if target == "truncated" else flipped))
        assert "wavelengths" in run(tmp_path / "cache", tmp_path / target, "design")
        assert (tmp_path / "first-design.npy").read_bytes() == (tmp_path / f"{target}-design.npy").read_bytes()
    assert "wavelengths" not in run(tmp_path / "cache", tmp_path / "third", "design")
