"""Quantum efficiency without a monochromator, from the patches of a chart under known lights.

Reflectances and lights are smooth, so three channels under one light provide only eight to ten independent numbers from
24 patches. The problem has no unique solution without a prior (`smooth_prior`). Where the chart is uninformative, the
interval is that of the prior. Several lights of different kinds (incandescent, daylight, fluorescent, LED) narrow it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.monochromator import check_gain_known, common_relative_uncertainty
from photosite.calibration.spectral.result import ChannelEfficiency, SpectralCalibration
from photosite.calibration.spectral.smooth_prior import smooth_positive_estimate
from photosite.calibration.withheld import BAND_NOT_USED, UNUSABLE_SPECTRAL_FRAMES
from photosite.errors import InputError
from photosite.sensor.model import Sensor
from photosite.values.shown import Shown


@dataclass(frozen=True, eq=False)
class ChartViews(Shown):
    """Signals of a chart's patches. A view is a patch under a light.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,) increasing. The quantum efficiency is estimated here and is linear between.
    unit_electrons
        (views, wavelengths) mean electrons that a quantum efficiency of 1 at one wavelength, and 0 at its neighbors,
        would produce.
    electrons, standard_uncertainty
        (views, channels) measured mean electrons, and the independent uncertainty of each view.
    usable
        (views, channels) False for saturated patches, for example.
    patch, light, light_names
        (views,) indices of patch and light; names of the lights.
    light_uncertainty_percent
        Relative standard uncertainty of each light's level, common to its views.
    source, frame_count, frames_sha256
        Where the measurement was read from; number and digests of the frames.
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
                raise InputError(name, value=getattr(self, name).shape, expected=f"an array of shape {shape}")
        if not all(np.isfinite(v).all() for v in (self.unit_electrons, self.electrons, self.standard_uncertainty)):
            raise InputError("electrons and their uncertainties", expected="finite")
        if not (self.standard_uncertainty > 0).all():
            raise InputError("standard_uncertainty", value=self.standard_uncertainty.min(), expected="above 0")


def calibrate_chart(views: ChartViews, sensor: Sensor, *, seed: int = 0, draws: int = 4000) -> SpectralCalibration:
    """Measure the quantum efficiency of every channel with a chart.

    Parameters
    ----------
    views
        Signals of the patches, and the light on them.
    sensor
        The camera's sensor, whose gain and pixel were used to compute electrons and photons. Its quantum efficiencies
        are ignored.
    seed, draws
        For sampling the posterior; see `smooth_positive_estimate`. Results are its means and shortest 95 % intervals.

    Raises
    ------
    InputError
        If the channels of the views and the sensor differ.
    CalibrationError
        If the sensor's gain is only assumed, or a channel has fewer than three usable views.

    Notes
    -----
    The regularization is not chosen but averaged over, weighted by marginal likelihood. Errors of the reflectances and
    lights beyond their stated uncertainty are estimated and included in the same way.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200")
    >>> grid = np.arange(400.0, 701.0, 50.0)
    >>> unit = np.random.default_rng(1).uniform(0, 1e4, (24, grid.size))    # of 24 patches
    >>> electrons = unit @ np.stack([sensor.response_at(name, grid) for name in "RGB"], axis=1)
    >>> known, light = np.ones((24, 3), bool), np.zeros(24, np.int64)
    >>> views = ChartViews(grid, unit, electrons, 0.01 * electrons, known, np.arange(24), light, ("A",))
    >>> green = calibrate_chart(views, sensor, draws=200).channels["G"]
    >>> bool(abs(green.quantum_efficiency[3] - sensor.response_at("G", 550.0)) < 0.05)
    True
    """
    check_gain_known(sensor)
    names = sensor.channel_names
    if views.electrons.shape[1] != len(names):
        expected = f"{len(names)} channels, as sensor '{sensor.name}' has"
        raise InputError("electrons", value=f"{views.electrons.shape[1]} channels", expected=expected)
    common, grid = common_relative_uncertainty(sensor), views.wavelength_nm
    channels = {}
    diagnostics = []
    for number, name in enumerate(names):
        keep = views.usable[:, number]
        if left := _left_out(views, keep, name):
            text = f"channel {name}: {left} of {keep.size} patches not used: saturated"
            diagnostics.append(BAND_NOT_USED(text, left))
        read, light = views.electrons[keep, number], views.light[keep]
        relative = (light[:, None] == light) * (views.light_uncertainty_percent / 100) ** 2 + common**2
        found = smooth_positive_estimate(
            views.unit_electrons[keep],
            read,
            np.diag(views.standard_uncertainty[keep, number] ** 2),
            grid,
            relative=relative,
            groups=views.patch[keep],
            seed=seed + number,
            draws=draws,
        )
        channels[name] = ChannelEfficiency(
            wavelength_nm=grid,
            quantum_efficiency=found.mean,
            covariance=found.covariance,
            band_mean=None,
            common_relative_uncertainty=common,
            method=(
                f"smoothness prior of {found.length_nm:.0f} nm; the chart determined {found.determined:.1f} of "
                f"{grid.size} numbers; relative error of the light {100 * found.misfit:.2g} %"
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
        diagnostics=tuple(diagnostics),
    )


def _left_out(views: ChartViews, keep: NDArray[np.bool_], name: str) -> int:
    if (count := int(keep.sum())) < 3:
        raise UNUSABLE_SPECTRAL_FRAMES.error(
            "usable patches",
            where=f"{views.source}: channel {name}",
            value=count,
            expected="at least 3",
            hint="Use shorter exposure times, so that fewer patches saturate",
        )
    return keep.size - count
