"""Quantum efficiency from frames under narrow bands of light and a photodiode's readings.

Farrell, Okincha and Parmar, "Sensor calibration and simulation", Proc. SPIE 6817 (2008), section 2: a monochromator
lights the bare sensor evenly, and a calibrated photodiode measures the light. A channel's electrons divided by the
photons are its quantum efficiency at that wavelength.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.bands import Band, SpectralFrames, band_matrix
from photosite.calibration.spectral.result import BandReading, ChannelEfficiency, SpectralCalibration
from photosite.calibration.spectral.signals import SpectralSignals, read_signals
from photosite.calibration.spectral.smooth_prior import smooth_positive_estimate
from photosite.calibration.withheld import BAND_NOT_USED, UNUSABLE_SPECTRAL_FRAMES, VARYING_LIGHT
from photosite.errors import InputError
from photosite.sensor.model import Sensor
from photosite.values.uncertain import Measured

MOST_AMPLIFICATION = 5.0
"""Largest factor by which the correction for the bandwidth may raise the noise; above it, a prior is added."""

_STEP_NM = 0.1
"""Step of the numerical derivative of the photons with respect to a band's wavelength."""

_SIGNIFICANT = 3.0
"""Standard uncertainties outside 0 to 1 at which a quantum efficiency is rejected as impossible."""


def calibrate_spectral(
    frames: SpectralFrames, sensor: Sensor | None = None, *, progress: Callable[[int, int], None] | None = None
) -> SpectralCalibration:
    """Measure the quantum efficiency of every color channel, with standard uncertainty.

    Parameters
    ----------
    frames
        Bands, dark frames and readings, as `open_spectral` returns them.
    sensor
        Sensor that supplies system gain, pixel size and fill factor with their uncertainties, as measured by
        `calibrate` for this camera. Default: the sensor named by the measurement.
    progress
        Called with (frames read, frames to read) after each frame.

    Returns
    -------
    SpectralCalibration

    Raises
    ------
    InputError
        If no sensor is given, or it does not match the frames.
    FileError
        If a frame cannot be read or differs in format from the others.
    CalibrationError
        If the sensor's gain is only assumed, dark frames are clipped, a channel has no usable band, or a quantum
        efficiency is impossible.

    Notes
    -----
    The mean over a band's photons is m = (light - dark) / (K H A F): digital numbers above dark, divided by system gain
    K, photons per area H, pixel area A and fill factor F. The response q at the bands' centers, linear between them as
    in a sensor file, follows from all means: q = B^-1 m, where B holds the fraction of each center's hat function in
    each band's photons (`band_matrix`). For narrow bands B is the identity. If the inversion would raise the noise more
    than fivefold, a smoothness prior is added (`smooth_positive_estimate`) and `method` reports it. At the first and
    last band, the difference between a constant and a zero response beyond them counts as a standard uncertainty.

    The covariance of q contains, per band, frame noise, flicker and readings; common to some bands, shared dark frames,
    the shutter and the photodiode's table; common to all, gain, pixel area, fill factor and the photodiode's scale. The
    uncertainty of a band's wavelength is propagated through the slopes of q and of the photons (GUM, JCGM 100:2008,
    5.2).

    A sensor file states the quantum efficiency per photon on the photodetector. That of EMVA 1288, per photon on the
    pixel area, is smaller by the fill factor.

    Examples
    --------
    A monochrome sensor of 7.98 e⁻/DN; half of the photons become electrons:

    >>> import numpy as np
    >>> import photosite as ps
    >>> from photosite.calibration.spectral.bands import triangular_passband
    >>> from photosite.frames.frame_set import FrameSource
    >>> flat = {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}
    >>> sensor = ps.load_sensor("nikon-d200").with_(cfa="mono", channels=flat)
    >>> rng = np.random.default_rng(1)
    >>> def sources(electrons):
    ...     stack = np.uint16(64 + rng.poisson(electrons, (4, 16, 16)) / 7.98 + rng.normal(0, 1, (4, 16, 16)))
    ...     return tuple(FrameSource(f"{electrons}-{i}", lambda dn=dn: dn) for i, dn in enumerate(stack))
    >>> bands = []
    >>> for nm in (500.0, 550.0, 600.0):
    ...     light = triangular_passband(nm, 10.0)
    ...     photons = 0.01 * light.photons_per_joule * 0.01 * sensor.pixel_area_m2 * 0.9  # 0.01 W/m2, 0.01 s
    ...     bands.append(Band(f"{nm} nm", light, 0.01, sources(0.5 * photons), Measured(0.01)))
    >>> frames = SpectralFrames(tuple(bands), {0.01: sources(0)}, 16, 16, 12, (("M",),))
    >>> calibrate_spectral(frames, sensor).channels["M"].quantum_efficiency.round(2)
    array([0.5, 0.5, 0.5])
    """
    known = _checked_sensor(frames, sensor)
    levels = read_signals(frames, known, progress)
    channels = {
        name: _channel(name, number, frames.bands, levels, known, frames)
        for number, name in enumerate(known.channel_names)
    }
    found = [
        BAND_NOT_USED(f"channel {name}: {band} not used: {reason}")
        for name, channel in channels.items()
        for band, reason in channel.left_out.items()
    ]
    if levels.flicker > 0:
        percent = 100 * levels.flicker
        text = f"the light varies by {percent:.2g} % between frames; the uncertainties include this"
        found.append(VARYING_LIGHT(text, levels.flicker))
    return SpectralCalibration(
        channels=channels,
        bands=tuple(_reading(band) for band in frames.bands),
        light=f"{len(frames.bands)} bands of light",
        base=known,
        source=frames.source,
        frame_count=frames.frame_count,
        frames_sha256=levels.sha256,
        diagnostics=tuple(found),
    )


def _checked_sensor(frames: SpectralFrames, sensor: Sensor | None) -> Sensor:
    known = frames.sensor if sensor is None else sensor
    if known is None:
        raise InputError(
            "the gain and pixel size of the sensor are unknown",
            where=frames.source,
            hint="Name the sensor file in the protocol ('sensor:') or pass {sensor}",
            arguments={"sensor": "mine.sensor.yaml"},
        )
    if (known.readout.bits, known.array.cfa) != (frames.bits, frames.cfa):
        raise InputError(
            "sensor",
            where=frames.source,
            value=f"'{known.name}', {known.readout.bits} bits, CFA {known.array.cfa}",
            expected=f"the sensor that took the frames, {frames.bits} bits, CFA {frames.cfa}",
        )
    check_gain_known(known)
    return known


def check_gain_known(sensor: Sensor) -> None:
    """Raise `CalibrationError` if a sensor's system gain was neither measured nor published, but assumed."""
    for what in ("conversion_gain_uv_per_e", "voltage_swing_v", "analog_gain"):
        if sensor.measured(what).assumed:
            raise UNUSABLE_SPECTRAL_FRAMES.error(
                what,
                where=f"sensor '{sensor.name}'",
                expected="measured, not assumed",
                hint="Measure the gain first (photosite calibrate STACK -o FILE) and use that sensor file",
            )


def _reading(band: Band) -> BandReading:
    photons, light = band.photons_m2(), band.passband
    uncertainty = photons.standard_uncertainty
    return BandReading(band.name, light.centre_nm, light.fwhm_nm, band.exposure_s, photons.value, uncertainty)


def _channel(
    name: str, number: int, bands: tuple[Band, ...], levels: SpectralSignals, sensor: Sensor, frames: SpectralFrames
) -> ChannelEfficiency:
    left_out = {band.name: reason for band, reason in zip(bands, levels.reasons[number], strict=True) if reason}
    keep = [index for index, reason in enumerate(levels.reasons[number]) if not reason]
    if not keep:
        where, reason = f"{frames.source}: channel {name}", next(iter(left_out.values()))
        raise UNUSABLE_SPECTRAL_FRAMES.error(f"no band is usable ({reason})", where=where)
    used = tuple(bands[index] for index in keep)
    signal_dn = levels.signal_dn[number, keep]
    photons = np.array([band.photons_m2().value for band in used])
    per_photon = 1.0 / (sensor.system_gain_dn_per_e * photons * sensor.pixel_area_m2 * sensor.pixel.fill_factor.value)
    mean = signal_dn * per_photon
    alone = levels.covariance_dn2[number][np.ix_(keep, keep)] * np.outer(per_photon, per_photon)
    readings = _reading_relative(used, frames)
    passbands = tuple(band.passband for band in used)
    matrix = band_matrix(passbands)
    centres = np.array([band.passband.centre_nm for band in used])
    ends = (band_matrix(passbands, beyond="zero") - matrix) @ mean
    alone = alone + np.diag(ends**2)
    if solved := _amplification(matrix) <= MOST_AMPLIFICATION:
        inverse = np.linalg.inv(matrix)
        efficiency = inverse @ mean
        covariance = inverse @ (alone + readings * np.outer(mean, mean)) @ inverse.T
    else:
        smooth = smooth_positive_estimate(matrix, mean, alone, centres, relative=readings)
        efficiency, covariance = smooth.mean, smooth.covariance
    covariance = covariance + np.diag(_wavelength_variance(efficiency, centres, used))
    areas = [_relative(band.photodiode.area_mm2) for band in frames.bands if band.photodiode is not None]
    scale = math.hypot(max(areas, default=0.0), frames.scale_uncertainty_percent / 100)  # common to all readings
    relative = math.hypot(common_relative_uncertainty(sensor), scale)
    covariance = covariance + relative**2 * np.outer(efficiency, efficiency)
    result = ChannelEfficiency(
        wavelength_nm=centres,
        quantum_efficiency=efficiency,
        covariance=covariance,
        band_mean=mean,
        common_relative_uncertainty=relative,
        method="corrected for bandwidth" if solved else "corrected for bandwidth with a smoothness prior",
        left_out=left_out,
    )
    _check_possible(name, result, frames)
    return result


def _amplification(matrix: NDArray[np.float64]) -> float:
    """Return the largest factor by which the inversion raises a band's independent noise; infinite if singular."""
    if np.linalg.cond(matrix) > 1e12:
        return math.inf
    return float(np.linalg.norm(np.linalg.inv(matrix), axis=1).max())


def _reading_relative(bands: tuple[Band, ...], frames: SpectralFrames) -> NDArray[np.float64]:
    """Return the relative covariance (bands, bands) due to readings, the photodiode's table and the shutter."""
    reading = np.array([band.reading.standard_uncertainty / band.reading.value for band in bands])
    relative = np.diag(reading**2)
    found = [band.diode_deviations() for band in bands]
    if entries := max(each.size for each in found):
        deviations = np.stack([np.pad(each, (0, entries - each.size)) for each in found])
        relative = relative + deviations @ deviations.T
    exposures = np.array([band.exposure_s for band in bands])
    shutter = frames.exposure_uncertainty_percent / 100
    return np.asarray(relative + shutter**2 * (exposures[:, None] == exposures[None, :]))


def _wavelength_variance(
    efficiency: NDArray[np.float64], centres: NDArray[np.float64], bands: tuple[Band, ...]
) -> NDArray[np.float64]:
    """Return the variance due to the uncertainty of the bands' wavelengths.

    A band at a longer wavelength than nominal samples the response there, and has more photons per joule than computed.
    The value changes by q' + q d(ln H)/dl per nm.
    """
    uncertainty = np.array([band.centre_uncertainty_nm for band in bands])
    if not uncertainty.any():
        return np.zeros(len(bands))
    slope = np.gradient(efficiency, centres) if len(bands) > 1 else np.zeros(1)
    photons = np.array([math.log(b.photons_m2(_STEP_NM).value / b.photons_m2(-_STEP_NM).value) for b in bands])
    return np.asarray(((slope + efficiency * photons / (2 * _STEP_NM)) * uncertainty) ** 2)


def common_relative_uncertainty(sensor: Sensor) -> float:
    """Return the relative standard uncertainty that gain and pixel give all quantum efficiencies of a sensor."""
    names = ("conversion_gain_uv_per_e", "voltage_swing_v", "analog_gain", "width_um", "height_um", "fill_factor")
    return math.hypot(*(_relative(sensor.measured(name)) for name in names))


def _relative(quantity: Measured) -> float:
    return quantity.standard_uncertainty / quantity.value


def _check_possible(name: str, channel: ChannelEfficiency, frames: SpectralFrames) -> None:
    """Reject quantum efficiencies outside 0 to 1 beyond their uncertainty."""
    value, uncertainty = channel.quantum_efficiency, channel.standard_uncertainty
    high = int(np.argmax(value - 1.0 - _SIGNIFICANT * uncertainty))
    # With many bands without response, some are below 0 by chance. The limit is for all bands together.
    limit = _SIGNIFICANT + math.sqrt(2 * math.log(value.size))
    low = int(np.argmin(value + limit * uncertainty))
    if value[high] - 1.0 > _SIGNIFICANT * uncertainty[high]:
        place, expected = high, "at most 1"
        hint = "Check the unit of the readings (W/m2 or A), the exposure times, and the sensor's pixel size and gain"
    elif value[low] < -limit * uncertainty[low]:
        place, expected = low, f"0 or more within its uncertainty of {uncertainty[low]:.2g}"
        hint = "Check that the dark frames were taken without light, with the same exposure time and gain"
    else:
        return
    what, where = f"the quantum efficiency at {channel.wavelength_nm[place]:g} nm", f"{frames.source}: channel {name}"
    raise UNUSABLE_SPECTRAL_FRAMES.error(
        what, where=where, value=float(f"{value[place]:.3g}"), expected=expected, hint=hint
    )
