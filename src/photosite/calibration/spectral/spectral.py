"""Quantum efficiency from frames under narrow bands of light and a photodiode's readings.

Farrell, Okincha and Parmar, "Sensor calibration and simulation", Proc. SPIE 6817 (2008), section 2: a monochromator's
light falls evenly on the bare sensor, a calibrated photodiode tells how much it is, and each colour channel's electrons
over the photons are its quantum efficiency at that wavelength.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.frames import Band, SpectralFrames
from photosite.calibration.spectral.levels import SpectralLevels, spectral_levels
from photosite.calibration.spectral.passband import band_matrix
from photosite.calibration.spectral.result import BandReading, ChannelEfficiency, SpectralCalibration
from photosite.calibration.spectral.smooth_prior import smooth_positive_estimate
from photosite.errors import CalibrationError, InputError
from photosite.sensor.model import Sensor
from photosite.values.measured import Measured

MOST_AMPLIFICATION = 5.0
"""Of the bands' own noise by taking their widths off: beyond it the band means are kept instead."""

_STEP_NM = 0.1
"""Shift for the derivative of the photons with a band's wavelength."""

_SIGNIFICANT = 3.0
"""Standard uncertainties by which a quantum efficiency may lie outside 0 to 1 before it is called impossible."""


def calibrate_spectral(
    frames: SpectralFrames, sensor: Sensor | None = None, *, progress: Callable[[int, int], None] | None = None
) -> SpectralCalibration:
    """Quantum efficiency of every colour channel, with standard uncertainty.

    Parameters
    ----------
    frames
        The measurement: bands, darks, readings (`photosite.calibration.spectral.protocol.open_spectral`).
    sensor
        Tells system gain, pixel size and fill factor, with their uncertainties: what `calibrate` gave for this camera.
        Without it, the sensor that the measurement names.
    progress
        Called with (frames read, frames to read) after each frame.

    Returns
    -------
    SpectralCalibration

    Raises
    ------
    InputError
        If no sensor is known, or it cannot be the one of the frames.
    FileError
        If a frame cannot be read or is unlike the others.
    CalibrationError
        If the sensor's gain is an assumption, dark frames are clipped, a channel has no band left, or a quantum
        efficiency cannot be true.

    Notes
    -----
    The mean over a band's photons is m = (light - dark) / (K H A F): digital numbers above dark, over system gain K,
    photons H per area, pixel area A and fill factor F. It is an average over the band, so the response, taken as linear
    between the bands' centres (as a sensor file is read), is solved from all of them: q = B^-1 m, B the share of each
    centre's hat function in each band's photons. For narrow bands B is the identity. Where bands overlap so much that
    solving would raise the noise more than fivefold, a smoothness prior is added (`smooth_positive_estimate`), and
    `method` says so. At the first and last band the difference between a response that goes on level beyond them
    and one that is zero there, as a sensor file says, counts as a standard uncertainty.

    The covariance of q holds, band by band, the frames' noise, the lamp's flicker and the readings; common to some
    bands, the darks that they share, the shutter, the photodiode's table; and common to all, gain, pixel area, fill
    factor and the photodiode's scale. An error of a band's wavelength enters through the slope of q and of the photons
    with wavelength (GUM, JCGM 100:2008, 5.2).

    What the sensor file calls quantum efficiency is per photon on the photodetector; EMVA 1288's, per photon on the
    pixel's area, is that times the fill factor.
    """
    known = _checked_sensor(frames, sensor)
    levels = spectral_levels(frames, known, progress)
    channels = {
        name: _channel(name, number, frames.bands, levels, known, frames)
        for number, name in enumerate(known.channel_names)
    }
    warnings = [
        f"channel {name}: {band} left out: {reason}"
        for name, channel in channels.items()
        for band, reason in channel.left_out.items()
    ]
    if levels.flicker > 0:
        warnings.append(f"the light flickers by {100 * levels.flicker:.2g} % from frame to frame; it is accounted for")
    return SpectralCalibration(
        channels=channels,
        bands=tuple(_reading(band) for band in frames.bands),
        light=f"{len(frames.bands)} bands of light",
        base=known,
        source=frames.source,
        frame_count=frames.frame_count,
        frames_sha256=levels.sha256,
        warnings=tuple(warnings),
    )


def _checked_sensor(frames: SpectralFrames, sensor: Sensor | None) -> Sensor:
    known = frames.sensor if sensor is None else sensor
    if known is None:
        raise InputError(
            f"{frames.source}: electrons and photons per pixel need the sensor's gain and size; name its sensor file "
            f"in the protocol ('sensor:') or with --sensor"
        )
    if (known.readout.bits, known.array.cfa) != (frames.bits, frames.cfa):
        raise InputError(
            f"sensor '{known.name}' has {known.readout.bits} bits and another colour filter array or converter than "
            f"the frames, which have {frames.bits} bits; take the sensor that took them"
        )
    check_gain_known(known)
    return known


def check_gain_known(sensor: Sensor) -> None:
    """Refuse a sensor whose system gain nobody measured or published.

    Raises
    ------
    CalibrationError
        If so.
    """
    for what, quantity in (
        ("conversion_gain_uv_per_e", sensor.pixel.conversion_gain_uv_per_e),
        ("voltage_swing_v", sensor.pixel.voltage_swing_v),
        ("analog_gain", sensor.readout.analog_gain),
    ):
        if quantity.assumed:
            raise CalibrationError(
                f"sensor '{sensor.name}': {what} is an assumption, so the system gain is not known; measure it first "
                f"(photosite calibrate STACK -o FILE) and name that file"
            )


def _reading(band: Band) -> BandReading:
    photons = band.photons_m2()
    return BandReading(
        band.name, band.passband.centre_nm, band.passband.fwhm_nm, band.exposure_s, photons.value,
        photons.standard_uncertainty,
    )  # fmt: skip


def _channel(
    name: str, number: int, bands: tuple[Band, ...], levels: SpectralLevels, sensor: Sensor, frames: SpectralFrames
) -> ChannelEfficiency:
    left_out = {band.name: reason for band, reason in zip(bands, levels.reasons[number], strict=True) if reason}
    keep = [index for index, reason in enumerate(levels.reasons[number]) if not reason]
    if not keep:
        raise CalibrationError(f"{frames.source}: channel {name} has no band left: {next(iter(left_out.values()))}")
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
    relative = math.hypot(common_relative_uncertainty(sensor), _diode_relative(frames))
    covariance = covariance + relative**2 * np.outer(efficiency, efficiency)
    result = ChannelEfficiency(
        wavelength_nm=centres,
        quantum_efficiency=efficiency,
        covariance=covariance,
        band_mean=mean,
        common_relative_uncertainty=relative,
        method="bands' widths taken off" if solved else "bands' widths taken off with a smoothness prior",
        left_out=left_out,
    )
    _check_possible(name, result, frames)
    return result


def _amplification(matrix: NDArray[np.float64]) -> float:
    """Largest factor by which solving raises a band's independent noise; infinite where it cannot be solved."""
    if np.linalg.cond(matrix) > 1e12:
        return math.inf
    return float(np.linalg.norm(np.linalg.inv(matrix), axis=1).max())


def _reading_relative(bands: tuple[Band, ...], frames: SpectralFrames) -> NDArray[np.float64]:
    """(bands, bands) relative covariance from readings, the photodiode's table and the shutter."""
    reading = np.array([band.reading.standard_uncertainty / band.reading.value for band in bands])
    relative = np.diag(reading**2)
    entries = max(band.diode_deviations().size for band in bands)
    if entries:
        deviations = np.zeros((len(bands), entries))
        for row, band in enumerate(bands):
            found = band.diode_deviations()
            deviations[row, : found.size] = found
        relative = relative + deviations @ deviations.T
    exposures = np.array([band.exposure_s for band in bands])
    shutter = frames.exposure_uncertainty_percent / 100
    relative = relative + shutter**2 * (exposures[:, None] == exposures[None, :])
    return np.asarray(relative)


def _wavelength_variance(
    efficiency: NDArray[np.float64], centres: NDArray[np.float64], bands: tuple[Band, ...]
) -> NDArray[np.float64]:
    """Variance from the bands' wavelengths.

    A band that lies higher shows the response of a higher place, and has other photons than were computed for the
    wavelength said: with both a value changes by q' + q d(ln H)/dl.
    """
    uncertainty = np.array([band.centre_uncertainty_nm for band in bands])
    if not uncertainty.any():
        return np.zeros(len(bands))
    slope = np.gradient(efficiency, centres) if len(bands) > 1 else np.zeros(1)
    photons = np.array([math.log(b.photons_m2(_STEP_NM).value / b.photons_m2(-_STEP_NM).value) for b in bands])
    return np.asarray(((slope + efficiency * photons / (2 * _STEP_NM)) * uncertainty) ** 2)


def common_relative_uncertainty(sensor: Sensor) -> float:
    """Relative standard uncertainty that gain and pixel give every quantum efficiency of a sensor alike."""
    pixel = sensor.pixel
    quantities = (
        pixel.conversion_gain_uv_per_e,
        pixel.voltage_swing_v,
        sensor.readout.analog_gain,
        pixel.width_um,
        pixel.height_um,
        pixel.fill_factor,
    )
    return math.hypot(*map(_relative, quantities))


def _diode_relative(frames: SpectralFrames) -> float:
    """Relative standard uncertainty common to all readings."""
    area = 0.0
    if frames.photodiode is not None and any(band.in_amperes for band in frames.bands):
        area = _relative(frames.photodiode.area_mm2)
    return math.hypot(area, frames.scale_uncertainty_percent / 100)


def _relative(quantity: Measured) -> float:
    return quantity.standard_uncertainty / quantity.value


def _check_possible(name: str, channel: ChannelEfficiency, frames: SpectralFrames) -> None:
    """A quantum efficiency lies between 0 and 1; one that does not, beyond its uncertainty, is nonsense by name."""
    value, uncertainty = channel.quantum_efficiency, channel.standard_uncertainty
    high = int(np.argmax(value - 1.0 - _SIGNIFICANT * uncertainty))
    if value[high] - 1.0 > _SIGNIFICANT * uncertainty[high]:
        raise CalibrationError(
            f"{frames.source}: channel {name} would give {value[high]:.3g} electrons per photon at "
            f"{channel.wavelength_nm[high]:g} nm, which cannot be; check the unit of the readings (W/m2, A), the "
            f"exposure times, and the sensor's pixel size and gain"
        )
    # Of many bands without response some come out below 0 by chance: the limit holds for all of them together.
    limit = _SIGNIFICANT + math.sqrt(2 * math.log(value.size))
    low = int(np.argmin(value + limit * uncertainty))
    if value[low] < -limit * uncertainty[low]:
        raise CalibrationError(
            f"{frames.source}: channel {name} would give {value[low]:.3g} electrons per photon at "
            f"{channel.wavelength_nm[low]:g} nm, below 0 by more than its uncertainty of {uncertainty[low]:.2g}; check "
            f"that its dark frames were taken in the dark, and with the same exposure and gain"
        )
