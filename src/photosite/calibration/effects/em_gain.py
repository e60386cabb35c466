"""Electron multiplication: gain and excess noise of a register, from two calibrations in the same light."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.photon_transfer.channel import Curve
from photosite.calibration.result import Calibration
from photosite.calibration.withheld import EFFECT_NOT_MEASURED, EM_GAIN_UNKNOWN, EXCESS_NOISE
from photosite.sensor.effects.em_gain import EmGain
from photosite.values.diagnostic import Diagnosed, Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate
from photosite.values.shown import Reported, ResultTable, Tabular
from photosite.values.uncertain import SIGMA_1_IN_1000, Measured, Missing, Uncertain, Value, derive

if TYPE_CHECKING:
    from photosite.sensor.model import Sensor

_BY_PHOTONS = "ratio of the responsivities"
_BY_EXPOSURE = "ratio of the slopes of the signal against the exposure time, in constant light"


@dataclass(frozen=True)
class EmGainResult(Diagnosed, Reported, Tabular):
    """Gain and excess noise of a multiplication register.

    Parameters
    ----------
    gain
        Mean electrons behind the register per electron in front of it.
    excess_noise_factor
        F^2, the variance of the signal over gain^2 times that of the charge.
    read_noise_e
        Read noise in electrons in front of the register.
    stated
        The register as known before: its stages, for the theory.
    unity, multiplied
        The calibrations without and with multiplication.
    """

    gain: Estimate
    excess_noise_factor: Estimate
    read_noise_e: Estimate
    stated: EmGain = field(default_factory=lambda: EmGain(gain=Measured(1.0)))
    unity: Calibration | None = field(default=None, repr=False, compare=False)
    multiplied: Calibration | None = field(default=None, repr=False, compare=False)

    @property
    def section(self) -> EmGain:
        """The register in the form of a sensor file; raise `CalibrationError` if the gain is not above 1."""
        measured = self.gain.measured(self.gain.method)
        if measured.value < 1.0:
            raise EM_GAIN_UNKNOWN.error(f"the gain, {measured.value:.3g}, is below 1", hint="Swap the two measurements")
        return self.stated.model_copy(update={"gain": measured})

    @property
    def theory(self) -> float:
        """F^2 of a register with this gain (Robbins and Hadwen)."""
        return self.section.excess_noise_factor

    @property
    def sensor(self) -> Sensor:
        """The sensor that was measured without multiplication, with the register.

        Raises
        ------
        CalibrationError
            As `Calibration.sensor`.
        """
        if self.unity is None:
            raise EM_GAIN_UNKNOWN.error("the calibration without multiplication is missing")
        return self.unity.sensor.with_(em_gain=self.section)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:  # type: ignore[override]
        """Limitations of the result."""
        found, theory = self.excess_noise_factor, self.theory
        if found.value is None or not found.standard_uncertainty:
            return ()
        distance = (found.value - theory) / found.standard_uncertainty
        if abs(distance) <= SIGMA_1_IN_1000:
            return ()
        what = "more" if distance > 0.0 else "less"
        why = (
            "the register saturates, the light varied between the measurements, or electrons were lost"
            if distance > 0.0
            else "the light varied between the measurements, or pixels share their noise"
        )
        text = (
            f"the excess noise factor, {found.value:.3g}, is {what} than the theory's {theory:.3g} by "
            f"{abs(distance):.1f} standard uncertainties: {why}"
        )
        return (EXCESS_NOISE(text, found.value),)

    def to_dict(self) -> dict[str, Any]:
        """Return what `photosite emgain --json` prints."""
        return {
            "gain": self.gain.to_dict(),
            "excess_noise_factor": self.excess_noise_factor.to_dict() | {"theory": self.theory},
            "read_noise_e": self.read_noise_e.to_dict(),
            "stages": self.stated.stages,
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "warnings": list(self.warnings),
        }

    def _table(self) -> ResultTable:
        rows = []
        for name in ("gain", "excess_noise_factor", "read_noise_e"):
            entry: Estimate = getattr(self, name)
            rows.append((name, entry.value, entry.standard_uncertainty, *(entry.interval_95 or (None, None))))
        title = f"Electron multiplication; the excess noise factor of theory is {self.theory:.4g}"
        return ResultTable(title, ("quantity", "value", "standard_uncertainty", "lower_95", "upper_95"), rows)


def measure_em_gain(unity: Calibration, multiplied: Calibration, stated: EmGain | None = None) -> EmGainResult:
    """Estimate the gain of a multiplication register, and its excess noise.

    Parameters
    ----------
    unity
        Calibration of the camera with a multiplication gain of 1.
    multiplied
        Calibration with the gain to measure; temperature and readout as before.
    stated
        The register as known before, with its stages. Default: that of the sensor file of `multiplied`.

    Raises
    ------
    CalibrationError
        If response or system gain of one of them is unknown, or one states the photons and the other does not.

    Notes
    -----
    The gain g is the ratio of the responses to the same light: in DN per photon, or in DN per second where neither
    states the photons; the light is then the same for both. Photon transfer behind the register measures the slope
    K g F^2, where K is the system gain at a gain of 1.
    """
    response, response_multiplied, how = _responses(unity, multiplied)
    k, k_multiplied = (
        _known(name, one.system_gain_dn_per_e, "system_gain_dn_per_e")
        for name, one in (("unity", unity), ("multiplied", multiplied))
    )
    gain = response_multiplied / response
    noise: Value = multiplied.read_noise_dn.uncertain
    effects = None if multiplied.base is None else multiplied.base.effects
    if stated is None and effects is not None:
        stated = effects.em_gain
    return EmGainResult(
        Estimate.of(gain, how),
        Estimate.of(k_multiplied / (gain * k), "ratio of the slopes of photon transfer over the gain"),
        Estimate.of(
            derive(lambda sigma: sigma / (gain * k), noise),
            "read noise in DN over the gain and the system gain in front of it",
        ),
        stated or EmGain(gain=Measured(1.0)),
        unity,
        multiplied,
    )


def _known(name: str, entry: Estimate, parameter: str) -> Uncertain:
    value = entry.uncertain
    if not isinstance(value, Uncertain):
        raise EM_GAIN_UNKNOWN.error(f"{name}: {parameter} is unknown: {value.reason}")
    return value


def _responses(unity: Calibration, multiplied: Calibration) -> tuple[Uncertain, Uncertain, str]:
    """Return the responses to the same light, and how they are compared."""
    both = unity, multiplied
    if any(one.model == "linear" for one in both):
        first, second = (
            _known(name, one.responsivity_dn_per_photon, "responsivity_dn_per_photon")
            for name, one in (("unity", unity), ("multiplied", multiplied))
        )
        return first, second, _BY_PHOTONS
    slopes = []
    for name, one in (("unity", unity), ("multiplied", multiplied)):
        found = [slope for curves in one.curves.values() if (slope := _slope(curves.get("response"))) is not None]
        if len(found) != len(one.curves) or not found:
            raise EM_GAIN_UNKNOWN.error(f"{name}: the slope of the signal against the exposure time is unknown")
        slopes.append(sum(found[1:], found[0]) / float(len(found)))
    return slopes[0], slopes[1], _BY_EXPOSURE


def _slope(curve: Curve | None) -> Uncertain | None:
    if curve is None or curve.slope is None or curve.line_covariance is None:
        return None
    return Uncertain.of(curve.slope, float(np.sqrt(curve.line_covariance[1, 1])))


STATED_EM_GAIN = DiagnosticKind(
    "stated-em-gain",
    "warning",
    "The sensor file states an electron multiplication gain.",
    "The system gain of photon transfer contains this gain and the excess noise factor: values in electrons and the "
    "quantum efficiency are too low by the factor.",
    "Measure the register with two calibrations (photosite emgain).",
    ("system_gain_dn_per_e", "*_e", "*_e_per_s", "quantum_efficiency_*"),
    "excess noise factor",
    "none: the file is read",
)


def stated_gain_warning(em_gain: EmGain, system_gain: Estimate) -> str | None:
    """Return what a stated multiplication gain means for a calibration; None without system gain."""
    if system_gain.value is None:
        return None
    g, factor, slope = em_gain.gain.value, em_gain.excess_noise_factor, system_gain.value
    return (
        f"the sensor file states an electron multiplication gain of {g:g}: the system gain of photon transfer, "
        f"{slope:.4g} DN/e-, contains this gain and the excess noise factor, {factor:.3g}. It is "
        f"{slope / factor:.4g} DN per electron in front of the register, and {slope / factor / g:.4g} DN behind it. "
        f"Values in electrons and the quantum efficiency are too low by the excess noise factor"
    )


def _measure(evidence: Evidence) -> Missing:
    return EFFECT_NOT_MEASURED.missing("a multiplication gain shows between two calibrations: photosite emgain")


EFFECT = Effect(130, _measure, key=None, exempt={"figure": "`photosite emgain` has a separate report"})
