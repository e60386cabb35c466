"""Mean and variance of raw frames as functions of torch tensors. torch is imported at the first call."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from photosite.errors import InputError


class Differentiable(Protocol):
    """A model with a vector-Jacobian product, such as `SignalModel`."""

    def __call__(self, values: Mapping[str, Any]) -> tuple[Any, Any]: ...

    def vjp(
        self, values: Mapping[str, Any], cotangents: tuple[Any, Any], parameters: Iterable[str]
    ) -> dict[str, Any]: ...


def torch_moments(model: Differentiable, values: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return mean and variance as tensors; see `SignalModel.torch`."""
    try:
        torch = importlib.import_module("torch")
    except ImportError:
        raise InputError("torch is not installed", hint="Run pip install '.[ml]' in the clone") from None
    names = tuple(values)
    tensors = [
        value if isinstance(value, torch.Tensor) else torch.as_tensor(value, dtype=torch.float64)
        for value in values.values()
    ]
    mean, variance = _function(torch).apply(model, names, *tensors)
    return mean, variance


@lru_cache(maxsize=1)
def _function(torch: Any) -> Any:
    """Return the autograd function, a class that exists where torch does."""

    class Moments(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(ctx: Any, model: Differentiable, names: tuple[str, ...], *tensors: Any) -> Any:
            ctx.model, ctx.names = model, names
            ctx.save_for_backward(*tensors)
            return tuple(torch.from_numpy(np.array(each)) for each in model(_arrays(names, tensors)))

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, of_mean: Any, of_variance: Any) -> Any:
            tensors = ctx.saved_tensors
            wanted = [name for name, needed in zip(ctx.names, ctx.needs_input_grad[2:], strict=True) if needed]
            cotangents = of_mean.numpy(), of_variance.numpy()
            gradient = ctx.model.vjp(_arrays(ctx.names, tensors), cotangents, wanted)
            return (
                None,
                None,
                *(
                    torch.as_tensor(gradient[name]).to(tensor) if name in gradient else None
                    for name, tensor in zip(ctx.names, tensors, strict=True)
                ),
            )

    return Moments


def _arrays(names: tuple[str, ...], tensors: tuple[Any, ...]) -> dict[str, Any]:
    return {name: tensor.detach().cpu().double().numpy() for name, tensor in zip(names, tensors, strict=True)}
