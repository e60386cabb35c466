"""Random telegraph noise: pixels that blink, with the maps of the chip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding, SensorChanges
from photosite.calibration.reduction.defective_pixels import BadPixel
from photosite.sensor.effects.telegraph_noise import TelegraphNoise
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured, Missing, Uncertain, Value

_LINES = "row_noise_mv", "column_noise_mv"


@dataclass(frozen=True)
class BlinkingPixels(Finding, Shown):
    """Pixels that blink.

    Parameters
    ----------
    fraction, amplitude_dn, steady_noise_dn
        Fraction of the pixels, mean distance of their levels, and read noise of the other pixels.
    gain
        System gain in DN/e-; missing where the read noise is.
    left_out
        Number of noisy pixels that the read noise is without.
    """

    fraction: Estimate
    amplitude_dn: Estimate
    steady_noise_dn: Estimate
    gain: Value
    left_out: int = 0

    @property
    def present(self) -> bool:
        """Whether there are enough blinking pixels for a distribution."""
        return self.fraction.value is not None

    @property
    def estimates(self) -> dict[str, Estimate]:
        """Fraction and amplitude."""
        return {"blinking_fraction": self.fraction, "blinking_amplitude_dn": self.amplitude_dn}

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the blinking pixels for a sensor file; those of the base where they could not be measured."""
        fraction, amplitude, gain = _positive(self.fraction), _positive(self.amplitude_dn), self.gain
        if (
            fraction is None
            or amplitude is None
            or _positive(self.steady_noise_dn) is None
            or isinstance(gain, Missing)
        ):
            return {}
        noise = TelegraphNoise(fraction=min(fraction.value, 1.0), amplitude_e=amplitude.value / gain.value)
        return {"telegraph_noise": noise}

    def subtract(self, changes: SensorChanges) -> dict[str, Any]:
        """Return the read noise of the pixels that do not blink; without blinking pixels that the frames exclude."""
        read_noise = changes.measured("read_noise_mv")
        if read_noise is None or isinstance(self.gain, Missing):
            return {}
        lines_mv2 = sum(changes.fields[name].value ** 2 for name in _LINES if name in changes.fields)
        if self.left_out and not self.present:
            return {}
        if "telegraph_noise" in changes.fields:
            fraction, amplitude, steady = map(_positive, (self.fraction, self.amplitude_dn, self.steady_noise_dn))
            assert fraction is not None
            assert amplitude is not None
            assert steady is not None
            read_mv = steady * (changes.mv_per_e / self.gain.value)
            rest = (read_mv * read_mv + lines_mv2).sqrt()
            note = (
                f"of pixels without telegraph noise: fraction {fraction.value:.3g} ± "
                f"{fraction.standard_uncertainty:.2g}, mean amplitude "
                f"{amplitude.value:.3g} ± {amplitude.standard_uncertainty:.2g} DN"
            )
        else:
            assumed = None if changes.base.effects is None else changes.base.effects.telegraph_noise
            if assumed is None:
                return {}
            taken = changes.mv_per_e**2 * assumed.variance_e2
            if taken > read_noise.value**2 - lines_mv2:
                return {"telegraph_noise": None}  # the frames have less
            rest = Uncertain.of(
                read_noise.value**2 - taken, 2.0 * read_noise.value * read_noise.standard_uncertainty
            ).sqrt()
            note = "without the telegraph noise stated before"
        return {"read_noise_mv": Measured(rest.value, rest.standard_uncertainty, f"{read_noise.source}, {note}")}


def _positive(estimate: Estimate) -> Uncertain | None:
    """Return a positive value with its standard uncertainty; None without one."""
    if estimate.value is None or estimate.standard_uncertainty is None or estimate.value <= 0.0:
        return None
    return Uncertain.of(estimate.value, estimate.standard_uncertainty)


def _measure(evidence: Evidence) -> BlinkingPixels:
    temporal, parameters = evidence.temporal, evidence.parameters
    left_out = 0 if evidence.left_out is None else int(evidence.left_out.pixels.of(BadPixel.NOISY).sum())
    gain = parameters.system_gain_dn_per_e.uncertain
    if parameters.read_noise_mv.value is None:
        gain = parameters.read_noise_mv.uncertain
    if temporal is None:
        missing = Estimate(reason=evidence.no_maps)
        return BlinkingPixels(missing, missing, missing, gain, left_out)
    return BlinkingPixels(
        temporal.blinking_fraction, temporal.blinking_amplitude_dn, temporal.steady_noise_dn, gain, left_out
    )


EFFECT = Effect(80, _measure, key=None)
