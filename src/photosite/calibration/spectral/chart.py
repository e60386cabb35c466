"""Quantum efficiency without a monochromator: from what a chart's patches read under known lights.

Reflectances and lights are smooth, and three channels under one light see eight or ten things that differ of a chart of
24 patches: the problem has no answer without a prior, and the answer's uncertainty is the prior's wherever the chart
says nothing. `photosite.calibration.spectral.smooth_prior` is that prior; intervals are wide where it alone speaks.
Several
lights of different kind (incandescent, daylight, fluorescent, LED) make them narrower.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.result import ChannelEfficiency, SpectralCalibration
from photosite.calibration.spectral.smooth_prior import smooth_positive_estimate
from photosite.calibration.spectral.spectral import check_gain_known, common_relative_uncertainty
from photosite.errors import CalibrationError, InputError
from photosite.sensor.model import Sensor


@dataclass(frozen=True, eq=False)
class ChartViews:
    """What the patches of a chart read. A view is a patch under a light.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,), increasing, where the quantum efficiency is wanted; it is linear between.
    unit_electrons
        (views, wavelengths): mean electrons that a quantum efficiency of 1 at one wavelength, falling to 0 at its
        neighbours, would make.
    electrons, standard_uncertainty
        (views, channels): mean electrons that the patches read, and the uncertainty that is each view's alone.
    usable
        (views, channels): false where a patch was saturated, say.
    patch, light
        (views,): which patch, which light.
    light_names
        What the lights are called.
    light_uncertainty_percent
        Relative standard uncertainty of each light's level, common to its views.
    source
        What was opened.
    frame_count, frames_sha256
        Of the frames behind the readings.

    Raises
    ------
    InputError
        If shapes do not fit or a value is not finite.
    """

    wavelength_nm: NDArray[np.float64]
    unit_electrons: NDArray[np.float64]
    electrons: NDArray[np.float64]
    standard_uncertainty: NDArray[np.float64]
    usable: NDArray[np.bool_]
    patch: NDArray[np.int64]
    light: NDArray[np.int64]
    light_names: tuple[str, ...]
    light_uncertainty_percent: float = 0.0
    source: str = "memory"
    frame_count: int = 0
    frames_sha256: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        views, channels = self.electrons.shape
        wanted = {
            "unit_electrons": (views, self.wavelength_nm.size),
            "standard_uncertainty": (views, channels),
            "usable": (views, channels),
            "patch": (views,),
            "light": (views,),
        }
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise InputError(f"{name} of {views} views has the shape {shape}, not {getattr(self, name).shape}")
        if not all(np.isfinite(v).all() for v in (self.unit_electrons, self.electrons, self.standard_uncertainty)):
            raise InputError("readings of a chart and their uncertainties must be finite numbers")
        if not (self.standard_uncertainty > 0).all():
            raise InputError("every reading of a chart has a standard uncertainty above 0")


def calibrate_chart(views: ChartViews, sensor: Sensor, *, seed: int = 0, draws: int = 4000) -> SpectralCalibration:
    """Quantum efficiency of every channel from a chart, with intervals that hold what the chart cannot tell.

    Parameters
    ----------
    views
        What the patches read, and what light was on them.
    sensor
        The camera's sensor; its gain and pixel were used to make electrons and photons of readings and light. Its own
        quantum efficiencies are not looked at.
    seed, draws
        Of the posterior; see `smooth_positive_estimate`.

    Returns
    -------
    SpectralCalibration
        Values are posterior means. `interval_95` is the shortest 95 % interval at each wavelength.

    Raises
    ------
    InputError
        If the views have other channels than the sensor.
    CalibrationError
        If the sensor's gain is an assumption, or a channel has fewer than three usable views.

    Notes
    -----
    The regularisation is not chosen but averaged over, by marginal likelihood. Errors of the reflectances and lights
    beyond what was said are looked for, and counted, in the same way.
    """
    check_gain_known(sensor)
    names = sensor.channel_names
    if views.electrons.shape[1] != len(names):
        raise InputError(f"the views have {views.electrons.shape[1]} channels, sensor '{sensor.name}' {len(names)}")
    common = common_relative_uncertainty(sensor)
    channels = {}
    warnings = []
    for number, name in enumerate(names):
        keep = views.usable[:, number]
        if keep.sum() < 3:
            raise CalibrationError(f"{views.source}: channel {name} has {keep.sum()} usable patches; expose for less")
        if left := int((~keep).sum()):
            warnings.append(f"channel {name}: {left} of {keep.size} patches left out: saturated")
        read, light = views.electrons[keep, number], views.light[keep]
        relative = (light[:, None] == light) * (views.light_uncertainty_percent / 100) ** 2 + common**2
        found = smooth_positive_estimate(
            views.unit_electrons[keep],
            read,
            np.diag(views.standard_uncertainty[keep, number] ** 2),
            views.wavelength_nm,
            relative=relative,
            groups=views.patch[keep],
            seed=seed + number,
            draws=draws,
        )
        channels[name] = ChannelEfficiency(
            wavelength_nm=views.wavelength_nm,
            quantum_efficiency=found.mean,
            covariance=found.covariance,
            band_mean=None,
            common_relative_uncertainty=common,
            method=(
                f"smoothness prior of {found.length_nm:.0f} nm; the chart told {found.determined:.1f} numbers of "
                f"{views.wavelength_nm.size}; light known to {100 * found.misfit:.2g} %"
            ),
            shortest_95=(found.lower_95, found.upper_95),
        )
    return SpectralCalibration(
        channels=channels,
        bands=(),
        light=f"{', '.join(views.light_names)} on a chart of {np.unique(views.patch).size} patches",
        base=sensor,
        source=views.source,
        frame_count=views.frame_count,
        frames_sha256=views.frames_sha256,
        warnings=tuple(warnings),
    )
