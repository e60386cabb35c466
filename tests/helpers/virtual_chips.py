"""Virtual chips with known defects: the chip of a serial as maps, and defects added to them."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps.defects import channel_values, merged
from photosite.errors import InputError
from photosite.sensor.chip import Blinking, DefectKind, Defects, MeasuredChip, draw_chip, no_blinking, no_defects
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_names

_EXACT = 1 << 30
"""Degrees of freedom of a noise that is known exactly."""


def drawn_maps(sensor: Sensor) -> MeasuredChip:
    """Return the chip of a sensor's serial as maps without uncertainty; frames are the same except for rounding.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=4, cols=6)
    >>> drawn_maps(sensor).prnu.shape
    (4, 6)
    """
    chip, gain = draw_chip(sensor), sensor.system_gain_dn_per_e
    shape = sensor.array.rows, sensor.array.cols

    def full(values: NDArray[np.float32], factor: float = 1.0) -> NDArray[np.float32]:
        return np.ascontiguousarray(np.broadcast_to(values * np.float32(factor), shape))

    exact = np.zeros(shape, np.float32)
    return MeasuredChip(
        offset_dn=full(chip.offset_e.map(), gain),
        offset_uncertainty_dn=exact,
        read_noise_dn=np.full(shape, sensor.electrons(sensor.noise.read_noise_mv.value) * gain, np.float32),
        read_noise_freedom=_EXACT,
        dark_rate_dn_per_s=full(chip.dark_rate_e_per_s, gain),
        dark_rate_uncertainty_dn_per_s=exact,
        prnu=full(chip.prnu.map()),
        prnu_uncertainty=exact,
        black_level_dn=sensor.readout.black_level_dn.value,
        system_gain_dn_per_e=gain,
        reference_exposure_s=0.0,
        defects=no_defects(),
        blinking=no_blinking(),
    )


def _places(chip: MeasuredChip, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return random pixels without a defect."""
    free = np.ones(chip.shape, bool)
    free[chip.defects.row, chip.defects.col] = False
    if count > (sound := np.flatnonzero(free)).size:
        raise InputError("count", value=count, expected=f"at most {sound.size}, the pixels without a defect")
    row, col = np.unravel_index(np.sort(rng.choice(sound, count, replace=False)), chip.shape)
    return row.astype(np.int64), col.astype(np.int64)


def _with_defects(
    chip: MeasuredChip,
    kind: DefectKind,
    place: tuple[NDArray[np.int64], NDArray[np.int64]],
    value: NDArray[np.float64],
    deviation: NDArray[np.float64],
) -> Defects:
    new = Defects(*place, np.full(len(place[0]), kind, np.uint8), value, deviation)
    return merged([chip.defects, new])


def plant_hot(
    chip: MeasuredChip, sensor: Sensor, sigma: NDArray[np.floating], spread_dn_per_s: float, *, seed: int = 0
) -> MeasuredChip:
    """Return the chip with hot pixels: one for each entry of `sigma`.

    Parameters
    ----------
    chip, sensor
        The chip and its sensor.
    sigma
        (n,) excess of the dark current over the median of the channel, in units of the spread.
    spread_dn_per_s
        The spread.
    seed
        Seed of the positions.
    """
    if chip.dark_rate_dn_per_s is None:
        raise InputError("the chip has no map of dark currents")
    cfa = sensor.array.cfa
    names = channel_names(cfa)
    tile = np.array([[names.index(name) for name in row] for row in cfa], dtype=np.int64)
    rate = chip.dark_rate_dn_per_s.copy()
    medians = np.array([np.median(channel_values(rate, tile, k)) for k in range(len(names))])
    place = _places(chip, len(sigma), np.random.default_rng([seed, 1]))
    value = medians[tile[place[0] % tile.shape[0], place[1] % tile.shape[1]]] + sigma * spread_dn_per_s
    rate[place] = value
    listed = _with_defects(chip, DefectKind.HOT, place, value, np.asarray(sigma, np.float64))
    return replace(chip, dark_rate_dn_per_s=rate, defects=listed)


def plant_dead(chip: MeasuredChip, response: NDArray[np.floating], *, seed: int = 0) -> MeasuredChip:
    """Return the chip with dead pixels of given relative responses."""
    if chip.prnu is None:
        raise InputError("the chip has no map of responses")
    prnu = chip.prnu.copy()
    place = _places(chip, len(response), np.random.default_rng([seed, 2]))
    prnu[place] = response - 1.0
    value = np.asarray(response, np.float64)
    return replace(chip, prnu=prnu, defects=_with_defects(chip, DefectKind.DEAD, place, value, np.zeros_like(value)))


def plant_blinking(
    chip: MeasuredChip, amplitude_dn: NDArray[np.floating], high_fraction: NDArray[np.floating], *, seed: int = 0
) -> MeasuredChip:
    """Return the chip with pixels that jump between two levels; `high_fraction` of the frames have the upper one."""
    place = _places(chip, len(amplitude_dn), np.random.default_rng([seed, 3]))
    noise = chip.read_noise_dn[place].astype(np.float64)
    amplitude = np.asarray(amplitude_dn, np.float64)
    new = Blinking(*place, amplitude, np.asarray(high_fraction, np.float64), noise)
    joined = (np.concatenate([getattr(chip.blinking, e.name), getattr(new, e.name)]) for e in fields(Blinking))
    listed = _with_defects(chip, DefectKind.BLINKING, place, amplitude, amplitude / noise)
    return replace(chip, blinking=Blinking(*joined), defects=listed)
