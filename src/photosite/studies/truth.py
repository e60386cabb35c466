"""True parameters of a virtual sensor, computed from its description."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from photosite.camera.optical_stack import channel_mixing
from photosite.color.spectrum import integration_weights
from photosite.optics.lens import Optics
from photosite.scene.scene import Scene
from photosite.sensor.effects.line_pattern import LinePattern
from photosite.sensor.effects.model import Effects
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.cfa import channel_sites

if TYPE_CHECKING:
    from photosite.calibration.result import Calibration
    from photosite.studies.virtual_lab import VirtualLab

AT_SATURATION = (
    *("saturation_dn", "saturation_capacity_e", "saturation_capacity_photons"),
    *("snr_max_db", "dynamic_range_db"),
)
"""Parameters at saturation."""


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
    gain = sensor.system_gain_dn_per_e
    coupling = None if sensor.effects is None else sensor.effects.interpixel_capacitance
    averaged = 1.0 if coupling is None else math.sqrt(coupling.variance_share)
    offset_e, of_lines = _lines(sensor)
    pattern = (sensor.effects or Effects()).line_pattern or LinePattern()
    telegraph = None if sensor.effects is None else sensor.effects.telegraph_noise
    blinking_e = 0.0 if telegraph is None else math.sqrt(telegraph.variance_e2)
    read_mv, dsnu_mv = (
        math.hypot(spread.value, more_e / sensor.electrons(1.0))
        for spread, more_e in ((noise.read_noise_mv, blinking_e), (noise.dsnu_mv, offset_e))
    )
    read_e, dsnu_e = sensor.electrons(read_mv), sensor.electrons(dsnu_mv)
    prnu, dcnu = (math.hypot(averaged * spread.value, of_lines) for spread in (noise.prnu_percent, noise.dcnu_percent))
    capacity_e = sensor.saturation_capacity_e
    threshold_e = math.sqrt(read_e**2 + QUANTIZATION_DN2 / gain**2 + 0.25) + 0.5
    truth = {
        "read_noise_dn": read_e * gain,
        "read_noise_e": read_e,
        "read_noise_mv": read_mv,
        **_line_noise(sensor),
        "dsnu_dn": dsnu_e * gain,
        "dsnu_e": dsnu_e,
        "dsnu_mv": dsnu_mv,
        "prnu_percent": prnu,
        **{name: entry.value for name, entry in pattern},
        "interpixel_coupling_percent": 0.0 if coupling is None else coupling.coupling_percent.value,
        "dark_voltage_mv_per_s": noise.dark_voltage_mv_per_s.value,
        "dark_current_dn_per_s": sensor.electrons(noise.dark_voltage_mv_per_s.value) * gain,
        "dark_current_e_per_s": sensor.electrons(noise.dark_voltage_mv_per_s.value),
        "dcnu_percent": dcnu,
        "black_level_dn": sensor.readout.black_level_dn.value,
        "system_gain_dn_per_e": gain,
        "conversion_gain_uv_per_e": pixel.conversion_gain_uv_per_e.value,
        "saturation_dn": full_well_reading_dn(sensor),
        "saturation_capacity_e": capacity_e,
        "temporal_dark_noise_e": read_e,
        "dsnu1288_e": dsnu_e,
        "prnu1288_percent": prnu,
        "snr_max_db": 10 * math.log10(capacity_e),
        "dynamic_range_db": 20 * math.log10(capacity_e / threshold_e),
    }
    if light is not None and optics is not None:
        efficiencies = channel_efficiencies(sensor, light, optics)
        tile = [name for row in sensor.array.cfa for name in row]
        shares = [len(channel_sites(sensor.array.cfa, name)) / len(tile) for name in sensor.channel_names]
        mean = float(np.dot(efficiencies, shares))
        if coupling is not None:
            signal = [[efficiencies[sensor.channel_names.index(name)] for name in row] for row in sensor.array.cfa]
            averaged, border = _averaged(coupling.kernel(), np.array(signal), (sensor.array.rows, sensor.array.cols))
            prnu = math.hypot(averaged * noise.prnu_percent.value, of_lines)
            truth |= {"prnu_percent": math.hypot(prnu, 100.0 * border), "prnu1288_percent": prnu}
        truth |= {
            "quantum_efficiency_percent": 100 * mean,
            "responsivity_dn_per_photon": gain * mean,
            "sensitivity_threshold_photons": threshold_e / mean,
            "saturation_capacity_photons": capacity_e / max(efficiencies),
        }
    return truth


def _averaged(kernel: NDArray[np.float64], signal: NDArray[np.float64], shape: tuple[int, int]) -> tuple[float, float]:
    """Return what a 3 x 3 kernel leaves of a PRNU of 1, and the relative spread of the mean signal at the borders.

    Both are the root mean square over the pixels. `signal` is the mean signal of a tile before the kernel: a pixel
    receives signal and pattern of neighbors of other colors. Beyond the borders the outer pixels repeat, so that the
    outer pixels of a mosaic have neighbors of their own color.
    """
    tiles = [-(-size // step) for size, step in zip(shape, signal.shape, strict=True)]
    padded = np.pad(np.tile(signal, tiles)[: shape[0], : shape[1]], 1, "edge")
    mean, square = np.zeros(shape), np.zeros(shape)
    for (row, column), share in np.ndenumerate(kernel):
        part = share * padded[row : row + shape[0], column : column + shape[1]]
        mean += part
        square += part**2
    rows, columns = signal.shape
    sites = [mean[row::rows, column::columns] for row in range(rows) for column in range(columns)]
    border = np.mean([(site.std() / site.mean()) ** 2 for site in sites])
    return float(np.sqrt(np.mean(square / mean**2))), float(np.sqrt(border))


def _channels(sensor: Sensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return gains of the readout channels, with the mean 1, and their offsets in electrons."""
    channels = None if sensor.effects is None else sensor.effects.readout_channels
    if channels is None:
        return np.ones(1), np.zeros(1)
    relative, offset_e = channels.tables()
    return relative / relative.mean(), offset_e


def _lines(sensor: Sensor) -> tuple[float, float]:
    """Return the standard deviations of rows, columns and readout channels: offsets in electrons, gains in percent."""
    offset, gain = (0.0, 0.0) if sensor.effects is None else sensor.effects.line_variances
    return math.sqrt(offset), 100.0 * math.sqrt(gain)


def _line_noise(sensor: Sensor) -> dict[str, float]:
    truth: dict[str, float] = {}
    for name in ("row_noise", "column_noise"):
        mv = getattr(sensor.noise, f"{name}_mv").value
        electrons = sensor.electrons(mv)
        truth |= {f"{name}_dn": electrons * sensor.system_gain_dn_per_e, f"{name}_e": electrons, f"{name}_mv": mv}
    return truth


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
    full_e = well_e = sensor.pixel.well_capacity_e.value
    if sensor.effects is not None and (curve := sensor.effects.response_curve) is not None:
        full_e = float(curve.signal_e(well_e, well_e))
    mean = sensor.readout.black_level_dn.value + full_e * sensor.system_gain_dn_per_e
    offset_dn = _lines(sensor)[0] * sensor.system_gain_dn_per_e
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
    share = sensor.pixel.fill_factor.value / float(spectrum.sum())
    alone = [share * float(sensor.response_at(name, grid) @ spectrum) for name in sensor.channel_names]
    efficiencies: list[float] = (channel_mixing(sensor) @ alone).tolist()
    return efficiencies


def variance_peak_e(sensor: Sensor) -> float:
    """Return the mean electrons from light at which the temporal variance of a flat field is largest (EMVA's
    saturation).

    The variance rises with the light until pixels clip. PRNU and DSNU make the pixels clip at different light levels,
    so that the largest mean variance lies a few percent below saturation. Each pixel's noise is taken as normal; its
    clipped variance has a closed form.

    Examples
    --------
    >>> import photosite as ps
    >>> d200 = ps.load_sensor("nikon-d200")
    >>> round(variance_peak_e(d200) / d200.saturation_capacity_e, 3)
    0.966
    """
    from scipy.special import ndtr

    noise = sensor.noise
    read_e = sensor.electrons(noise.read_noise_mv.value)
    dsnu_e = math.hypot(sensor.electrons(noise.dsnu_mv.value), _lines(sensor)[0])
    limit_e = sensor.saturation_capacity_e
    by_well = sensor.pixel.well_capacity_e.value <= limit_e
    # The well clips electrons before read noise and offset are added; the converter clips their sum.
    inside, outside = (0.0, read_e**2) if by_well else (read_e**2, 0.0)
    nodes, weights = np.polynomial.hermite_e.hermegauss(21)
    gains = _channels(sensor)[0].ravel()

    lines = (sensor.effects or Effects()).line_pattern or LinePattern()
    response = math.hypot(noise.prnu_percent.value, lines.column_gain_percent.value) / 100

    def variance(electrons: NDArray[np.float64], limit_e: float) -> NDArray[np.float64]:
        mean = electrons + nodes * np.hypot(response * electrons, 0.0 if by_well else dsnu_e)
        sigma = np.sqrt(electrons + inside)
        a = (limit_e - mean) / sigma
        density = np.exp(-0.5 * a**2) / math.sqrt(2 * math.pi)
        first = ndtr(a) * mean - sigma * density + limit_e * ndtr(-a)
        second = ndtr(a) * (mean**2 + sigma**2) - sigma * density * (mean + limit_e) + limit_e**2 * ndtr(-a)
        return np.asarray((second - first**2 + outside) @ (weights / weights.sum()))

    def largest(low: float, high: float) -> float:
        electrons = np.linspace(low, high, 201)[:, None]
        # The converter clips a readout channel of larger gain at fewer electrons.
        parts = [g**2 * variance(electrons, limit_e if by_well else limit_e / g) for g in gains]
        return float(electrons[np.argmax(np.sum(parts, axis=0)), 0])

    near = largest(0.7 * limit_e, 1.1 * limit_e)
    return largest(near - 0.002 * limit_e, near + 0.002 * limit_e)


def measured_truth(lab: VirtualLab, calibration: Calibration) -> dict[str, float]:
    """Return `true_parameters` of a laboratory, with the definitions that a calibration of it used."""
    sensor = lab.camera.sensor
    return as_defined(true_parameters(sensor, lab.light, lab.camera.optics), sensor, calibration)


def as_defined(truth: Mapping[str, float], sensor: Sensor, calibration: Calibration) -> dict[str, float]:
    """Return true parameters with the definitions that a calibration used.

    Saturation is at the largest temporal variance where the calibration found one, otherwise where all pixels clip.
    DSNU1288 includes the nonuniformity of the dark current in the exposure time of its dark frames. Where pixels are
    coupled, their mean clips in another way: parameters at saturation are left out.
    """
    truth = dict(truth)
    spread = truth["dark_current_e_per_s"] * truth["dcnu_percent"] / 100
    exposures = [calibration.dsnu1288_exposure_s.get(name, math.nan) for row in sensor.array.cfa for name in row]
    truth["dsnu1288_e"] = math.sqrt(truth["dsnu_e"] ** 2 + spread**2 * float(np.mean(np.square(exposures))))
    of_channels = 100.0 * float(_channels(sensor)[0].std())
    truth |= {
        "dsnu1288_row_e": truth["row_offset_e"],
        "dsnu1288_column_e": truth["column_offset_e"],
        "dsnu1288_pixel_e": _less(truth["dsnu1288_e"], truth["row_offset_e"], truth["column_offset_e"]),
        "prnu1288_row_percent": 0.0,
        "prnu1288_column_percent": truth["column_gain_percent"],
        "prnu1288_pixel_percent": _less(truth["prnu1288_percent"], of_channels, truth["column_gain_percent"]),
        "prnu1288_unfiltered_percent": truth["prnu_percent"],
    }
    if of_channels:
        # Lines that alternate pass the high-pass filter in full, unlike lines at random.
        for name in ("prnu1288_percent", "prnu1288_row_percent", "prnu1288_column_percent"):
            del truth[name]
    if truth["interpixel_coupling_percent"]:
        return {name: value for name, value in truth.items() if name not in AT_SATURATION}
    if "largest temporal variance" in calibration.saturation_capacity_e.method:
        old, new = truth["saturation_capacity_e"], variance_peak_e(sensor)
        truth["saturation_capacity_e"] = new
        if "saturation_capacity_photons" in truth:
            truth["saturation_capacity_photons"] *= new / old
        truth["snr_max_db"] += 10 * math.log10(new / old)
        truth["dynamic_range_db"] += 20 * math.log10(new / old)
    return truth


def _less(whole: float, *parts: float) -> float:
    """Return a standard deviation without parts of it."""
    return math.sqrt(max(whole**2 - sum(part**2 for part in parts), 0.0))
