"""The compiled code (PTX) of all kernels: no operation in it rounds differently from the CPU.

The tests need the CUDA compiler (extra `gpu`) but no GPU.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from types import SimpleNamespace

import numba
import pytest

from photosite.engine.cuda import KERNELS, NoCudaError, check_unfused, unfused


@pytest.fixture(scope="module")
def compile_ptx() -> Callable[[str], str]:
    if importlib.util.find_spec("numba_cuda") is None or numba.config.ENABLE_CUDASIM:
        pytest.skip("the CUDA compiler (extra gpu) is not installed, or the simulator is active")
    from numba import cuda
    from numba.core import sigutils
    from numba.cuda import dispatcher

    def ptx(name: str) -> str:
        arguments, _ = sigutils.normalize_signature(KERNELS[name].signature)
        with pytest.MonkeyPatch.context() as patch:
            # Device functions are compiled for the GPU that is present; none needs to be.
            patch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(8, 0)))
            code, _ = cuda.compile_ptx(KERNELS[name].thread, arguments, cc=(8, 0))
        return str(code)

    return ptx


def test_default_options_fuse_and_the_check_detects_it(compile_ptx: Callable[[str], str]) -> None:
    with pytest.raises(NoCudaError, match="rounds differently"):
        check_unfused(compile_ptx("expose_drawn"))


@pytest.mark.parametrize("name", KERNELS)
def test_no_operation_is_fused(compile_ptx: Callable[[str], str], name: str) -> None:
    with unfused():
        code = compile_ptx(name)
    check_unfused(code)
    if name.startswith("expose"):
        assert code.count("mul.rn.f64") > 100
