"""Frames of a virtual sensor, the slow and obvious way: one NumPy line per line of the noise model.

It shares no code with the camera, so that it can serve as an oracle for it and for the calibration. In electrons, for
pixel i of frame n (docs: the noise model):

    mean_i = photo_i (1 + prnu_i) + dark_rate_i t
    e_i    = min(Poisson(mean_i), well)
    v_i    = e_i conversion_gain + offset_i + read noise
    dn_i   = clip(round(analog_gain v_i / swing 2^bits + black level), 0, 2^bits - 1)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photosite.frames.frame_set import FrameSet
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_mask, channel_names


def sensor(seed=0, *, cfa="mono", rows=96, cols=128, limited_by="converter", **changes):
    """A sensor whose parameters vary with the seed; `changes` as in `Sensor.with_`."""
    rng = np.random.default_rng([seed, 11])
    gain = 10 ** rng.uniform(np.log10(0.15), np.log10(1.2))  # DN per electron
    black = float(rng.integers(60, 200))
    swing_v, analog_gain, bits = 1.0, rng.uniform(1.0, 3.0), 12
    mv_per_dn = 1e3 * swing_v / (analog_gain * 2**bits)
    read_dn = rng.uniform(0.8, 4.0)
    range_e = (2**bits - 1 - black) / gain
    channels = {"M": 0.5} if cfa == "mono" else {"R": 0.3, "G": 0.5, "B": 0.25}
    description = {
        "name": f"virtual {seed}",
        "array": {"rows": rows, "cols": cols, "cfa": cfa if cfa != "mono" else [["M"]]},
        "pixel": {
            "width_um": 5.0,
            "height_um": 5.0,
            "fill_factor": 0.8,
            "conversion_gain_uv_per_e": gain * mv_per_dn * 1e3,
            "voltage_swing_v": swing_v,
            "well_capacity_e": float(np.round(range_e * (0.8 if limited_by == "well" else 1.5))),
        },
        "channels": {
            name: {"wavelength_nm": (550.0,), "quantum_efficiency": (peak * rng.uniform(0.8, 1.2),)}
            for name, peak in channels.items()
        },
        "noise": {
            "read_noise_mv": read_dn * mv_per_dn,
            "dsnu_mv": read_dn * mv_per_dn * rng.uniform(0.3, 1.5),
            "prnu_percent": rng.uniform(0.5, 2.0),
            "dark_voltage_mv_per_s": rng.uniform(10.0, 100.0) * gain * mv_per_dn,
            "dcnu_percent": rng.uniform(10.0, 50.0),
        },
        "readout": {"bits": bits, "analog_gain": analog_gain, "black_level_dn": black},
    }
    return Sensor.model_validate(description).with_(**changes)


@dataclass(frozen=True)
class VirtualChip:
    """A chip of a sensor: its fixed pattern, and frames of it."""

    sensor: Sensor
    prnu: np.ndarray
    offset_e: np.ndarray
    dark_rate_e_per_s: np.ndarray
    rng: np.random.Generator

    @classmethod
    def draw(cls, sensor, seed):
        rng = np.random.default_rng([seed, 22])
        shape = (sensor.array.rows, sensor.array.cols)
        prnu = rng.normal(0.0, sensor.noise.prnu_percent.value / 100, shape)
        offset = rng.normal(0.0, sensor.electrons(sensor.noise.dsnu_mv.value), shape)
        mean_rate = sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value)
        log_variance = np.log(1.0 + (sensor.noise.dcnu_percent.value / 100) ** 2)
        rate = mean_rate * np.exp(rng.normal(-log_variance / 2, np.sqrt(log_variance), shape))
        return cls(sensor, prnu, offset, rate, rng)

    def frame(self, photo_e, exposure_s):
        """One frame; `photo_e` is the mean electrons from light, a number or (rows, cols)."""
        s = self.sensor
        mean = photo_e * (1.0 + self.prnu) + self.dark_rate_e_per_s * exposure_s
        electrons = np.minimum(self.rng.poisson(mean), s.pixel.well_capacity_e.value)
        read_e = s.electrons(s.noise.read_noise_mv.value)
        volts_e = electrons + self.offset_e + self.rng.normal(0.0, read_e, mean.shape)
        dn = np.round(volts_e * s.system_gain_dn_per_e + s.readout.black_level_dn.value)
        return np.clip(dn, 0, s.white_level_dn).astype(np.uint16)

    def flat_electrons(self, photons):
        """(rows, cols) mean electrons of a flat of so many photons per pixel."""
        s = self.sensor
        result = np.zeros((s.array.rows, s.array.cols))
        for name in channel_names(s.array.cfa):
            mask = channel_mask(s.array.cfa, name, result.shape)
            result[mask] = photons * s.channels[name].quantum_efficiency[0]
        return result


SHORTEST_S = 1e-4
LONGEST_FLAT_S = 0.05


def frame_set(sensor, seed, *, photons_known=True, dark_frames=24, stack=16, repeats=4, levels=14, top=1.25):
    """A measurement of one chip: darks from 0.1 ms to 5 s, flats up to `top` times saturation, a stack at half."""
    chip = VirtualChip.draw(sensor, seed)
    best = max(channel.quantum_efficiency[0] for channel in sensor.channels.values())
    least = min(channel.quantum_efficiency[0] for channel in sensor.channels.values())
    photons_at_saturation = sensor.saturation_capacity_e / (best if photons_known else least)
    rate = photons_at_saturation * top / LONGEST_FLAT_S
    frames = []

    def add(kind, exposure_s, count, photons):
        flat = chip.flat_electrons(photons)
        for _ in range(count):
            dn = chip.frame(flat, exposure_s)
            known = (photons,) if photons_known else ()
            frames.append((kind, exposure_s, dn, *known))

    add("dark", SHORTEST_S, dark_frames, 0.0)
    for exposure_s in np.geomspace(0.01, 5.0, 6):
        add("dark", float(exposure_s), repeats, 0.0)
    for exposure_s in np.linspace(LONGEST_FLAT_S / levels, LONGEST_FLAT_S, levels):
        add("light", float(exposure_s), repeats, rate * float(exposure_s))
    half = 0.5 * LONGEST_FLAT_S / top
    add("light", half, stack, rate * half)
    return FrameSet.from_arrays(frames, bits=sensor.readout.bits, cfa=sensor.array.cfa, sensor=sensor)


def variance_peak_photons(sensor):
    """Photons at which the temporal variance of a flat is largest, from the distribution of a clipped normal."""
    from scipy.stats import norm

    s = sensor
    gain, efficiency = s.system_gain_dn_per_e, s.channels["M"].quantum_efficiency[0]
    read_e = s.electrons(s.noise.read_noise_mv.value)
    head_room_e = (s.white_level_dn - s.readout.black_level_dn.value) / gain
    well = s.pixel.well_capacity_e.value
    by_well = well < head_room_e
    limit = well if by_well else head_room_e
    before, after = (0.0, read_e**2) if by_well else (read_e**2, 0.0)

    electrons = np.linspace(0.8, 1.1, 3001)[:, None] * limit
    nodes, weights = np.polynomial.hermite_e.hermegauss(21)
    prnu, dsnu = s.noise.prnu_percent.value / 100, s.electrons(s.noise.dsnu_mv.value)
    sigma_fixed = np.hypot(prnu * limit, 0.0 if by_well else dsnu)
    mean = electrons + nodes * sigma_fixed
    sigma = np.sqrt(mean + before)
    a = (limit - mean) / sigma
    first = norm.cdf(a) * mean - sigma * norm.pdf(a) + limit * norm.sf(a)
    second = norm.cdf(a) * (mean**2 + sigma**2) - sigma * norm.pdf(a) * (mean + limit) + limit**2 * norm.sf(a)
    variance = ((second - first**2 + after) * weights).sum(1) / weights.sum()
    return float(electrons[np.argmax(variance), 0] / efficiency)


def truth(sensor, *, photons_known, dark_exposures_s=(0.0,)):
    """What a calibration should find, by parameter; DSNU1288 is that of dark frames of the exposure of each pixel."""
    s = sensor
    gain = s.system_gain_dn_per_e
    read_e = s.electrons(s.noise.read_noise_mv.value)
    dsnu_e = s.electrons(s.noise.dsnu_mv.value)
    rate_spread_e = s.electrons(s.noise.dark_voltage_mv_per_s.value) * s.noise.dcnu_percent.value / 100
    dsnu1288_e = np.sqrt(np.mean([dsnu_e**2 + (rate_spread_e * t) ** 2 for t in dark_exposures_s]))
    prnu = s.noise.prnu_percent.value
    capacity = s.saturation_capacity_e
    threshold_e = np.sqrt((read_e * gain) ** 2 / gain**2 + 1 / 12 / gain**2 + 0.25) + 0.5
    result = {
        "read_noise_dn": read_e * gain,
        "read_noise_e": read_e,
        "read_noise_mv": s.noise.read_noise_mv.value,
        "dsnu_dn": dsnu_e * gain,
        "dsnu_e": dsnu_e,
        "dsnu_mv": s.noise.dsnu_mv.value,
        "prnu_percent": prnu,
        "dark_voltage_mv_per_s": s.noise.dark_voltage_mv_per_s.value,
        "dark_current_dn_per_s": s.electrons(s.noise.dark_voltage_mv_per_s.value) * gain,
        "dark_current_e_per_s": s.electrons(s.noise.dark_voltage_mv_per_s.value),
        "dark_current_from_variance_e_per_s": s.electrons(s.noise.dark_voltage_mv_per_s.value),
        "dcnu_percent": s.noise.dcnu_percent.value,
        "black_level_dn": s.readout.black_level_dn.value,
        "system_gain_dn_per_e": gain,
        "conversion_gain_uv_per_e": s.pixel.conversion_gain_uv_per_e.value,
        "saturation_dn": s.readout.black_level_dn.value + capacity * gain,
        "temporal_dark_noise_e": read_e,
        "dsnu1288_e": dsnu1288_e,
        "dsnu1288_pixel_e": dsnu1288_e,
        "dsnu1288_row_e": 0.0,
        "dsnu1288_column_e": 0.0,
        "dsnu1288_filtered_e": dsnu1288_e,
        "dsnu1288_filtered_pixel_e": dsnu1288_e,
        "dsnu1288_filtered_row_e": 0.0,
        "dsnu1288_filtered_column_e": 0.0,
        "prnu1288_percent": prnu,
        "prnu1288_pixel_percent": prnu,
        "prnu1288_row_percent": 0.0,
        "prnu1288_column_percent": 0.0,
        "prnu1288_unfiltered_percent": prnu,
        "prnu1288_unfiltered_pixel_percent": prnu,
        "prnu1288_unfiltered_row_percent": 0.0,
        "prnu1288_unfiltered_column_percent": 0.0,
    }
    if photons_known:
        efficiency = s.channels["M"].quantum_efficiency[0]
        result |= {
            "responsivity_dn_per_photon": efficiency * gain,
            "quantum_efficiency_percent": 100 * efficiency,
            "sensitivity_threshold_photons": threshold_e / efficiency,
            "saturation_capacity_photons": capacity / efficiency,
        }
    result |= {
        "saturation_capacity_e": capacity,
        "snr_max_db": 10 * np.log10(capacity),
        "dynamic_range_db": 20 * np.log10(capacity / threshold_e),
    }
    return result
