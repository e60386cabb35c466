"""Figures with the defective pixels that are left out of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.parameters import PARAMETER_LABELS, Parameters
from photosite.calibration.reduction.defective_pixels import DefectivePixels, in_words
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.shown import Shown

NOTABLE = 0.01
"""Relative difference from which a figure with the defective pixels is named."""


@dataclass(frozen=True)
class LeftOut(Shown):
    """Defective pixels that are left out of all figures, and what the figures are with them.

    Parameters
    ----------
    pixels
        The pixels, with their own numbers.
    without, all_pixels
        Figures by the name of the parameter: without them, as in the calibration, and of all pixels.
    """

    pixels: DefectivePixels
    without: Mapping[str, float]
    all_pixels: Mapping[str, float]

    @classmethod
    def of(cls, pixels: DefectivePixels, parameters: Parameters) -> LeftOut:
        """Return the figures with the pixels, from those without them."""
        share = pixels.fraction

        def joined(body: float, own: NDArray[np.float64]) -> float:
            return (1.0 - share) * body + share * float(own.mean())

        def spread(body: float, own: NDArray[np.float64]) -> float:
            """Return the standard deviation of the others and of these pixels, which deviate by `own`."""
            square = joined(body * abs(body), own**2) - (share * float(own.mean())) ** 2
            return math.copysign(math.sqrt(abs(square)), square)

        square = pixels.noise_dn2 - QUANTIZATION_DN2
        offset = np.copysign(np.sqrt(np.maximum(pixels.offset_dn**2 - pixels.offset_noise_dn2, 0.0)), pixels.offset_dn)
        of_pixels: dict[str, tuple[Callable[[float, NDArray[np.float64]], float], NDArray[np.float64]]] = {
            "read_noise_dn": (lambda body, own: math.sqrt(max(joined(body**2, own), 0.0)), square),
            "dsnu_dn": (spread, offset),
            "prnu_percent": (spread, 100.0 * (pixels.response - 1.0)),
            "black_level_dn": (lambda body, own: body + share * float(own.mean()), pixels.offset_dn),
            "dark_current_dn_per_s": (lambda body, own: body + share * float(own.mean()), pixels.rate_dn_per_s),
        }
        without, with_them = {}, {}
        for name, (figure, own) in of_pixels.items():
            body = getattr(parameters, name).value
            if body is not None and np.isfinite(own).all():
                without[name], with_them[name] = body, figure(body, own)
        return cls(pixels, without, with_them)

    def __str__(self) -> str:
        number = f"{len(self.pixels)} pixel{'s are' if len(self.pixels) > 1 else ' is'} defective"
        kinds = f"{in_words(self.pixels.counts())}; {100 * self.pixels.fraction:.2g} %"
        changed = [
            f"{PARAMETER_LABELS[name].label} {with_them:.4g} in place of {without:.4g} {PARAMETER_LABELS[name].unit}"
            for name, without in self.without.items()
            if abs((with_them := self.all_pixels[name]) - without) > NOTABLE * abs(without)
        ]
        text = f"{number} ({kinds}) and left out of all figures"
        return f"{text}; with them: {', '.join(changed)}" if changed else text

    def to_dict(self) -> dict[str, object]:
        """Return the number of pixels by kind, and the figures of all pixels, for JSON."""
        return {"pixels": len(self.pixels), **self.pixels.counts(), "figures_of_all_pixels": dict(self.all_pixels)}
