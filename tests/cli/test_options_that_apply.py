"""Options that do not apply to the other arguments are one line with exit status 2, before anything is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_files import darktable_content, rawtoaces_content, write_json

import photosite as ps

PLAN = ("plan", "--rows", "20", "--cols", "20")
"""Each call, the option that is refused, and what it does or does not apply to."""
CALLS = [
    (("dataset", "e.npy", "--inputs-are", "electrons", "-o", "out", "--illuminant", "A"), "--inputs-are scenes"),
    (("dataset", "e.npy", "--inputs-are", "electrons", "-o", "out", "--f-number", "2"), "--inputs-are scenes"),
    (("dataset", "a.dng", "--inputs-are", "raw", "-o", "out", "--white", "5"), "--inputs-are scenes"),
    (("dataset", "a.dng", "--inputs-are", "raw", "-o", "out", "--no-lens-blur"), "--inputs-are scenes"),
    (("dataset", "e.npy", "--inputs-are", "electrons", "-o", "out", "--averaged", "4"), "--inputs-are raw"),
    (("dataset", "macbeth", "-o", "out", "--input-sensor", "nosuch"), "--inputs-are raw"),
    (("develop", "a.dng", "-o", "out.png", "--color", "G"), "--polarization"),
    (("develop", "a.dng", "-o", "out.png", "--polarization", "degree", "--demosaic", "menon"), "--polarization"),
    (("develop", "a.dng", "-o", "out.png", "--polarization", "degree", "--brightness", "2"), "--polarization"),
    (("compare", "patches.csv", "--case", "d200"), "JSON files"),
    (("compare", "patches.csv", "--variable", "x"), "MATLAB files"),
    (("compare", "patches.csv", "--unit", "e"), "MATLAB files and raw files"),
    (("compare", "patches.csv", "--black-level", "1"), "MATLAB files and raw files"),
    (("compare", "patches.csv", "patches.csv", "--illuminant", "D65"), "a simulation"),
    (("compare", "patches.csv", "patches.csv", "--set-up", "nosuch.json"), "a simulation"),
    (("cameras", "show", "d3", "--profiles", "noiseprofiles.json", "--sensor", "1e300"), "-o"),
    (("cameras", "show", "d850", "--profiles", "spectra.json", "--mono"), "a noise profile"),
    (("export", "nikon-d200", "libcamera", "-o", "out.json", "--pixel-gain"), "maps"),
    (("export", "nikon-d200", "smap", "-o", "out.mat", "--pixel-gain"), "a sensor"),
    (("export", "nikon-d200", "libcamera", "-o", "out.json", "--maker", "Acme"), "the format darktable"),
    (("export", "nikon-d200", "darktable", "-o", "out.json", "--target", "pisp"), "the format libcamera"),
    (("export", "nikon-d200", "libcamera", "-o", "out.json", "--sensor", "nosuch"), "a sensor"),
    (("export", "nikon-d200", "libcamera", "-o", "out.json", "--cfa", "rggb"), "a sensor"),
    (("import", "a.dng", "--mono"), "files of darktable"),
    (("import", "a.dng", "--model", "x"), "files of darktable"),
    ((*PLAN, "--want", "prnu_percent=2%", "--level", "3"), "--protocol and --step"),
    ((*PLAN, "--protocol", "paper-d200", "--longest-dark", "1"), "--want"),
    ((*PLAN, "--step", "dark:1:2", "--longest-flat", "1"), "--want"),
    (("polarizers", ".", "--sensor", "nosuch"), "-o"),
    (("simulate", "--rows", "8", "--cols", "8", "-o", "out.dng", "--bin-kind", "sum"), "--bin"),
    (("spectral", "nosuch.yaml", "--beside", "nosuch"), "--figure"),
    (("bench", "--workers", "--quick"), "--workers"),
    (("bench", "--workers", "--case", "noise_d200"), "--workers"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("inputs")
    np.save(made / "e.npy", np.full((8, 8), 500.0, np.float32))
    frame = ps.RawFrame(np.full((24, 24), 100, np.uint16), bits=12, cfa=(("R", "G"), ("G", "B")))
    frame.save(made / "a.dng")
    (made / "patches.csv").write_text("patch,R_e,G_e,B_e\nwhite,3,4,5\n")
    write_json(made / "noiseprofiles.json", darktable_content())
    write_json(made / "spectra.json", rawtoaces_content())
    return made


@pytest.mark.parametrize(("call", "what"), CALLS, ids=lambda value: " ".join(value) if isinstance(value, tuple) else "")
def test_an_option_that_does_not_apply(
    photosite: Any, folder: Path, monkeypatch: pytest.MonkeyPatch, call: tuple[str, ...], what: str
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    done = photosite(*call)
    assert (done.status, done.out, done.err.count("\n")) == (2, "", 1)
    option = [word for word in call if word.startswith("--")][-1]
    assert done.err.startswith(f"photosite: {option} ")
    assert what in done.err
    assert sorted(folder.iterdir()) == before
