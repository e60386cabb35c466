"""Logarithm and exponential compared with the math library, in units in the last place."""

from __future__ import annotations

import math

import numpy as np

from photosite.engine.elementary import exp, log


def worst_ulp(ours: list[float], exact: list[float]) -> float:
    return max(abs(a - b) / math.ulp(b) for a, b in zip(ours, exact, strict=True))


def test_log() -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate([np.exp(rng.uniform(-500, 500, 20000)), rng.uniform(0.5, 2, 20000), [1.0, 2.0**-33, 1e5]])
    assert worst_ulp([log(v) for v in x], [math.log(v) for v in x]) <= 2
    assert log(1.0) == 0.0


def test_exp() -> None:
    x = np.concatenate([np.random.default_rng(2).uniform(-700, 700, 20000), np.linspace(-10, 0, 5001)])
    assert worst_ulp([exp(v) for v in x], [math.exp(v) for v in x]) <= 2
    assert exp(0.0) == 1.0
