"""True parameters of a virtual sensor, computed from its description."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from photosite.calibration.result import Calibration
from photosite.camera.optical_stack import channel_mixing
from photosite.color.spectrum import integration_weights
from photosite.optics.lens import Optics
from photosite.scene.scene import Scene
from photosite.sensor.effects.line_pattern import LinePattern
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.studies.effect_study import TrueTerms, true_terms
from photosite.studies.virtual_lab import VirtualLab
from photosite.values.cfa import channel_sites


def true_parameters(sensor: Sensor, light: Scene | None = None, optics: Optics | None = None) -> dict[str, float]:
    """Return the true values of the parameters that `calibrate` estimates.

    Standard deviations are those of the population that the chip is drawn from, not of its finite number of pixels.

    Parameters
    ----------
    sensor
        The true sensor.
    light, optics
        Uniform field of the light frames, and the lens. Without them the result has no quantum efficiency and no
        parameter in photons, because these depend on the light's spectrum.

    Returns
    -------
    dict
        Value by parameter name, in the unit of the name.

    Notes
    -----
    With K the system gain in DN/e- and g the conversion gain in uV/e-: x mV are 1000 x / g electrons, or K times that
    in DN. The saturation capacity is min(well, (2^bits - 1 - black) / K). EMVA 1288 R4.0, 2.6: SNR max is 10 log10 of
    it in dB; the sensitivity threshold in electrons is sqrt(read noise^2 + 1 / (12 K^2) + 1/4) + 1/2; the dynamic range
    is 20 log10 of the ratio of the two. Saturation in DN is the mean reading of full wells (`full_well_reading_dn`).
    The read noise contains telegraph noise: both are temporal noise of dark frames. Interpixel capacitance averages
    PRNU and DCNU by its kernel; gains of readout channels are part of both, and their offsets of DSNU. DSNU1288 and
    PRNU1288 equal DSNU and PRNU, because the virtual chip's pattern is white. The quantum efficiency is electrons over
    photons on the whole pixel area at all wavelengths of the light, mean over the pixels of the tile. The saturation
    capacity in photons is that of the most sensitive channel.

    Examples
    --------
    >>> import photosite as ps
    >>> truth = true_parameters(ps.load_sensor("nikon-d200"))
    >>> truth["read_noise_mv"], round(truth["read_noise_e"], 2), round(truth["read_noise_dn"], 3)
    (0.52, 17.33, 2.172)
    """
    noise, pixel = sensor.noise, sensor.pixel
    efficiencies = None if light is None or optics is None else channel_efficiencies(sensor, light, optics)
    terms = true_terms(sensor, efficiencies)
    scale = math.prod(each.digital_scale for each in terms)
    gain = sensor.system_gain_dn_per_e * scale
    blinking_e = math.sqrt(sum(each.read_variance_e2 for each in terms))
    offset_e, of_lines = _offset_e(terms), 100.0 * math.sqrt(sum(each.gain_variance for each in terms))
    read_mv, dsnu_mv = (
        math.hypot(spread.value, more_e / sensor.electrons(1.0))
        for spread, more_e in ((noise.read_noise_mv, blinking_e), (noise.dsnu_mv, offset_e))
    )
    read_e, dsnu_e = sensor.electrons(read_mv), sensor.electrons(dsnu_mv)
    pixel_prnu = math.hypot(math.prod(each.prnu_factor for each in terms) * noise.prnu_percent.value, of_lines)
    prnu = math.hypot(pixel_prnu, 100.0 * math.sqrt(sum(each.border_gain**2 for each in terms)))
    dark_e, dcnu = _dark_current(sensor, terms, of_lines)
    capacity_e = sensor.saturation_capacity_e
    threshold_e = math.sqrt(read_e**2 + QUANTIZATION_DN2 / gain**2 + 0.25) + 0.5
    truth = {
        "read_noise_dn": read_e * gain,
        "read_noise_e": read_e,
        "read_noise_mv": read_mv,
        "dsnu_dn": dsnu_e * gain,
        "dsnu_e": dsnu_e,
        "dsnu_mv": dsnu_mv,
        "prnu_percent": prnu,
        **dict.fromkeys(LinePattern.model_fields, 0.0),
        "interpixel_coupling_percent": 0.0,
        "dark_voltage_mv_per_s": dark_e / sensor.electrons(1.0),
        "dark_current_dn_per_s": dark_e * gain,
        "dark_current_e_per_s": dark_e,
        "dcnu_percent": dcnu,
        "black_level_dn": (sensor.readout.black_level_dn.value + sum(each.black_shift_dn for each in terms)) * scale,
        "system_gain_dn_per_e": gain,
        "conversion_gain_uv_per_e": pixel.conversion_gain_uv_per_e.value,
        "saturation_dn": full_well_reading_dn(sensor),
        "saturation_capacity_e": capacity_e,
        "temporal_dark_noise_e": read_e,
        "dsnu1288_e": dsnu_e,
        "prnu1288_percent": pixel_prnu,
        "snr_max_db": 10 * math.log10(capacity_e),
        "dynamic_range_db": 20 * math.log10(capacity_e / threshold_e),
    }
    if efficiencies is not None:
        tile = [name for row in sensor.array.cfa for name in row]
        fractions = [len(channel_sites(sensor.array.cfa, name)) / len(tile) for name in sensor.channel_names]
        mean = float(np.dot(efficiencies, fractions))
        truth |= {
            "quantum_efficiency_percent": 100 * mean,
            "responsivity_dn_per_photon": gain * mean,
            "sensitivity_threshold_photons": threshold_e / mean,
            "saturation_capacity_photons": capacity_e / max(efficiencies),
        }
    for each in terms:
        truth |= each.parameters
    return truth


def _offset_e(terms: Sequence[TrueTerms]) -> float:
    """Return the standard deviation of the offsets that effects add to the pixels, in electrons."""
    return math.sqrt(sum(each.offset_variance_e2 for each in terms))


def _dark_current(sensor: Sensor, terms: Sequence[TrueTerms], of_lines: float) -> tuple[float, float]:
    """Return mean (e-/s) and nonuniformity (percent) of the dark current over all pixels."""
    usual_e = sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value)
    percent = math.prod(each.dcnu_factor for each in terms) * sensor.noise.dcnu_percent.value
    mean_e, variance = usual_e + sum(x.dark_e_per_s for x in terms), sum(x.dark_variance for x in terms)
    if variance:
        percent = math.hypot(percent * usual_e, 100.0 * math.sqrt(variance)) / mean_e
    return mean_e, math.hypot(percent, of_lines)


def full_well_reading_dn(sensor: Sensor) -> float:
    """Return the mean DN over the pixels when all wells are full: noise and DSNU included, rounded and clipped.

    The mean of an integer n from 0 to N is the sum over k < N of P(n > k). Before rounding, the reading is normal with
    mean black + K well.

    Examples
    --------
    >>> import photosite as ps
    >>> d200 = ps.load_sensor("nikon-d200")
    >>> full_well_reading_dn(d200), round(full_well_reading_dn(d200.with_(well_capacity_e=7980)), 3)
    (4095.0, 1000.0)
    """
    terms = true_terms(sensor)
    signals = [each.signal_of_well_e for each in terms if each.signal_of_well_e is not None]
    full_e = signals[0] if signals else sensor.pixel.well_capacity_e.value
    mean = sensor.readout.black_level_dn.value + full_e * sensor.system_gain_dn_per_e
    offset_dn = _offset_e(terms) * sensor.system_gain_dn_per_e
    spread_mv = math.hypot(sensor.noise.read_noise_mv.value, sensor.noise.dsnu_mv.value)
    sigma = math.hypot(spread_mv / sensor.mv_per_dn, offset_dn)
    top = int(sensor.white_level_dn)
    if sigma == 0:
        return float(min(math.floor(mean + 0.5), top))
    return math.fsum(math.erfc((k + 0.5 - mean) / (sigma * math.sqrt(2))) / 2 for k in range(top))


def channel_efficiencies(sensor: Sensor, light: Scene, optics: Optics) -> list[float]:
    """Return electrons per photon on the whole pixel area, by channel, under a uniform field.

    Fill factor and crosstalk are included. The lens may change the light's spectrum.
    """
    grid = light.wavelength_nm
    spectrum = light.basis[0] * optics.irradiance_per_radiance(grid, light.distance_m) * integration_weights(grid)
    fraction = sensor.pixel.fill_factor.value / float(spectrum.sum())
    alone = [fraction * float(sensor.response_at(name, grid) @ spectrum) for name in sensor.channel_names]
    efficiencies: list[float] = (channel_mixing(sensor) @ alone).tolist()
    return efficiencies


def measured_truth(lab: VirtualLab, calibration: Calibration) -> dict[str, float]:
    """Return `true_parameters` of a laboratory, with the definitions that a calibration of it used."""
    sensor = lab.camera.sensor
    return as_defined(true_parameters(sensor, lab.light, lab.camera.optics), sensor, calibration)


def as_defined(truth: Mapping[str, float], sensor: Sensor, calibration: Calibration) -> dict[str, float]:
    """Return true parameters with the definitions that a calibration used.

    DSNU1288 includes the nonuniformity of the dark current in the exposure time of its dark frames. Parameters that
    have no true value with an effect of the sensor are left out.
    """
    terms = true_terms(sensor)
    spread = truth["dark_current_e_per_s"] * truth["dcnu_percent"] / 100
    exposures = [calibration.dsnu1288_exposure_s.get(name, math.nan) for row in sensor.array.cfa for name in row]
    dsnu1288_e = math.sqrt(truth["dsnu_e"] ** 2 + spread**2 * float(np.mean(np.square(exposures))))
    of_channels = 100.0 * math.sqrt(sum(float(each.gains.var()) for each in terms))
    defined = {
        **truth,
        "dsnu1288_e": dsnu1288_e,
        "dsnu1288_row_e": truth["row_offset_e"],
        "dsnu1288_column_e": truth["column_offset_e"],
        "dsnu1288_pixel_e": _less(dsnu1288_e, truth["row_offset_e"], truth["column_offset_e"]),
        "prnu1288_row_percent": 0.0,
        "prnu1288_column_percent": truth["column_gain_percent"],
        "prnu1288_pixel_percent": _less(truth["prnu1288_percent"], of_channels, truth["column_gain_percent"]),
        "prnu1288_unfiltered_percent": truth["prnu_percent"],
    }
    undefined = {name for each in terms for name in each.undefined}
    return {name: value for name, value in defined.items() if name not in undefined}


def _less(whole: float, *parts: float) -> float:
    """Return a standard deviation without parts of it."""
    return math.sqrt(max(whole**2 - sum(part**2 for part in parts), 0.0))
