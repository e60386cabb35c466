"""Spectral protocols: measurements read from files, and errors with lines."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
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


def test_errors_have_the_field_and_the_line(written):
    _, folder = written
    text, broken = (folder / "spectral.yaml").read_text(), folder / "broken.yaml"
    for old, new, what, where, line in (
        ("photosite_spectral: 1", "photosite_spectral: 2", "photosite_spectral", None, 1),
        ("scale_uncertainty_percent: 0.5", "scale_uncertanty: 0.5", "unknown field 'scale_uncertanty'", None, 5),
        ("scale_uncertainty_percent: 0.5", "scale_uncertainty_percent: -1", "value", "scale_uncertainty_percent", 5),
        ("centre_nm: 550.0", "centre_nm: x", "value", "bands[1].centre_nm", 15),
        ("centre_nm: 550.0", "centre_nm: 500.0", "centre_nm", "500 nm", None),
        ("bandwidth_nm: 8.0", "bandwidth_nm: 800", "bandwidth_nm", None, 10),
        ("  bandwidth_nm: 8.0\n", "", "the band", "bands[0]", 10),
        ("photocurrent_a", "irradiance", "unknown field 'irradiance'", "bands[0]", 14),
        ("standard_uncertainty: ", "standard_uncertainty: -", "standard_uncertainty", "bands[0].photocurrent_a", 14),
        ("exposure: ", "exposure: -", "exposure_s", "darks[0].exposure", 7),
        ("photodiode: {area_mm2: 100.0, responsivity: photodiode.csv}\n", "", "photodiode", "500 nm", 9),
        ("files: dark/00_*.tif", "files: band/000_*.tif", "the frame is listed twice, first at line 7", None, 10),
        ("name:", "region: [0, 8, 0, 99]\nname:", "region", None, 2),
        ("name:", "region: [0, 8, 0]\nname:", "region", None, 2),
    ):
        assert old in text
        broken.write_text(text.replace(old, new))
        with pytest.raises(FileError) as caught:
            open_spectral(broken)
        assert (caught.value.path, caught.value.what, caught.value.line) == (str(broken), what, line), new
        assert where is None or caught.value.where == where, new
    broken.write_text("photosite_protocol: 1\nframes: []\n")
    with pytest.raises(FileError) as caught:
        open_spectral(broken)
    assert caught.value.what == "is a protocol of dark frames and flat fields, not a spectral protocol"
    for old, new, what, path in (
        ("responsivity: photodiode.csv", "responsivity: nowhere.csv", "there is no such file", "nowhere.csv"),
        ("name:", "bits: 14\nname:", "bits", "dark/00_000.tif"),
    ):
        broken.write_text(text.replace(old, new))
        with pytest.raises(FileError) as caught:
            open_spectral(broken)
        assert (caught.value.what, caught.value.path) == (what, str(folder / path))


def test_a_file_may_hold_several_frames(written, tmp_path):
    """The dark frames of an exposure time in one TIFF file of several pages."""
    _, folder = written
    text = (folder / "spectral.yaml").read_text()
    darks = sorted((folder / "dark").glob("00_*.tif"))
    tifffile.imwrite(
        folder / "pages.tif", np.stack([tifffile.imread(path) for path in darks]), photometric="minisblack"
    )
    (folder / "pages.yaml").write_text(
        text.replace("files: dark/00_*.tif", "files: pages.tif").replace("name:", "bits: 12\ncfa: rggb\nname:")
    )
    one, other = (calibrate_spectral(open_spectral(folder / name)) for name in ("pages.yaml", "spectral.yaml"))
    assert np.array_equal(one.channels["G"].covariance, other.channels["G"].covariance)


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
