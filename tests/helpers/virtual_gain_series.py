"""A gain series of a virtual sensor: noise before and after the amplifier, one or two conversion gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from os import PathLike

from photosite.errors import InputError
from photosite.files.writing import atomic_folder
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.io.protocol import Protocol, ProtocolFrames, write_protocol
from photosite.sensor.model import Sensor
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import NOMINAL_NAME, PROTOCOL_NAME, VirtualLab, nominal_sensor, virtual_lab


@dataclass(frozen=True)
class GainModel:
    """Noise and gain of a sensor as functions of the gain setting.

    Parameters
    ----------
    pre_amplifier_noise_mv
        Read noise at the pixel, the same at all settings; it is amplified with the signal.
    post_amplifier_noise_dn
        Read noise after the amplifier without rounding, the same at all settings.
    switch_at
        Setting from which on the high conversion gain is used; None for a pixel with one conversion gain.
    conversion_gain_ratio
        High over low conversion gain.
    keeps_proportion
        Whether the amplifier compensates the switch, so that the system gain remains proportional to the setting, as in
        cameras with ISO settings.
    """

    pre_amplifier_noise_mv: float
    post_amplifier_noise_dn: float
    switch_at: float | None = None
    conversion_gain_ratio: float = 3.0
    keeps_proportion: bool = False

    def sensor(self, base: Sensor, setting: float, lowest: float) -> Sensor:
        """Return the sensor at a setting; `base` is the sensor at the lowest one, whose read noise is replaced."""
        high = self.switch_at is not None and setting >= self.switch_at
        ratio = self.conversion_gain_ratio if high else 1.0
        amplification = setting / lowest / (ratio if high and self.keeps_proportion else 1.0)
        changed = base.with_(
            analog_gain=base.readout.analog_gain.value * amplification,
            conversion_gain_uv_per_e=base.pixel.conversion_gain_uv_per_e.value * ratio,
        )
        after_mv = self.post_amplifier_noise_dn * changed.mv_per_dn
        return changed.with_(read_noise_mv=math.hypot(self.pre_amplifier_noise_mv, after_mv))

    def pre_amplifier_noise_e(self, sensor: Sensor) -> float:
        """Return the noise before the amplifier in electrons, for the sensor at a setting."""
        return sensor.electrons(self.pre_amplifier_noise_mv)


@dataclass(frozen=True)
class GainSeriesLab:
    """Virtual laboratories of one chip, one for each gain setting.

    Parameters
    ----------
    settings
        Gain settings in ascending order.
    labs
        Laboratory of each setting.
    """

    settings: tuple[float, ...]
    labs: tuple[VirtualLab, ...]

    @property
    def nominal(self) -> Sensor:
        """The nominal sensor at the lowest setting."""
        return nominal_sensor(self.labs[0].camera.sensor)

    def frame_set(self) -> FrameSet:
        """Return all frames; each is simulated when it is read."""
        sets = [lab.frame_set() for lab in self.labs]
        groups: list[FrameGroup] = []
        for setting, frames in zip(self.settings, sets, strict=True):
            groups += [replace(group, gain_setting=setting) for group in frames.groups]
        return replace(sets[0], groups=tuple(groups), sensor=self.nominal, black_level_dn=None)

    def write(self, folder: str | PathLike[str]) -> None:
        """Write a subfolder of frames for each setting, and one protocol.yaml, to a new folder."""
        with atomic_folder(folder) as place:
            entries: list[ProtocolFrames] = []
            for setting, lab in zip(self.settings, self.labs, strict=True):
                name = f"gain{setting:g}"
                (place / name).mkdir()
                for number, step, frame in lab.frames():
                    frame.save(place / name / f"{step.kind}{number:02d}_{frame.metadata['frame']:04d}.tif")
                entries += [
                    ProtocolFrames(
                        (f"{name}/{step.kind}{number:02d}_*.tif",),
                        FrameSettings(step.kind, step.exposure_s, lab.photons_per_pixel(step), setting),
                    )
                    for number, step in enumerate(lab.protocol.steps, start=1)
                ]
            self.nominal.save(place / NOMINAL_NAME)
            write_protocol(Protocol(tuple(entries), "virtual gain series", sensor=NOMINAL_NAME), place / PROTOCOL_NAME)


def gain_series_protocol(dark_frames: int = 16, levels: int = 12, repeats: int = 3) -> ShootingProtocol:
    """Return the protocol of a setting: repeated dark frames, a dark series to 1 s, and flat fields past saturation.

    Examples
    --------
    >>> gain_series_protocol().frame_count
    60
    """
    flats = tuple(Step("light", round(0.04 * (k + 1) / levels, 9), repeats) for k in range(levels))
    return ShootingProtocol("gain series", (Step("dark", 1e-4, dark_frames), *series("dark", 0.01, 1.0, 4, 2), *flats))


def gain_series_lab(
    sensor: Sensor,
    model: GainModel,
    settings: Sequence[float],
    protocol: ShootingProtocol | None = None,
    *,
    seed: int = 0,
    photons_known: bool = False,
) -> GainSeriesLab:
    """Return a laboratory that takes a protocol at every gain setting.

    Parameters
    ----------
    sensor
        The sensor at the lowest setting; its read noise is replaced by that of the model.
    model
        Noise and gain as functions of the setting.
    settings
        Gain settings above 0, ascending.
    protocol
        Frames at each setting; `gain_series_protocol()` by default.
    seed, photons_known
        As for `virtual_lab`. Settings share the fixed pattern, not the temporal noise.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("vendor-2.2um").with_(rows=32, cols=32, black_level_dn=64)
    >>> lab = gain_series_lab(sensor, GainModel(0.3, 0.5), [100, 200])
    >>> lab.frame_set().gain_settings, lab.frame_set().frame_count
    ((100.0, 200.0), 120)
    """
    values = tuple(float(setting) for setting in settings)
    if not values or values[0] <= 0 or any(b <= a for a, b in pairwise(values)):
        raise InputError("settings", value=values, expected="above 0 and ascending")
    shot = protocol or gain_series_protocol()
    labs = tuple(
        virtual_lab(
            model.sensor(sensor, setting, values[0]), shot, seed=seed * len(values) + index, photons_known=photons_known
        )
        for index, setting in enumerate(values)
    )
    return GainSeriesLab(values, labs)
