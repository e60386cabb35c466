"""What a calibration answers to stacks of frames that are not clean, made by a plain NumPy generator."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from photosite.calibration.setting import calibrate_setting
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameSet
from photosite.studies.plain_camera import (
    Change,
    Disturbance,
    Frame,
    PlainCamera,
    bands,
    bent,
    convolved,
    darker_corners,
)
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.values.cfa import MONOCHROME, Cfa
from photosite.values.diagnostic import Diagnostic, texts

# The virtual camera: pixels, frames of each level, exposure times, light, and its true figures.
SHAPE = (192, 240)
FRAMES = 8
DARK_FRAMES = 3 * FRAMES
LIGHT_S = (0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1)
PROTOCOL = ShootingProtocol(
    "eight levels",
    (*(Step("dark", t, FRAMES) for t in (0.01, 0.1, 1.0)), *(Step("light", t, FRAMES) for t in LIGHT_S)),
)
ELECTRONS_PER_S = 1.5e5
GAIN = 0.3
PRNU = 0.008
BLACK_DN = 64.0
WHITE_DN = 4095
SATURATION_E = (WHITE_DN - BLACK_DN) / GAIN
CAMERA = PlainCamera(
    shape=SHAPE,
    gain=GAIN,
    black_dn=BLACK_DN,
    read_noise_e=6.0,
    dsnu_dn=0.6,
    prnu=PRNU,
    electrons_per_s=ELECTRONS_PER_S,
)


@dataclass(frozen=True)
class StackKind(Disturbance):
    """A kind of imperfect stack.

    Parameters
    ----------
    name, size
        Name, and size of the effect in words, in which {} stands for a size that can be varied.
    diagnostic
        Id of the diagnostic that a calibration must raise; None where it needs none.
    amount, sized
        The size, and a function that returns the fields of the effect for a size; None for an effect of one size.
    cfa
        Color filter array that is stated for the frames.
    prnu
        PRNU of the frames: crosstalk lowers it, readout channels raise it.
    gain
        System gain of the frames, which a digital gain changes.
    """

    name: str
    size: str
    diagnostic: str | None = None
    amount: float | None = None
    sized: Callable[[float], dict[str, Any]] | None = None
    cfa: Cfa = MONOCHROME
    prnu: float = PRNU
    gain: float = GAIN

    @property
    def text(self) -> str:
        """Size of the effect in words, in percent where it can be varied."""
        return self.size if self.amount is None else self.size.format(f"{100.0 * self.amount:.2g} %")

    def at(self, amount: float) -> StackKind:
        """Return the kind with another size of the effect.

        Examples
        --------
        >>> (kind,) = (kind for kind in KINDS if kind.name == "image lag")
        >>> kind.at(0.01).text
        '1 % of the charge to the next frame'
        """
        assert self.sized is not None
        return replace(self, amount=amount, **self.sized(amount))

    def frames(self, seed: int) -> FrameSet:
        """Return a stack: dark frames at three exposure times, flat fields at eight levels up to saturation."""
        return replace(CAMERA, cfa=self.cfa).frame_set(PROTOCOL, self, seed)


def _sized(name: str, size: str, diagnostic: str, amount: float, sized: Callable[[float], dict[str, Any]]) -> StackKind:
    return StackKind(name, size, diagnostic, amount, sized, **sized(amount))


def _mosaic(values: Frame, rng: np.random.Generator, frame: int) -> Frame:
    rows, cols = (length // 2 for length in values.shape)
    filtered: Frame = values * np.tile([[0.55, 1.0], [1.0, 0.7]], (rows, cols))
    return filtered


def _covered(values: Frame, rng: np.random.Generator, frame: int) -> Frame:
    return np.where(np.arange(values.shape[1]) < values.shape[1] - 8, values, 0.0)


def _digital_gain(gain: float | Frame) -> Change:
    return lambda values, *_: np.floor(np.clip(np.rint(values), 0, WHITE_DN) * gain + 0.5)


def _tone_curve(curve: Callable[[Frame], Frame]) -> Change:
    return lambda values, *_: WHITE_DN * curve(np.clip(np.rint(values), 0, WHITE_DN) / WHITE_DN)


def _filter(a: float) -> tuple[tuple[float, ...], ...]:
    return (0.0, a, 0.0), (a, 1.0 - 4.0 * a, a), (0.0, a, 0.0)


def _crosstalk(a: float) -> dict[str, Any]:
    return {"charge": convolved(_filter(a)), "prnu": PRNU * float(np.linalg.norm(_filter(a)))}


def _pattern(light: Frame) -> dict[str, Any]:
    """Return the fields of a light of mean 1, or of gains of the pixels."""
    return {"light": lambda values, *_: values * light, "prnu": math.hypot(PRNU, float(light.std() / light.mean()))}


def _channels(a: float) -> dict[str, Any]:
    return _pattern(np.tile(1.0 + a * (np.arange(SHAPE[1]) % 2 == 0), (SHAPE[0], 1)))


def _taps(a: float) -> dict[str, Any]:
    return _pattern(np.tile(np.where(np.arange(SHAPE[1]) < SHAPE[1] // 2, 1.0, 1.0 + a), (SHAPE[0], 1)))


def _knee(a: float) -> dict[str, Any]:
    return {"charge": lambda values, *_: np.asarray(values - a * np.maximum(values - 0.4 * SATURATION_E, 0.0))}


def _soft(a: float) -> dict[str, Any]:
    return {"charge": lambda values, *_: np.asarray(values / (1.0 + a * values / SATURATION_E))}


def _some(fraction: float) -> Frame:
    return np.asarray(np.random.default_rng(3).random(SHAPE) < fraction, np.float64)


def _blinking(a: float) -> dict[str, Any]:
    chosen = _some(a)
    return {"light": lambda v, rng, _: v * (1.0 + 0.12 * chosen * (2 * rng.integers(0, 2, SHAPE) - 1))}


def _another_chip(values: Frame, rng: np.random.Generator, frame: int) -> Frame:
    foreign: Frame = values.mean() * (1.0 + PRNU * rng.normal(size=values.shape))
    return foreign if rng.random() < 0.03 else values


_RGGB = (("R", "G"), ("G", "B"))
_GRBG = (("G", "R"), ("B", "G"))

KINDS = (
    StackKind("clean", "monochrome"),
    StackKind("clean mosaic", "RGGB", "no-saturation", light=_mosaic, cfa=_RGGB),
    _sized("crosstalk", "{} of the charge to each next pixel", "correlated-noise", 0.02, _crosstalk),
    _sized(
        "smoothing in the camera", "{} of each next pixel", "correlated-noise", 0.05,
        lambda a: {"numbers": convolved(_filter(a))},
    ),
    _sized(
        "sharpening in the camera", "-{} of each next pixel", "correlated-noise", 0.1,
        lambda a: {"numbers": convolved(_filter(-a))},
    ),
    _sized(
        "image lag", "{} of the charge to the next frame", "correlated-noise", 0.03, lambda a: {"lag": a}
    ),
    _sized(
        "noise reduction over time", "{} of the last frame", "correlated-noise", 0.2, lambda a: {"blend": a}
    ),
    StackKind("row noise", "1 DN", numbers=lambda v, rng, _: v + rng.normal(0.0, 1.0, (len(v), 1))),
    _sized(
        "flicker of the light", "bands of {}, 37 rows", "flickering-light", 0.01, lambda a: {"light": bands(a, 37.0)}
    ),
    _sized(
        "drift of the light", "{} from frame to frame", "unsteady-light", 0.02,
        lambda a: {"light": lambda v, rng, _: v * (1 + a * rng.normal())},
    ),
    _sized(
        "bent response", "-{} at saturation", "bent-response", 0.02,
        lambda a: {"charge": bent(-a, 2, SATURATION_E)},
    ),
    _sized(
        "bent response, 4th power", "+{} at saturation", "bent-response", 0.05,
        lambda a: {"charge": bent(a, 4, SATURATION_E)},
    ),
    _sized("knee of the response", "{} less slope above 40 %", "bent-response", 0.06, _knee),
    _sized("soft saturation", "signal over 1 + {} at saturation", "bent-response", 0.1, _soft),
    _sized(
        "non-linear light", "-{} at saturation", "nonlinear-light", 0.02,
        lambda a: {"light": lambda v, *_: v * (1.0 - a * v.mean() / SATURATION_E)},
    ),
    StackKind("mosaic not stated", "RGGB stated as monochrome", "unstated-mosaic", light=_mosaic),
    StackKind("wrong phase", "RGGB stated as GRBG", "unstated-mosaic", light=_mosaic, cfa=_GRBG),
    StackKind("digital gain", "1.37", "digital-gain", numbers=_digital_gain(1.37), gain=1.37 * GAIN),
    StackKind("digital gain below 1", "0.8", "digital-gain", numbers=_digital_gain(0.8), gain=0.8 * GAIN),
    StackKind(
        "prescaled colors", "R 2.1, B 1.5", "digital-gain", light=_mosaic, cfa=_RGGB,
        numbers=_digital_gain(np.tile([[2.1, 1.0], [1.0, 1.5]], (SHAPE[0] // 2, SHAPE[1] // 2))),
    ),
    StackKind("gamma", "1 / 2.2", "tone-curve", numbers=_tone_curve(lambda x: x ** (1 / 2.2))),
    StackKind("square-root companding", "12 bits", "tone-curve", numbers=_tone_curve(np.sqrt)),
    StackKind("clipping below full scale", "at 2800 DN", numbers=lambda v, *_: np.minimum(np.rint(v), 2800.0)),
    StackKind(
        "partly full wells", "1 % above the mean of the brightest level", "partly-full-wells",
        light=lambda v, *_: 0.85 * v, charge=lambda e, *_: np.minimum(e, 1.01 * 0.85 * ELECTRONS_PER_S * LIGHT_S[-1]),
    ),
    _sized("readout channels", "even columns {} brighter", "periodic-gain", 0.01, _channels),
    _sized("taps", "right half {} brighter", "steps-between-taps", 0.01, _taps),
    _sized(
        "uneven light", "corners darker by {} and again by it", "uneven-light", 0.05,
        lambda a: _pattern(darker_corners(SHAPE, a)),
    ),
    _sized(
        "wrong level", "light of one level {} off", "wrong-light-levels", 0.04,
        lambda a: {"wrong_level": (5, 1.0 + a)},
    ),
    StackKind(
        "alternating black level", "2 DN more in every second frame", "black-level-shifts",
        numbers=lambda v, rng, frame: v + 2.0 * (frame % 2),
    ),
    StackKind(
        "mirrored dark frames", "left and right exchanged", "other-offsets",
        numbers=lambda v, rng, frame: v[:, ::-1] if frame < DARK_FRAMES else v,
    ),
    StackKind("covered columns", "8 of 240", "unlit-lines", light=_covered),
    StackKind("frames of another chip", "3 % of the frames", "foreign-frames", light=_another_chip),
    StackKind(
        "turned frames", "one of eight flat fields of each level, by 180 degrees", "turned-frame",
        numbers=lambda v, rng, frame: v[::-1, ::-1] if frame >= DARK_FRAMES and frame % FRAMES == 5 else v,
    ),
    _sized(
        "light that does not grow", "{} of the brightest level in all flat fields", "constant-light", 0.01,
        lambda a: {"light": lambda v, *_: v + a * ELECTRONS_PER_S * LIGHT_S[-1] * (v > 0.0)},
    ),
    _sized(
        "hot pixels", "{} of the pixels, 3000 e-/s", "defective-pixels", 0.002,
        lambda a: {"hot_e_per_s": 3000.0 * _some(a)},
    ),
    _sized("pixels that blink if lit", "{} of the pixels, by 12 %", "defective-pixels", 0.002, _blinking),
)  # fmt: skip
"""The kinds of stacks."""


@dataclass(frozen=True)
class Answer:
    """What a calibration of a stack answers.

    Parameters
    ----------
    kind
        The kind of stack.
    gain, prnu
        Interval of 95 % of the system gain (DN/e-) and of PRNU (%), or the reason why it is withheld.
    diagnostics
        Those of the calibration, or the error that refused the stack.
    """

    kind: StackKind
    gain: tuple[float, float] | str
    prnu: tuple[float, float] | str
    diagnostics: tuple[Diagnostic, ...]

    @property
    def right(self) -> bool:
        """Whether every interval that is given contains the truth."""
        pairs = ((self.gain, self.kind.gain), (self.prnu, 100.0 * self.kind.prnu))
        return all(isinstance(given, str) or given[0] <= truth <= given[1] for given, truth in pairs)

    @property
    def ids(self) -> frozenset[str]:
        """Ids of the diagnostics but those of parameters without a value, which clean stacks have, too."""
        return frozenset(entry.id for entry in self.diagnostics if entry.severity != "withheld")

    @property
    def found(self) -> bool:
        """Whether the calibration raises the diagnostic of the kind, or, without one, no warning."""
        if self.kind.diagnostic is None:
            return not texts(self.diagnostics, "warning", "left out", "refused")
        return self.kind.diagnostic in self.ids

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "kind": self.kind.name,
            "size": self.kind.text,
            "right": self.right,
            "found": self.found,
            "system_gain_dn_per_e": self.gain,
            "prnu_percent": self.prnu,
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
        }


def calibrate_stack(kind: StackKind, seed: int) -> Answer:
    """Calibrate a stack."""
    try:
        calibration = calibrate_setting(kind.frames(seed))
    except CalibrationError as error:
        reason = str(error)
        return Answer(kind, reason, reason, (Diagnostic(error.id or "", "refused", reason),))
    gain, prnu = (
        estimate.interval_95 or str(estimate.reason)
        for estimate in (calibration.system_gain_dn_per_e, calibration.prnu_percent)
    )
    return Answer(kind, gain, prnu, calibration.diagnostics)


def imperfect_stacks(seeds: Iterable[int] = (0,), kinds: Sequence[StackKind] = KINDS) -> Iterator[Answer]:
    """Calibrate a stack of each kind with each seed, in this order.

    Examples
    --------
    >>> (answer,) = imperfect_stacks([2], KINDS[:1])
    >>> answer.right, answer.found
    (True, True)
    """
    for kind, seed in product(kinds, tuple(seeds)):
        yield calibrate_stack(kind, seed)
