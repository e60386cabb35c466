"""Splines of the folded terms, which SciPy's are the reference for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_interp_spline

from photosite.engine.transfer import RadialTransfer, Sampling, fold_coefficients, folded_terms, sum_folded_terms

PITCH_M = 3e-6
SAMPLING = Sampling((PITCH_M, PITCH_M), (PITCH_M, PITCH_M))
TRANSFER = RadialTransfer(np.linspace(1, 0, 9)[None, None] ** 2, 0.1 / PITCH_M)


def grid(count: int) -> np.ndarray:
    return np.linspace(0, 0.5 / PITCH_M, count)


@pytest.mark.parametrize(
    "positions",
    [np.fft.rfftfreq(3888, PITCH_M), np.abs(np.fft.fftfreq(2601, PITCH_M)), grid(65), grid(9)[::-1] * (1 + 1e-15)],
    ids=["even", "odd", "nodes", "beyond the last"],
)
def test_splines_are_those_of_scipy_to_the_last_bit(positions: np.ndarray) -> None:
    nodes = grid(65)
    knots = make_interp_spline(nodes, nodes, k=3).t
    expected = BSpline.design_matrix(np.minimum(positions, nodes[-1]), knots, 3)
    rows = folded_terms(TRANSFER, SAMPLING, positions, grid(2)).down
    assert (rows.first == expected.indices.reshape(-1, 4)[:, 0]).all()
    assert (rows.weights == expected.data.reshape(-1, 4).T.astype(np.float32)).all()


def test_splines_pass_through_the_folded_terms_at_the_nodes() -> None:
    terms = folded_terms(TRANSFER, SAMPLING, grid(65), grid(65))
    down, across = (rows.matrix(65) for rows in (terms.down, terms.across))
    exact = sum_folded_terms(TRANSFER, SAMPLING, grid(65), grid(65))
    assert exact.max() > 0.05
    np.testing.assert_allclose(down @ terms.coefficients[0, 0] @ across.T, exact[0, 0], atol=1e-6)


def test_a_transfer_of_zero_has_no_folded_terms() -> None:
    assert not fold_coefficients(RadialTransfer(np.zeros((1, 1, 2)), 1.0), SAMPLING).any()
