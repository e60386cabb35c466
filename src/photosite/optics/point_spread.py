"""Point spread functions (PSF) on the sensor, given by their optical transfer functions (OTF).

Positions on the sensor are (y, x) in m: y down the rows of the frame, x along its columns, 0 on the optical axis. A PSF
is normalized to unit energy. Its OTF is

    otf(fy, fx) = integral of psf(y, x) exp(-2 pi i (fy y + fx x)) dy dx,

which is 1 at (0, 0). A single mode of a `FieldPsf` may have any value there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RadialPsf:
    """A rotationally symmetric PSF, the same over the whole field; its OTF is real.

    Parameters
    ----------
    otf
        (frequency_per_m of any shape, wavelength_nm) -> real values of that shape.
    cutoff_per_m
        wavelength_nm -> frequency beyond which the OTF is 0, cycles/m.
    reach_m
        wavelength_nm -> radius on the sensor that encloses 99.5 % of the energy.
    """

    otf: Callable[[Array, float], Array]
    cutoff_per_m: Callable[[float], float]
    reach_m: Callable[[float], float]


@dataclass(frozen=True, eq=False)
class PlanePsf:
    """A PSF of any shape, the same over the whole field.

    Parameters
    ----------
    otf
        (fy_per_m, fx_per_m, wavelength_nm) -> complex values of the broadcast shape of the frequencies.
    cutoff_per_m, reach_m
        As for `RadialPsf`, in the direction where they are largest.
    wavelength_nm
        Wavelengths of the tabulated PSF: linear in between, the nearest one beyond. None: computed at each wavelength.
    """

    otf: Callable[[Array, Array, float], NDArray[np.complex128]]
    cutoff_per_m: Callable[[float], float]
    reach_m: Callable[[float], float]
    wavelength_nm: Array | None = None


@dataclass(frozen=True, eq=False)
class FieldPsf:
    """A PSF that varies over the field: the sum over r of weights[r] at the image point times modes[r].

    Parameters
    ----------
    y_m, x_m
        (P,), (Q,) increasing: nodes on the sensor. Weights are bilinear in between, those of the nearest node beyond.
    weights
        (R, P, Q).
    modes
        R PSFs with the same `wavelength_nm`. At every node their weighted sum has unit energy.
    relative_error
        RMS error of the sum over all nodes and wavelengths, relative to the RMS of the lens's PSFs; 0 if exact.
    """

    y_m: Array
    x_m: Array
    weights: Array
    modes: tuple[PlanePsf, ...]
    relative_error: float = 0.0


PointSpread = RadialPsf | PlanePsf | FieldPsf
