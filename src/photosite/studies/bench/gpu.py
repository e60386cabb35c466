"""Cases on an NVIDIA GPU at the size of a Nikon D200: noise alone, a whole capture, and copies to and from the host.

The baselines are photosite's own on the CPU; for the copies, one of the same bytes on the host. Without a GPU, the
cases are left out with the reason.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from photosite.camera.gpu_camera import GpuCamera
from photosite.studies.bench.captures import EXPOSURE_S, MEGAPIXELS, camera, scene
from photosite.studies.bench.timing import Case, in_turn, peak_mb

_FRAMES = 50
"""Frames that follow one another without waiting; the time is that of one."""


@lru_cache(maxsize=1)
def _on_gpu() -> GpuCamera:
    return camera().on_gpu()


def _repeated(work: Callable[[int], object], frames: int = _FRAMES) -> Callable[[], None]:
    """Return work done for several frames, with a wait for the GPU at the end."""

    def run() -> None:
        for number in range(frames):
            work(number)
        _on_gpu().wait()

    return run


def _case(work: Callable[[int], object], baseline: Callable[[], object], quick: bool, name: str) -> Case:
    """Return the time of one frame."""
    _repeated(work, 2)()  # compiles the kernels, copies the maps
    baseline()
    ours, theirs = in_turn(_repeated(work), baseline, 3 if quick else 9)
    return Case(ours / _FRAMES, theirs, peak_mb(work_once, name=name), MEGAPIXELS)


def work_once(name: str) -> None:
    """Expose or capture a frame on the GPU, once."""
    frame = _on_gpu().capture(scene(), EXPOSURE_S, seed=1)
    if name == "transfers":
        frame.to_host()
    _on_gpu().wait()


def gpu_noise(quick: bool = False) -> Case:
    """Noise of a frame from mean electrons on the GPU; the digital numbers stay there."""
    on_gpu, mean = _on_gpu(), camera().mean_electrons(scene(), EXPOSURE_S)
    on_device = on_gpu.mean_electrons(scene(), EXPOSURE_S)
    return _case(
        lambda n: on_gpu.expose(on_device, EXPOSURE_S, seed=1, frame=n),
        lambda: camera().expose(mean, EXPOSURE_S, seed=1),
        quick,
        "noise",
    )


def gpu_capture(quick: bool = False) -> Case:
    """A whole capture on the GPU, mean image included; the digital numbers stay there."""
    on_gpu = _on_gpu()
    return _case(
        lambda n: on_gpu.capture(scene(), EXPOSURE_S, seed=1, frame=n),
        lambda: camera().capture(scene(), EXPOSURE_S, seed=1),
        quick,
        "capture",
    )


def gpu_transfers(quick: bool = False) -> Case:
    """Mean electrons copied to the GPU and digital numbers back, without noise between them."""
    on_gpu, mean = _on_gpu(), camera().mean_electrons(scene(), EXPOSURE_S)
    frame = on_gpu.expose(mean, EXPOSURE_S, seed=1)
    dn = frame.to_host().dn

    def copies(_: int) -> None:
        frame.arrays.put(mean)
        frame.arrays.get(frame.array)

    return _case(copies, lambda: (mean.copy(), dn.copy()), quick, "transfers")
