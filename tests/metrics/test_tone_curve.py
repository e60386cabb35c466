"""Tone curves of pictures: stated, assumed with a diagnostic, or measured on gray patches; lossy compression."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms, PngImagePlugin

from photosite.cli.main import run
from photosite.color.colorimetry import light_from_srgb, srgb_from_light
from photosite.develop.develop import save_picture
from photosite.errors import FileError, InputError
from photosite.metrics import image_checks
from photosite.metrics.block_transform import quantization_step
from photosite.metrics.chart_image import chart_image
from photosite.metrics.charts.placed_chart import placed_chart
from photosite.metrics.image_checks import block_steps
from photosite.metrics.measure import measure
from photosite.metrics.registry import measurements
from photosite.metrics.tone_curve import ToneCurve
from photosite.studies.virtual_charts import virtual_edge

SHAPE = (264, 392)
CHART = placed_chart(chart_image(np.ones(SHAPE)), "macbeth")
Array = NDArray[np.float64]


def macbeth(random: np.random.Generator) -> Array:
    """Return a picture of the chart's luminance relative to white, with noise."""
    light = np.full(SHAPE, 0.02)
    for patch, xyz in zip(CHART.patches, CHART.patch_xyz, strict=True):
        light[patch.r0 : patch.r1, patch.c0 : patch.c1] = xyz[1] / CHART.white_xyz[1]
    return np.clip(light + random.normal(0, 0.002, SHAPE), 0, 1)


def edge(random: np.random.Generator) -> Array:
    electrons = virtual_edge(random).electrons
    return np.clip(0.8 * electrons / np.percentile(electrons, 99), 0, 1)


def saved(path: Path, encoded: Array, **options: Any) -> Path:
    codes = np.rint(255 * np.repeat(encoded[..., None], 3, axis=2)).astype(np.uint8)
    Image.fromarray(codes).save(path, **options)
    return path


def ids(quality: Any) -> set[str]:
    return {entry.id for entry in quality.diagnostics}


def test_what_states_the_tone_curve(tmp_path: Path) -> None:
    """ICC, the sRGB and gAMA chunks, EXIF and TIFF's ICC state it; nothing, or JFIF, does not."""
    encoded = srgb_from_light(macbeth(np.random.default_rng(1)))
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    chunks = PngImagePlugin.PngInfo()
    chunks.add(b"sRGB", b"\0")
    gamma = PngImagePlugin.PngInfo()
    gamma.add(b"gAMA", (45455).to_bytes(4, "big"))
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = 1
    exif[0x8769] = exif.get_ifd(0x8769)
    files = {
        "plain.png": ({}, "assumed"),
        "icc.png": ({"icc_profile": profile}, "stated"),
        "chunk.png": ({"pnginfo": chunks}, "stated"),
        "gamma.png": ({"pnginfo": gamma}, "stated"),
        "plain.jpg": ({"quality": 98}, "assumed"),
        "exif.jpg": ({"quality": 98, "exif": exif}, "stated"),
        "plain.tif": ({}, "assumed"),
        "icc.tif": ({"icc_profile": profile}, "stated"),
    }
    for name, (options, tone) in files.items():
        path = saved(tmp_path / name, encoded, **options)
        assert chart_image(path).tone == tone, name
        quality = measure(path, "macbeth", only=["oecf"])
        assert ("assumed-tone-curve" in ids(quality)) == (tone == "assumed"), name
        assert ("lossy-compression" in ids(quality)) == name.endswith(".jpg"), name
        assert quality.to_dict()["tone_curve"] == tone
        assert "assumed-tone-curve" not in ids(measure(path, "macbeth", only=["oecf"], tone_curve="srgb"))


def test_codes_of_tiff(tmp_path: Path) -> None:
    path = tmp_path / "wide.tif"
    codes = np.full((32, 32, 3), 128, np.uint8)
    tifffile.imwrite(path, codes, photometric="rgb")
    assert chart_image(path).frames[0][0, 0, 0] == pytest.approx(((128 / 255 + 0.055) / 1.055) ** 2.4)
    assert chart_image(path, tone_curve="linear").frames[0][0, 0, 0] == pytest.approx(128 / 255)


@pytest.mark.parametrize("gamma", [0.3, 0.45, 0.7])
def test_unknown_gamma_is_measured_on_the_chart(gamma: float, tmp_path: Path) -> None:
    """A gamma that is not sRGB's bends the OECF; the curve of the gray patches gives the responses of linear light."""
    random = np.random.default_rng(2)
    gray, light = macbeth(random), edge(random)
    picture = saved(tmp_path / "gray.png", gray**gamma)
    assumed = measure(picture, "macbeth", only=["oecf"])
    true = measure(np.repeat(light[..., None], 3, axis=2), "slanted-edge", only=["edge-sfr"])["edge-sfr"]
    curved = saved(tmp_path / "edge.png", light**gamma)
    own = measure(picture, "macbeth", only=["oecf"], tone_curve="chart")
    assert own["oecf"]["exponent", "Y"].value == pytest.approx(1.0, abs=0.01)
    assert "tone-curve-of-chart" in ids(own)
    path = tmp_path / "oecf.json"
    path.write_text(json.dumps(assumed.to_dict()), encoding="utf-8")
    image, placed = own.image, own.chart
    for curve in (ToneCurve.load(path), ToneCurve.of_chart(chart_image(picture), placed)):
        found = measure(curved, "slanted-edge", only=["edge-sfr"], tone_curve=curve)["edge-sfr"]
        assert found["mtf50", "Y"].value == pytest.approx(true["mtf50", "Y"].value, rel=0.02)
    if gamma != 0.45:
        assert "curved-tone" in ids(assumed)
        wrong = measure(curved, "slanted-edge", only=["edge-sfr"])["edge-sfr"]["mtf50", "Y"].value or 0
        assert abs(wrong / (true["mtf50", "Y"].value or 1) - 1) > 0.03
    assert image.tone == "chart"


def test_curves_that_cannot_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = saved(tmp_path / "edge.png", edge(np.random.default_rng(3)))
    with pytest.raises(InputError):
        measure(picture, "slanted-edge", tone_curve="chart")
    with pytest.raises(InputError):
        measure(np.ones(SHAPE), "macbeth", tone_curve="chart")
    (tmp_path / "other.json").write_text('{"results": {}}', encoding="utf-8")
    with pytest.raises(FileError):
        ToneCurve.load(tmp_path / "other.json")
    assert run(["measure", str(picture), "--chart", "slanted-edge", "--tone-curve", str(tmp_path / "none.json")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_figures_of_the_diagnostics_exist() -> None:
    known = {name for entry in measurements().values() for name in entry.quantities}
    for kind in (image_checks.ASSUMED_TONE_CURVE, image_checks.CHART_TONE_CURVE, image_checks.LOSSY_COMPRESSION):
        for pattern in kind.parameters:
            assert any(fnmatchcase(name, pattern) for name in known), pattern


def compressed(encoded: Array, quality: int) -> Array:
    stream = io.BytesIO()
    Image.fromarray(np.rint(255 * encoded).astype(np.uint8)).save(stream, "JPEG", quality=quality)
    return np.asarray(Image.open(stream), np.float64) / 255


def test_compression_is_seen_in_decoded_pictures() -> None:
    """Pictures that were JPEG of quality 30 to 50 have steps at the borders of blocks; no picture with noise has."""
    random = np.random.default_rng(4)
    for number in range(60):
        scale = random.uniform(0.003, 0.05)
        encoded = srgb_from_light(macbeth(random))
        encoded = np.clip(encoded + scale * random.normal(size=SHAPE), 0, 1)[number % 11 :, number % 7 :]
        plain = np.rint(255 * encoded) / 255
        image = chart_image(np.repeat((plain**2.2)[..., None], 3, axis=2))
        assert block_steps(image) is None
        if number < 30:
            coded = compressed(encoded, int(random.integers(30, 51)))
            found = block_steps(replace(image, frames=(np.repeat((coded**2.2)[..., None], 3, axis=2),)))
            assert found is not None
            assert found > 0.05


@pytest.mark.parametrize("quality", [80, 90, 95])
def test_fine_compression_is_seen_in_coefficients(quality: int) -> None:
    """Colors that were JPEG of high quality have coefficients in steps, and no others have."""
    random = np.random.default_rng(quality)
    light = srgb_from_light(macbeth(random))[..., None] * [0.9, 1.0, 0.8]
    for scale in (0.0, 0.003, 0.01, 0.03):
        encoded = np.clip(light + scale * random.normal(size=light.shape), 0, 1)
        plain = np.rint(255 * encoded) / 255
        assert quantization_step(light_from_srgb(plain)) is None
        if scale:
            step = quantization_step(light_from_srgb(compressed(encoded, quality)))
            assert step is not None
            assert 2 <= step <= 30


@pytest.mark.parametrize("name", ["a.jpg", "a.png"])
def test_developed_pictures_state_their_color_space(name: str, tmp_path: Path) -> None:
    picture = np.random.default_rng(1).uniform(0.2, 0.8, (16, 24, 3)).astype(np.float32)
    save_picture(picture, tmp_path / name)
    assert chart_image([tmp_path / name]).tone == "stated"
