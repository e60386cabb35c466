"""The device that computes pixels: the CPU, or an NVIDIA GPU."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Literal

from photosite.engine.jit import threads_for
from photosite.errors import InputError

Device = Literal["cpu", "cuda"]
"""Where pixels are computed; the digital numbers are the same."""


def computed(device: Device, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return the result of a kernel of the engine, whose first argument has an entry for each pixel.

    Raises `InputError` if the device is "cuda" and a GPU, its driver or the extra `gpu` is missing.
    """
    if device == "cpu":
        with threads_for(arguments[0].size):
            return function(*arguments)
    try:
        cuda = import_module("photosite.engine.cuda")
    except ImportError:
        raise _no_cuda("numba.cuda cannot be imported") from None
    try:
        return getattr(cuda, f"{function.__name__}_cuda")(*arguments)
    except cuda.NoCudaError as error:
        raise _no_cuda(str(error)) from None


def _no_cuda(reason: str) -> InputError:
    return InputError(
        f"device 'cuda' needs an NVIDIA GPU and photosite's extra 'gpu', but {reason}",
        hint="Run pip install '.[gpu]' in the clone, or pass {device}, which gives the same numbers",
        arguments={"device": "cpu"},
    )
