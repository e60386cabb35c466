"""What other tools write, read; and files that cannot be."""

import numpy as np
import pytest
import tifffile
from raising import raises
from scipy.io import savemat

from photosite.errors import FileError
from photosite.scene.charts import MACBETH_NAMES
from photosite.validation.patch_values import PatchValues
from photosite.validation.tool_comparison import Mosaic, ReadOptions, read_csv, read_mat, read_tool_file
from photosite.values.cfa import cfa_from
from photosite.values.region import Region

RGGB = cfa_from("rggb")
ELECTRONS = ReadOptions(RGGB, 12, unit="e")
NUMBERS = ReadOptions(RGGB, 12, 64.0, unit="dn")
VALUES = np.arange(72.0).reshape(24, 3) + 1


def test_csv_with_standard_errors_notes_and_another_order(tmp_path):
    file = tmp_path / "other.csv"
    file.write_text('# a tool\'s\npatch,B_dn,R_dn,R_standard_error_dn\nwhite,1,2,0.5\n\n"black, matte",3,4,0\n')
    found = read_csv(file)
    assert found.names == ("white", "black, matte")
    assert found.channels == ("B", "R")
    assert found.unit == "dn"
    assert found.standard_error.tolist() == [[0, 0.5], [0, 0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("patch,R_e\n", "has a heading but no patches"),
        ("name,R_e\nwhite,1\n", ":1: heading of the first column must be"),
        ("patch,R\nwhite,1\n", "column must be a channel with its unit"),
        ("patch,R_e,G_dn\nwhite,1,2\n", "in one unit"),
        ("patch,R_e,R_e\nwhite,1,2\n", "columns must be without repeats"),
        ("patch,R_e,G_standard_error_e\nwhite,1,2\n", "channel G has a standard error but no values"),
        ("patch,R_e\nwhite,1\nblack,x\n", ":3: patch 'black' must be 1 finite numbers"),
        ("patch,R_e\nwhite,nan\n", "finite"),
        ("patch,R_e\nwhite,1,2\n", "cells must be a patch name and 1 numbers"),
        ("patch,R_e\nwhite,1\nwhite,2\n", "patch names must be without repeats"),
        ("patch,R_e,R_standard_error_e\nwhite,1,-1\n", "standard_error must be 0 or more"),
    ],
)
def test_invalid_csv_files(tmp_path, text, message):
    file = tmp_path / "other.csv"
    file.write_text(text)
    with pytest.raises(FileError) as caught:
        read_csv(file)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_mat_patches_in_isetcams_order(tmp_path):
    savemat(tmp_path / "a.mat", {"electrons": VALUES})
    found = read_mat(tmp_path / "a.mat", ELECTRONS)
    assert isinstance(found, PatchValues)
    assert found.names[3] == "white"
    assert found.names[-1] == "black"
    assert found.names[:2] == (MACBETH_NAMES[0], MACBETH_NAMES[6])  # down the first column
    assert (found.mean == VALUES).all()


def test_mat_patches_with_names(tmp_path):
    cells = np.array(["white", "black"], dtype=object)
    channels = np.array(["G", "M"], dtype=object)
    savemat(tmp_path / "a.mat", {"mean": VALUES[:2, :2], "patch_names": cells, "channel_names": channels})
    found = read_mat(tmp_path / "a.mat", ELECTRONS)
    assert (found.names, found.channels) == (("white", "black"), ("G", "M"))


def test_mat_mosaic_in_a_structure(tmp_path):
    """As ISETCam's sensor holds its data."""
    volts = np.random.default_rng(1).random((20, 30))
    savemat(tmp_path / "a.mat", {"sensor": {"name": "D200", "data": {"volts": volts, "dv": np.round(4000 * volts)}}})
    found = read_mat(tmp_path / "a.mat", ReadOptions(RGGB, 12, unit="e", variable="sensor.data.volts"))
    assert isinstance(found, Mosaic)
    assert (found.electrons == volts).all()
    (frame,) = read_mat(tmp_path / "a.mat", ReadOptions(RGGB, 12, 64.0, unit="dn", variable="sensor.data.dv"))
    assert (frame.dn == np.round(4000 * volts)).all()
    assert (frame.cfa, frame.bits, frame.black_level_dn) == (RGGB, 12, 64.0)


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        ({"a": VALUES}, ReadOptions(RGGB, 12), "unit of a MATLAB file is unknown"),
        ({"a": VALUES, "b": VALUES}, ELECTRONS, "number of numeric arrays"),
        ({"a": VALUES}, ReadOptions(RGGB, 12, unit="e", variable="aa"), "Did you mean 'a'?"),
        ({"a": "text"}, ELECTRONS, "number of numeric arrays"),
        ({"a": VALUES[:5]}, ELECTRONS, "cell array 'patch_names'"),
        ({"a": VALUES[:, :2]}, ELECTRONS, "cell array 'channel_names'"),
        ({"a": VALUES * np.nan}, ELECTRONS, "finite"),
        ({"a": np.full((8, 8), 0.5)}, NUMBERS, "for 12 bits"),
        ({"a": np.full((8, 8), 4096.0)}, NUMBERS, "for 12 bits"),
        ({"a": np.full((8, 8), np.inf)}, ELECTRONS, "finite"),
        ({"a": np.zeros((2, 8, 8))}, ELECTRONS, "must be a real matrix"),
        ({"a": {"b": 1.0}}, ReadOptions(RGGB, 12, unit="e", variable="a.c"), "variable"),
        ({"a": {"b": 1.0}}, ReadOptions(RGGB, 12, unit="e", variable="a"), "must be a real matrix"),
    ],
)
def test_invalid_mat_files(tmp_path, content, options, message):
    savemat(tmp_path / "a.mat", content)
    with pytest.raises(FileError) as caught:
        read_mat(tmp_path / "a.mat", options)
    assert message in str(caught.value)


def test_damaged_mat_files(tmp_path):
    savemat(tmp_path / "a.mat", {"a": VALUES}, do_compression=True)
    whole = (tmp_path / "a.mat").read_bytes()
    rng = np.random.default_rng(2)
    damaged = bytearray(whole)
    damaged[140:180] = rng.bytes(40)
    kinds = {"empty": b"", "text": b"patch,R_e\nwhite,1\n" * 20, "cut": whole[: len(whole) // 2], "damaged": damaged}
    for name, content in kinds.items():
        (tmp_path / f"{name}.mat").write_bytes(content)
        with pytest.raises(FileError):
            read_mat(tmp_path / f"{name}.mat", ELECTRONS)
    with raises(FileError, "there is no such"):
        read_mat(tmp_path / "none.mat", ELECTRONS)


def test_version_7_3_is_named(tmp_path):
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    (tmp_path / "a.mat").write_bytes(header + bytes(400))
    with raises(FileError, "is a MATLAB file"):
        read_mat(tmp_path / "a.mat", ELECTRONS)


def test_plain_tiff_is_read_as_the_sensor_says(tmp_path):
    dn = np.random.default_rng(3).integers(0, 4096, (12, 18)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", dn)
    (frame,) = read_tool_file(tmp_path / "a.tif", NUMBERS)
    assert (frame.cfa, frame.bits, frame.black_level_dn) == (RGGB, 12, 64.0)
    mosaic = read_tool_file(tmp_path / "a.tif", ELECTRONS)
    assert (mosaic.electrons == dn).all()
    tifffile.imwrite(tmp_path / "a.tif", dn + np.uint16(10000))
    with raises(FileError, "largest value", value=13996, arguments={"bits": 16}):
        read_tool_file(tmp_path / "a.tif", NUMBERS)


def test_a_mosaics_patches_against_the_plain_way():
    electrons = np.random.default_rng(4).poisson(900.0, (21, 34)).astype(float)
    region = Region("odd", 3, 18, 5, 30)
    found = Mosaic(electrons, cfa_from("gbrg")).patch_values([region])
    assert found.channels == ("G", "B", "R")
    sites = {"G": [(0, 0), (1, 1)], "B": [(0, 1)], "R": [(1, 0)]}
    for k, channel in enumerate(found.channels):
        values = [electrons[r, c] for r in range(3, 18) for c in range(5, 30) if (r % 2, c % 2) in sites[channel]]
        assert found.mean[0, k] == pytest.approx(np.mean(values))
        assert found.standard_error[0, k] == pytest.approx(np.std(values, ddof=1) / np.sqrt(len(values)))


def test_a_reader_that_crashes_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("photosite.files.child._child", None)
    monkeypatch.setattr("photosite.files.child.sys.executable", "/bin/false")
    savemat(tmp_path / "a.mat", {"a": VALUES})
    with pytest.raises(FileError) as caught:
        read_mat(tmp_path / "a.mat", ELECTRONS)
    assert "the reader crashed" in caught.value.what
