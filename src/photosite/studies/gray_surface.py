"""The signal-to-noise ratio of an even gray surface, from the description of a camera, without frames."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.camera.camera import Camera
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM
from photosite.errors import InputError
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.combined_noise import TEMPORAL_SOURCES, CombinedNoise, Transition
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import NoiseTerms
from photosite.values.cfa import channel_sites
from photosite.values.exposure import check_exposure

Array = NDArray[np.float64]

_STEP_NM = 10.0
_FAR_M = 1e3


def snr(
    camera: Camera,
    scene: Scene | None = None,
    *,
    luminance_cd_m2: float = 100.0,
    exposure_s: float = 1 / 60,
    illuminant: str | float = "D65",
) -> dict[str, float]:
    """Return the signal-to-noise ratio of one pixel that sees an even surface, for `sweep`.

    The pixel is of the channel with the largest signal, on the optical axis. The noise is that of one frame: photons,
    dark current, read noise, rounding, DSNU, dark current nonuniformity and PRNU. Of several captures, it is that of
    the combined frame.

    Parameters
    ----------
    camera
        The camera.
    scene
        The light of the surface: the mean spectrum of a scene. None: a surface of `luminance_cd_m2` under `illuminant`.
    luminance_cd_m2, illuminant
        Luminance of the surface and its light, without a scene.
    exposure_s
        Exposure time.

    Returns
    -------
    dict
        `signal_e` and `noise_e` in electrons; `snr_db`, 20 log10 of their ratio, NaN for a saturated pixel. For each
        transition between captures, `switch_1_e` and so on: the signal at its middle.

    Raises
    ------
    InputError
        If the exposure time or the luminance is not above 0, or the illuminant is unknown.

    Examples
    --------
    >>> import photosite as ps
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=4, focal_length_mm=50), ps.load_sensor("nikon-d200"))
    >>> {name: round(value, 1) for name, value in ps.studies.snr(camera).items()}
    {'signal_e': 6097.0, 'noise_e': 107.0, 'snr_db': 35.1}
    """
    time_s = check_exposure(exposure_s)
    if scene is None:
        if not (np.isfinite(luminance_cd_m2) and luminance_cd_m2 > 0):
            raise InputError("luminance_cd_m2", value=luminance_cd_m2, expected="above 0")
        rates = electron_rates(camera, illuminant) * luminance_cd_m2
    else:
        mean = scene.weights.mean(axis=(1, 2), dtype=np.float64) @ scene.basis
        rates = _rates(camera, Scene.uniform(mean, scene.wavelength_nm, scene.distance_m))
    signal_e = float(rates.max()) * time_s
    noise_e = math.sqrt(float(total_variance_e2(camera.sensor, signal_e, time_s)))
    saturated = signal_e > light_capacity_e(camera.sensor, time_s)
    ratio_db = math.nan if saturated or signal_e == 0 else 20.0 * math.log10(signal_e / noise_e)
    found = {"signal_e": signal_e, "noise_e": noise_e, "snr_db": ratio_db}
    switches = transitions(camera.sensor, time_s)
    return found | {f"switch_{number}_e": each.light_e for number, each in enumerate(switches, start=1)}


def electron_rates(camera: Camera, illuminant: str | float = "D65") -> Array:
    """Return (channels,) electrons per second of a pixel on the axis that sees a surface of 1 cd/m2."""
    return _rates(camera, _surface(camera.sensor, illuminant))


def _surface(sensor: Sensor, illuminant: str | float) -> Scene:
    """Return an even field over all wavelengths that the sensor responds to, as far as the illuminant is known."""
    first = min(DEFAULT_WAVELENGTH_NM[0], *(channel.wavelength_nm[0] for channel in sensor.channels.values()))
    last = max(DEFAULT_WAVELENGTH_NM[-1], *(channel.wavelength_nm[-1] for channel in sensor.channels.values()))
    steps = math.ceil((last - first) / _STEP_NM)
    grid = first + _STEP_NM * np.arange(steps + 1)
    try:
        return charts.uniform(illuminant, 1.0, wavelength_nm=grid, distance_m=_FAR_M)
    except InputError as error:
        if (known := error.arguments.get("band_range_nm")) is None:
            raise
        known_grid = np.unique(np.clip(grid, *known))
        return charts.uniform(illuminant, 1.0, wavelength_nm=known_grid, distance_m=_FAR_M)


def _rates(camera: Camera, field: Scene) -> Array:
    cfa = camera.sensor.array.cfa
    tile = camera.sensor.with_(rows=len(cfa), cols=len(cfa[0]), maps=None)
    mean = replace(camera, sensor=tile).mean_electrons(field, 1.0)
    sites = [channel_sites(cfa, name) for name in camera.sensor.channel_names]
    return np.array([np.mean([mean[site] for site in of_channel], dtype=np.float64) for of_channel in sites])


def total_variance_e2(sensor: Sensor, signal_e: ArrayLike, exposure_s: float) -> Array:
    """Return the variance over the pixels of one frame of an even surface, in electrons squared.

    Photons, dark current, read noise, rounding, DSNU, dark current nonuniformity and PRNU (`sensor.noise_terms`); of
    several captures, that of the combined frame (`sensor.combined_noise`).

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200")
    >>> (total_variance_e2(sensor, [0.0, 1e4], 0.0) ** 0.5).round(1)
    array([ 25.3, 152.7])
    """
    if sensor.captures is not None:
        return CombinedNoise(sensor, exposure_s).variance_e2(signal_e)
    signal, terms = np.asarray(signal_e, np.float64), NoiseTerms(sensor)
    dark_e = dark_signal_e(sensor, exposure_s)
    uneven = (sensor.noise.dcnu_percent.value / 100.0 * dark_e) ** 2 * terms.independent_fraction
    charge = terms.linear * (signal + dark_e) + uneven + terms.prnu2 * signal**2
    return np.asarray(charge + terms.floor_e2(signal + dark_e) + terms.rounding_e2(signal + dark_e))


def sensitivity_threshold_e(sensor: Sensor, exposure_s: float) -> float:
    """Return the electrons from light at which a pixel's ratio over time is 1 (EMVA 1288 R4.0).

    Raises
    ------
    InputError
        If the combined frame of several captures does not reach that ratio.
    """
    if sensor.captures is not None:
        threshold_e = CombinedNoise(sensor, exposure_s, TEMPORAL_SOURCES).signal_at_snr_e(0.0)
        if threshold_e is None:
            raise InputError("captures", where=f"sensor '{sensor.name}'", expected="a ratio of signal to noise above 1")
        return threshold_e
    terms, dark_e = NoiseTerms(sensor), dark_signal_e(sensor, exposure_s)
    variance_e2 = terms.shot * dark_e + terms.read_e2 + terms.induced_e2 + float(terms.rounding_e2(dark_e))
    return math.sqrt(variance_e2 + 0.25) + 0.5


def transitions(sensor: Sensor, exposure_s: float) -> tuple[Transition, ...]:
    """Return the transitions between captures, from the dark to the bright; none for a single capture."""
    return () if sensor.captures is None else CombinedNoise(sensor, exposure_s).transitions


def dark_signal_e(sensor: Sensor, exposure_s: float) -> float:
    """Return the mean electrons of the dark current in an exposure, of a sensor with one capture."""
    return sensor.electrons(sensor.noise.dark_voltage_mv_per_s.value) * exposure_s


def light_capacity_e(sensor: Sensor, exposure_s: float) -> float:
    """Return the electrons from light at which a pixel saturates: saturation capacity less the dark signal.

    Of several captures, it is the light at which the combined frame saturates.

    Examples
    --------
    >>> import photosite as ps
    >>> warm = ps.load_sensor("nikon-d200").with_(dark_current_e_per_s=100)
    >>> round(light_capacity_e(warm, 0.0) - light_capacity_e(warm, 10.0), 6)
    1000.0
    """
    if sensor.captures is not None:
        return CombinedNoise(sensor, exposure_s).light_capacity_e
    return sensor.saturation_capacity_e - dark_signal_e(sensor, exposure_s)
