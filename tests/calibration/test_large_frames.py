"""Large frames are calibrated in strips: the results have the bits of those of small frames, whose maps are held."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

import photosite as ps
from photosite.engine import large_statistics, lazy_maps
from photosite.sensor.chip import MAP_UNITS
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import virtual_lab, with_pedestal
from photosite.values.uncertain import Missing

PROTOCOL = ShootingProtocol(
    "strips",
    (
        Step("dark", 1 / 1000, 6),
        *series("dark", 1.0, 30.0, exposures=2, count=3),
        *series("light", 1 / 500, 1 / 20, exposures=7, count=3),
    ),
)
CHANGES = {
    "one color": {},
    "readout channels": {
        "effects": {"readout_channels": {"arrangement": "tile", "relative_gain": [[1.02, 0.98]], "offset_e": [[0, 30]]}}
    },
}


@pytest.mark.filterwarnings("ignore:.*response lies outside:photosite.errors.PhotositeWarning")
@pytest.mark.parametrize("sensor", ["nikon-d200", "sony-imx174"])
@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_strips_give_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sensor: str, changes: dict) -> None:
    chip = with_pedestal(ps.load_sensor(sensor).with_(rows=245, cols=310, **changes))
    virtual_lab(chip, PROTOCOL, seed=3, level=2.0).write(tmp_path / "stack")
    frames = ps.open_frames(tmp_path / "stack")
    held = ps.calibrate(frames)
    monkeypatch.setattr(lazy_maps, "HELD_PIXELS", 0)
    monkeypatch.setattr(lazy_maps, "STRIP_VALUES", 3000)
    strips = ps.calibrate(frames)
    assert strips.to_dict() == held.to_dict()
    pairs = [
        (getattr(pattern, kind), getattr(strips.spatial[name], kind))
        for name, pattern in held.spatial.items()
        for kind in ("dark", "light")
    ]
    seen = [pair for pair in pairs if not isinstance(pair[0], Missing)]
    assert {one.kind for one, _ in seen} == {"dark", "light"}
    for one, other in seen:
        assert (one.horizontal.power == other.horizontal.power).all()
        assert (one.vertical_filtered.power == other.vertical_filtered.power).all()
        assert (one.histogram.count == other.histogram.count).all()


HOT_PIXELS = {"hot_pixels": {"fraction": 0.002, "median_e_per_s": 3000, "log_spread": 0.5}}
WITH_GLOW = {
    "dark_current_e_per_s": 30,
    "effects": {"glow": {"places": ["left"], "peak_e_per_s": 60, "decay_pixels": 60}, **HOT_PIXELS},
}
WITH_BLOOMING = {"blooming": {"drained": 0.5}, **HOT_PIXELS}


@pytest.mark.filterwarnings("ignore:.*response lies outside:photosite.errors.PhotositeWarning")
@pytest.mark.parametrize(("sensor", "changes"), [("nikon-d200", WITH_GLOW), ("sony-imx174", WITH_BLOOMING)])
def test_strips_give_the_same_maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sensor: str, changes: dict) -> None:
    chip = with_pedestal(ps.load_sensor(sensor).with_(rows=245, cols=310, **changes))
    virtual_lab(chip, PROTOCOL, seed=3, level=2.0).write(tmp_path / "stack")
    frames = ps.open_frames(tmp_path / "stack")
    held = ps.calibrate(frames, maps=True)
    monkeypatch.setattr(lazy_maps, "HELD_PIXELS", 0)
    monkeypatch.setattr(lazy_maps, "STRIP_VALUES", 3000)
    monkeypatch.setattr(large_statistics, "_PIECE", 3000)
    strips = ps.calibrate(frames, maps=True)
    assert strips.to_dict() == held.to_dict()
    assert held.chip is not None
    assert strips.chip is not None
    # Gains of single pixels are measured on request (tests/calibration/test_pixel_gain.py).
    assert list(held.chip.maps()) == [name for name in MAP_UNITS if not name.startswith("pixel_gain")]
    for name, values in held.chip.maps().items():
        assert (getattr(strips.chip, name) == values).all(), name
    assert len(held.chip.defects) > 50
    for entry in fields(held.chip.defects):
        assert (getattr(strips.chip.defects, entry.name) == getattr(held.chip.defects, entry.name)).all()
    found = held.findings["glow" if "effects" in changes else "blooming"]
    assert found.present
