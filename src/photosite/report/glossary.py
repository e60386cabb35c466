"""How to read the report of a calibration, for a reader who was not there."""

from __future__ import annotations

from photosite.report.html import Block, Paragraph, Subheading, Terms

_READING = (
    "Values are written estimate ± standard uncertainty (GUM): the truth lies within one of them in about two cases of "
    "three. In the 95 % interval it lies in 19 cases of 20. A figure without a number could not be estimated from "
    "these frames, and the report says why instead of guessing.",
    "In the plots, bars on points are 95 % intervals from sampling: what the finite number of frames and pixels leaves "
    "open. Bands around lines are the 95 % intervals of the lines themselves, from the covariance of each fit. Filled "
    "points were fitted, hollow ones were not: they lie outside the linear range. Each colour channel has its own "
    "colour, marker and kind of line, so that none is needed to tell the others.",
    "A spread is the root of a variance, and the variance of a small spread is the difference of two larger ones. "
    "Chance can make it come out negative. It is then shown as it is, with a minus sign, and with the upper limit "
    "below which the true spread lies with 95 % probability.",
)

_TERMS = (
    ("DN", "Digital number: what the converter writes into the file."),
    ("e⁻", "Electrons: what a photon frees in the pixel, and what the pixel collects."),
    ("Dark frame, flat frame", "A frame without any light; a frame of even light over the whole sensor."),
    (
        "System gain K",
        "Digital numbers per electron. Light comes in whole photons, so its noise tells how many electrons were "
        "counted: K is the slope of the temporal variance against the signal (photon transfer).",
    ),
    (
        "Quantum efficiency η",
        "Share of the photons on the pixel's whole area that end as electrons. It needs the number of photons, and "
        "holds for the light that was used.",
    ),
    (
        "Temporal noise",
        "What changes from frame to frame. Read noise and temporal dark noise are what is left of it without light; "
        "read noise as the 2008 paper has it is of one exposure, the standard's is extrapolated to exposure zero.",
    ),
    (
        "DSNU, PRNU",
        "What differs from pixel to pixel and stays from frame to frame: dark signal non-uniformity in the dark, "
        "photo-response non-uniformity under light. Those marked 1288 are after the standard, at half saturation and "
        "with slow variations such as the lamp's shading filtered out for PRNU; row, column and pixel parts add up as "
        "variances.",
    ),
    ("Dark current", "Electrons that a pixel collects per second without light. It grows with temperature."),
    (
        "Saturation capacity, sensitivity threshold, dynamic range",
        "The most that a pixel tells apart; the least light that stands out from the noise (SNR 1); their ratio.",
    ),
    (
        "SNR",
        "Signal-to-noise ratio: signal over noise; in decibels, 20 times its decimal logarithm; in bits, its binary "
        "one.",
    ),
    (
        "Linearity",
        "How far the response is from a straight line. Within the linear range the gain and the responsivity are "
        "fitted.",
    ),
)


def reading_blocks() -> tuple[Block, ...]:
    """What the numbers, the plots and the words mean."""
    return (*(Paragraph(text) for text in _READING), Subheading("Words"), Terms(_TERMS))
