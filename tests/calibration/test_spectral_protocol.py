"""Spectral protocols: measurements read from files, and errors with lines."""

from __future__ import annotations

import re

import numpy as np
import pytest
from virtual_monochromator import MonochromatorRun

import photosite as ps
from photosite.calibration.spectral.monochromator import calibrate_spectral
from photosite.calibration.spectral.protocol import open_spectral
from photosite.errors import FileError
from photosite.studies.virtual_lab import with_pedestal


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=16, cols=16))
    run = MonochromatorRun(sensor, (500.0, 550.0, 600.0), 8.0, frames=2, dark_frames=3)
    folder = tmp_path_factory.mktemp("spectral") / "run"
    run.write(folder)
    return run, folder


def test_files_and_memory_give_the_same_result(written):
    """Files and memory give the same numbers, except for the nominal sensor's placeholder spectra."""
    run, folder = written
    read, direct = (calibrate_spectral(f) for f in (open_spectral(folder / "spectral.yaml"), run.frame_set()))
    for name in "RGB":
        one, other = read.channels[name], direct.channels[name]
        assert one.quantum_efficiency == pytest.approx(other.quantum_efficiency, rel=1e-12)
        assert one.covariance == pytest.approx(other.covariance, rel=1e-9)
    assert read.frames_sha256 == direct.frames_sha256


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("photosite_spectral: 1", "photosite_spectral: 2", ":1: photosite_spectral must be 1"),
        ("scale_uncertainty_percent: 0.5", "scale_uncertanty: 0.5", "Did you mean 'scale_uncertainty_percent'"),
        ("scale_uncertainty_percent: 0.5", "scale_uncertainty_percent: -1", "must be 0 or more, got -1"),
        ("centre_nm: 550.0", "centre_nm: x", "centre_nm must be a number"),
        ("centre_nm: 550.0", "centre_nm: 500.0", "500 nm: centre_nm must be different for each band"),
        ("bandwidth_nm: 8.0", "bandwidth_nm: 800", "bandwidth_nm must be 0 or more and below the centre"),
        ("photocurrent_a", "irradiance", "Did you mean 'irradiance_w_m2'"),
        ("{value: ", "{valu: ", "Did you mean 'value'"),
        (
            "standard_uncertainty: ",
            "standard_uncertainty: -",
            "standard_uncertainty must be a finite number, 0 or above",
        ),
        ("area_mm2: 100.0", "area_mm2: 0", "area_mm2 must be above 0, got 0"),
        ("responsivity: photodiode.csv", "responsivity: nowhere.csv", "nowhere.csv: there is no such file"),
        ("files: dark/00_*.tif", "files: dark/zz_*.tif", "no file matches"),
        ("files: dark/00_*.tif", "files: band/000_*.tif", "is listed twice"),
        ("name:", "region: [0, 8, 0, 99]\nname:", ":2: region must be inside the frames"),
        ("name:", "region: [0, 8, 0]\nname:", "region must be [first row"),
        ("name:", "bits: 14\nname:", "bits must be 12, as the file states, got 14"),
    ],
)
def test_errors_name_the_file_and_the_problem(written, old, new, message):
    _, folder = written
    text = (folder / "spectral.yaml").read_text()
    assert old in text
    broken = folder / "broken.yaml"
    broken.write_text(text.replace(old, new))
    with pytest.raises(FileError, match=re.escape(message)):
        open_spectral(broken)


def test_region(written):
    """The signal of the whole is the mean of its left and right half."""
    _, folder = written
    text = (folder / "spectral.yaml").read_text()
    found = []
    for region in ("[0, 16, 0, 16]", "[0, 16, 0, 8]", "[0, 16, 8, 16]"):
        (folder / "part.yaml").write_text(text.replace("name:", f"region: {region}\nname:"))
        found.append(calibrate_spectral(open_spectral(folder / "part.yaml")).channels["R"].band_mean)
    assert found[0] == pytest.approx((found[1] + found[2]) / 2, rel=1e-12)
    assert not np.allclose(found[1], found[2], rtol=1e-9)
