"""The virtual laboratory: light, black level, frames in memory and on disk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.studies.protocol import ShootingProtocol, Step, paper_d200_protocol
from photosite.studies.virtual_lab import (
    NOMINAL_NAME,
    PROTOCOL_NAME,
    TRUTH_NAME,
    VirtualLab,
    dark_noise_dn,
    nominal_sensor,
    virtual_lab,
    with_pedestal,
)

PROTOCOL = ShootingProtocol(
    "small", (Step("dark", 0.01, 3), Step("light", 0.01, 2), Step("dark", 0.01, 2), Step("light", 0.04, 2))
)


@pytest.fixture
def lab() -> VirtualLab:
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=24, cols=32))
    return virtual_lab(sensor, PROTOCOL, seed=11, photons_known=True)


def test_light_reaches_the_wanted_level() -> None:
    sensor = ps.load_sensor("nikon-d200").with_(rows=4, cols=6)
    for level in (0.5, 1.3):
        lab = virtual_lab(sensor, PROTOCOL, level=level)
        electrons = lab.camera.mean_electrons(lab.light, 0.04)
        assert electrons.max() == pytest.approx(level * sensor.saturation_capacity_e, rel=1e-5)


def test_photons_times_efficiency_are_electrons(lab: VirtualLab) -> None:
    """A sensor that counts every photon on its area reads the number in the protocol."""
    perfect = {"wavelength_nm": [380.0, 780.0], "quantum_efficiency": [1.0, 1.0]}
    sensor = lab.camera.sensor.with_(fill_factor=1.0, channels=dict.fromkeys("RGB", perfect))
    counting = replace(lab, camera=replace(lab.camera, sensor=sensor))
    light = Step("light", 0.04, 1)
    electrons = counting.camera.mean_electrons(lab.light, 0.04)
    assert counting.photons_per_pixel(light) == pytest.approx(float(electrons.mean()), rel=1e-5)
    assert lab.photons_per_pixel(Step("dark", 0.04, 1)) == 0
    assert replace(lab, photons_known=False).photons_per_pixel(light) is None


@pytest.mark.parametrize("name", ["nikon-d200", "vendor-2.2um", "vendor-1.4um"])
def test_pedestal_keeps_darks_from_clipping(name: str) -> None:
    """At 5 standard deviations 1 pixel in 3.5 million of one frame reads 0; none of these 40 000 does."""
    sensor = with_pedestal(ps.load_sensor(name).with_(rows=200, cols=200))
    assert sensor.readout.black_level_dn.value >= 5 * dark_noise_dn(sensor)
    frame = next(virtual_lab(sensor, ShootingProtocol("dark", (Step("dark", 0.01, 1),))).frames())[2]
    assert frame.dn.min() > 0
    assert with_pedestal(sensor) is sensor


@pytest.mark.parametrize("read_noise_mv", [0.0, 0.01, 0.05])
def test_pedestal_of_a_quiet_sensor(read_noise_mv: float) -> None:
    """No dark pixel reads 0 even if rounding dominates the noise: 4 DN are 11 standard deviations of 0.36 DN."""
    quiet = ps.load_sensor("nikon-d200").with_(rows=40, cols=40, read_noise_mv=read_noise_mv, dsnu_mv=0)
    sensor = with_pedestal(quiet)
    assert sensor.readout.black_level_dn.value == 4
    frame = next(virtual_lab(sensor, ShootingProtocol("dark", (Step("dark", 0.01, 1),))).frames())[2]
    assert frame.dn.min() >= 2


def test_nominal_sensor_does_not_depend_on_the_truth(lab: VirtualLab) -> None:
    true = lab.camera.sensor
    other = true.with_(
        read_noise_mv=3,
        dsnu_mv=2,
        prnu_percent=3,
        dark_voltage_mv_per_s=1,
        dcnu_percent=5,
        black_level_dn=100,
        conversion_gain_uv_per_e=12,
        well_capacity_e=9000,
    )
    assert nominal_sensor(true) == nominal_sensor(other)
    assert nominal_sensor(true).channels == true.channels
    assert nominal_sensor(true).noise.read_noise_mv.assumed


def test_every_frame_has_its_own_noise_and_is_repeatable(lab: VirtualLab) -> None:
    frames = [frame for _, _, frame in lab.frames()]
    assert [frame.metadata["frame"] for frame in frames] == list(range(PROTOCOL.frame_count))
    assert len({frame.dn.tobytes() for frame in frames}) == PROTOCOL.frame_count
    again = [frame for _, _, frame in lab.frames()]
    assert all(np.array_equal(a.dn, b.dn) for a, b in zip(frames, again, strict=True))


def test_a_light_frame_equals_a_capture(lab: VirtualLab) -> None:
    frame = [frame for _, _, frame in lab.frames()][-1]
    expected = lab.camera.capture(lab.light, 0.04, seed=11, frame=PROTOCOL.frame_count - 1)
    np.testing.assert_array_equal(frame.dn, expected.dn)


def test_frames_on_disk_equal_those_in_memory(lab: VirtualLab, tmp_path: Path) -> None:
    lab.write(tmp_path / "stack")
    disk, memory = ps.open_frames(tmp_path / "stack"), lab.frame_set()
    assert (disk.rows, disk.cols, disk.bits, disk.cfa) == (memory.rows, memory.cols, memory.bits, memory.cfa)
    assert disk.sensor == memory.sensor
    assert disk.black_level_dn == memory.black_level_dn
    for one, other in zip(disk.groups, memory.groups, strict=True):
        assert (one.kind, one.exposure_s, one.photons_per_pixel) == (
            other.kind,
            other.exposure_s,
            other.photons_per_pixel,
        )
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_the_protocol_refers_to_the_nominal_sensor_only(lab: VirtualLab, tmp_path: Path) -> None:
    lab.write(tmp_path / "stack")
    assert ps.load_sensor(tmp_path / "stack" / TRUTH_NAME) == lab.camera.sensor
    assert ps.load_sensor(tmp_path / "stack" / NOMINAL_NAME) == nominal_sensor(lab.camera.sensor)
    assert TRUTH_NAME not in (tmp_path / "stack" / PROTOCOL_NAME).read_text(encoding="utf-8")


def test_frames_without_the_protocol_keep_their_metadata(lab: VirtualLab, tmp_path: Path) -> None:
    lab.write(tmp_path / "stack")
    flats = ps.open_frames(tmp_path / "stack" / "light")
    assert [(group.kind, group.exposure_s, len(group)) for group in flats.groups] == [
        ("light", 0.01, 2),
        ("light", 0.04, 2),
    ]
    for file in (tmp_path / "stack").glob("*.yaml"):
        file.unlink()
    whole = ps.open_frames(tmp_path / "stack")
    assert [(group.kind, len(group)) for group in whole.groups] == [("dark", 5), ("light", 2), ("light", 2)]


def test_failure_leaves_nothing(lab: VirtualLab, tmp_path: Path) -> None:
    def fails(done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lab.write(tmp_path / "stack", fails)
    assert list(tmp_path.iterdir()) == []


def test_progress_counts_every_frame(lab: VirtualLab, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    lab.write(tmp_path / "stack", lambda done, total: seen.append((done, total)))
    assert seen == [(n, PROTOCOL.frame_count) for n in range(1, PROTOCOL.frame_count + 1)]


def test_invalid_light_and_folder(tmp_path: Path) -> None:
    sensor = ps.load_sensor("nikon-d200").with_(rows=4, cols=6)
    with pytest.raises(InputError) as caught:
        virtual_lab(sensor, PROTOCOL, level=0)
    assert caught.value.what == "level"
    blind = {"wavelength_nm": [900.0], "quantum_efficiency": [0.5]}
    with pytest.warns(PhotositeWarning), pytest.raises(InputError) as caught:
        virtual_lab(sensor.with_(channels=dict.fromkeys("RGB", blind)), PROTOCOL)
    assert (caught.value.what, caught.value.value) == ("illuminant", "D65")
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(FileError):
        virtual_lab(sensor, PROTOCOL).write(tmp_path)
    assert (tmp_path / "mine.txt").read_text(encoding="utf-8") == "mine"


def test_saturation_under_metered_light_is_that_of_the_first_channel_to_saturate() -> None:
    """Green saturates first; the mean efficiency of all channels would give two thirds of its electrons."""
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=64, cols=96))
    cal = ps.calibrate(virtual_lab(sensor, paper_d200_protocol(), seed=3, photons_known=True).frame_set())
    green = cal.channels["G"].saturation_capacity_e
    assert green.value is not None
    assert cal.saturation_capacity_e.value == pytest.approx(green.value, rel=0.02)  # gain of green, or of all channels
    assert cal.saturation_capacity_photons.value == pytest.approx(
        cal.channels["G"].saturation_capacity_photons.value, rel=1e-3
    )
    assert cal.saturation_capacity_e.standard_uncertainty is not None
    error = abs(cal.saturation_capacity_e.value - sensor.saturation_capacity_e)
    assert error < 3 * cal.saturation_capacity_e.standard_uncertainty < 0.02 * sensor.saturation_capacity_e
