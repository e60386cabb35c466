"""Fourier transforms against those of SciPy, to the last bit."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import scipy.fft

from photosite.engine import extension_module, fourier

RNG = np.random.default_rng(1)
REAL = RNG.random((30, 44), np.float32)
COMPLEX = (RNG.random((30, 23)) + 1j * RNG.random((30, 23))).astype(np.complex64)


@pytest.mark.parametrize("axis", [0, 1])
def test_transforms_are_those_of_scipy(axis: int) -> None:
    pairs = [
        (fourier.rfft(REAL[::2], axis), scipy.fft.rfft(REAL[::2], axis=axis)),
        (fourier.fft(COMPLEX.copy(), axis), scipy.fft.fft(COMPLEX, axis=axis)),
        (fourier.ifft_unscaled(COMPLEX.copy(), axis), scipy.fft.ifft(COMPLEX, axis=axis, norm="forward")),
    ]
    for own, expected in pairs:
        assert own.dtype == expected.dtype
        assert (own == expected).all()


@pytest.mark.parametrize("count", [44, 45])
def test_inverse_transforms_to_real_numbers_are_those_of_scipy(count: int) -> None:
    assert (fourier.irfft_unscaled(COMPLEX, count, 1) == scipy.fft.irfft(COMPLEX, count, axis=1, norm="forward")).all()


def test_a_complex_transform_is_in_place() -> None:
    values = COMPLEX.copy()
    assert fourier.fft(values, 0) is values


@pytest.mark.parametrize("count", [1, 7, 1297, 2593])
def test_fast_lengths_are_those_of_scipy(count: int) -> None:
    assert fourier.next_fast_len(count) == scipy.fft.next_fast_len(count, real=True)


@pytest.mark.parametrize("first", ["fourier.rfft(values, 0)", "import scipy.fft"])
def test_scipy_fft_imports_before_and_after(first: str) -> None:
    code = f"""
import sys
import numpy as np
from photosite.engine import extension_module, fourier
values = np.ones((8, 2), np.float32)
{first}
import scipy.fft
sys.exit(not (scipy.fft.rfft(values, axis=0) == fourier.rfft(values, 0)).all())
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_another_place_in_scipy_is_found_by_importing_it(monkeypatch: pytest.MonkeyPatch) -> None:
    nowhere = type("Nowhere", (), {"find_spec": staticmethod(lambda *_: None)})
    monkeypatch.setattr(extension_module, "PathFinder", nowhere)
    monkeypatch.delitem(sys.modules, "scipy.fft._pocketfft.pypocketfft")
    extension_module.extension_module.cache_clear()
    assert (fourier.rfft(REAL, 0) == scipy.fft.rfft(REAL, axis=0)).all()
    extension_module.extension_module.cache_clear()
