"""Frames written as FITS and OME-TIFF: as astropy and tifffile read them, and as photosite reads them."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import tifffile

import photosite as ps

fits = pytest.importorskip("astropy.io.fits")

METADATA = {
    "camera": 'Acme X-1 "\u00e9" <&>',
    "gain_setting": 200.0,
    "temperature_c": -10.5,
    "kind": "light",
    "seed": 3,
}


def frame(bits: int = 12, cfa: str = "rggb", **changed: object) -> ps.RawFrame:
    dn = np.random.default_rng(1).integers(0, 1 << bits, (9, 14))
    dn[0, :2] = 0, (1 << bits) - 1
    span = (1 << bits) - 1 - 64
    # 0.25 DN per electron and 3 electrons of noise: S = K / span, O = (3 K / span)^2.
    profile = np.array([[0.25 / span, (0.75 / span) ** 2]] * 3)
    given = {"black_level_dn": 64, "exposure_s": 0.02, "noise_profile": profile, "metadata": METADATA} | changed
    tile = [list(cfa[:2].upper()), list(cfa[2:].upper())] if cfa else None
    return ps.RawFrame(
        dn.astype(np.uint16 if bits <= 16 else np.uint32), bits=bits, **({"cfa": tile} if tile else {}), **given
    )


@pytest.mark.parametrize("name", ["a.fits", "a.fit", "a.ome.tif", "a.ome.tiff"])
@pytest.mark.parametrize("bits", [12, 16, 20])
def test_round_trip(tmp_path: Path, name: str, bits: int) -> None:
    written = frame(bits)
    written.save(tmp_path / name)
    again = ps.read_raw(tmp_path / name)
    np.testing.assert_array_equal(again.dn, written.dn)
    for field in ("bits", "cfa", "black_level_dn", "white_level_dn", "exposure_s"):
        assert getattr(again, field) == getattr(written, field), field
    assert dict(again.metadata) == METADATA
    np.testing.assert_array_equal(again.noise_profile, written.noise_profile)


@pytest.mark.parametrize(("bits", "bitpix"), [(12, 16), (16, 16), (20, 32)])
def test_keywords_of_fits(tmp_path: Path, bits: int, bitpix: int) -> None:
    written = frame(bits)
    written.save(tmp_path / "a.fits")
    with fits.open(tmp_path / "a.fits", do_not_scale_image_data=True) as units:
        header = units[0].header
        assert (header["BITPIX"], header["BZERO"], header["BSCALE"]) == (bitpix, 2 ** (bitpix - 1), 1)
        units[0].verify("exception")
    np.testing.assert_array_equal(fits.getdata(tmp_path / "a.fits"), written.dn)
    assert (header["BUNIT"], header["BAYERPAT"], header["ROWORDER"]) == ("adu", "RGGB", "TOP-DOWN")
    assert (header["EXPTIME"], header["BLKLEVEL"], header["SATURATE"]) == (0.02, 64, 2**bits - 1)
    assert header["EGAIN"] == pytest.approx(4, rel=1e-12)  # electrons per DN
    assert "RDNOISE" not in header, "the dark noise of a profile has DSNU in it"
    assert (header["GAIN"], header["CCD-TEMP"], header["IMAGETYP"]) == (200, -10.5, "light")
    assert header["INSTRUME"] == 'Acme X-1 "?" <&>'


def test_read_noise_of_simulated_fits(tmp_path: Path) -> None:
    """2 electrons of read noise, beside a DSNU of 30."""
    sensor = ps.load_sensor("nikon-d200").with_(read_noise_e=2.0, dsnu_e=30.0, rows=24, cols=36)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    scene = ps.charts.macbeth(illuminant="A", mean_luminance_cd_m2=40)
    camera.capture(scene, exposure_s=0.01, seed=1).save(tmp_path / "a.fits")
    assert fits.getheader(tmp_path / "a.fits")["RDNOISE"] == pytest.approx(2.0, rel=1e-9)
    gain = fits.getheader(tmp_path / "a.fits")["EGAIN"]
    assert gain == pytest.approx(1 / sensor.system_gain_dn_per_e, rel=1e-9)


def test_fits_of_other_programs_states_what_it_can(tmp_path: Path) -> None:
    """Without photosite's own keyword, the usual ones are read: as another program would write them."""
    frame().save(tmp_path / "a.fits")
    with fits.open(tmp_path / "a.fits", mode="update") as units:
        del units[0].header["PHOTOSIT"]
    again = ps.read_raw(tmp_path / "a.fits", bits=12)
    assert (again.cfa, again.exposure_s) == (frame().cfa, 0.02)
    assert (again.metadata["gain_setting"], again.metadata["temperature_c"]) == (200, -10.5)
    frame(cfa="", noise_profile=None, exposure_s=None).save(tmp_path / "mono.fits")
    header = fits.getheader(tmp_path / "mono.fits")
    assert not {"BAYERPAT", "EGAIN", "RDNOISE", "EXPTIME"} & set(header)


def test_ome_of_other_programs(tmp_path: Path) -> None:
    frame().save(tmp_path / "a.ome.tif")
    with tifffile.TiffFile(tmp_path / "a.ome.tif") as file:
        assert file.is_ome
        np.testing.assert_array_equal(file.asarray(), frame().dn)
        root = ElementTree.fromstring(file.ome_metadata)
    space = root.tag.partition("}")[0] + "}"
    pixels = root.find(f"{space}Image/{space}Pixels")
    assert (pixels.get("SizeX"), pixels.get("SizeY"), pixels.get("SignificantBits")) == ("14", "9", "12")
    plane = pixels.find(f"{space}Plane")
    assert math.isclose(float(plane.get("ExposureTime")), 0.02)
    assert plane.get("ExposureTimeUnit") == "s"
