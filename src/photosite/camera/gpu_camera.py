"""The camera on a GPU: mean image, noise and digital numbers, which stay there."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from photosite.camera.frame_fields import frame_fields
from photosite.camera.image_over_time import AnyScene, exposure_image
from photosite.camera.mean_image import (
    apply_relative_illumination,
    brightest_sample,
    checked_coupling,
    clip_negative,
    low_rank_error,
    mosaic_parts,
    polarization_maps,
    uniform_mosaic,
    warn_of_missing_light,
)
from photosite.camera.optical_stack import apply_angular_response, crosstalk_fractions, warn_of_transmittance_range
from photosite.camera.parts import CameraParts
from photosite.engine.device_mosaic import gathered_on_device, mosaic_on_device, runs_on_device
from photosite.errors import InputError
from photosite.frames.gpu_frame import GpuFrame
from photosite.scene.dynamic_scene import DynamicScene
from photosite.scene.scene import Scene
from photosite.sensor.device import Gpu
from photosite.sensor.readout import read_frame
from photosite.sensor.shot import Rectangle, SequenceOptions, Shot
from photosite.values.exposure import check_exposure, check_start, exposure_sequence


class GpuCamera:
    """A camera on an NVIDIA GPU, from `Camera.on_gpu`; maps of the chip are copied to the GPU once.

    The mean image is that of the CPU up to rounding of 32-bit transforms, about 1e-6 of the brightest pixel. From the
    same mean image, the digital numbers are those of the CPU, in every bit.

    Parameters
    ----------
    camera
        Lens and sensor. The sensor has one capture.
    gpu
        The GPU.

    Raises
    ------
    InputError
        If the sensor has several captures.
    """

    def __init__(self, camera: CameraParts, gpu: Gpu) -> None:
        if camera.sensor.captures is not None:
            hint = "Use Camera.capture with device='cuda'"
            raise InputError("captures are combined on the host, not on a GPU", hint=hint)
        self.camera, self._gpu = camera, gpu
        self._scales: dict[float, NDArray[np.float32] | None] = {}

    def computes(self, scene: AnyScene) -> bool:
        """Return whether the mean image of a scene is computed on the GPU.

        The CPU computes it, and one copy to the GPU follows, for scenes in depth or motion or with a map of
        polarization, lenses with distortion, lateral color or veiling glare, and stacked channels.
        """
        still = scene.scene if isinstance(scene, DynamicScene) and scene.motion is None else scene
        optics, sensor = self.camera.optics, self.camera.sensor
        return (
            isinstance(still, Scene)
            and optics.mapping(still.distance_m) is None
            and optics.veiling_glare is None
            and not sensor.array.stacked
            and not polarization_maps(still, sensor)
        )

    def mean_electrons(self, scene: AnyScene, exposure_s: float, *, start_s: float = 0.0) -> Any:
        """Return the mean electrons of `Camera.mean_electrons` as an array on the GPU.

        Parameters
        ----------
        scene, exposure_s, start_s
            As for `Camera.mean_electrons`.

        Returns
        -------
        array
            (rows, cols) float32.

        Raises
        ------
        InputError
            As `Camera.mean_electrons`.
        """
        time_s, start_s = check_exposure(exposure_s), check_start(start_s)
        if not self.computes(scene):
            return self._gpu.put(exposure_image(scene, self.camera, start_s, time_s).electrons(start_s, time_s))
        still = scene.scene if isinstance(scene, DynamicScene) else scene
        assert isinstance(still, Scene)
        rate = self._rate(still)
        flicker = scene.flicker if isinstance(scene, DynamicScene) else None
        if flicker is None:
            return rate * float(np.float32(time_s))
        begin_s = start_s + self.camera.sensor.row_start_s
        of_rows = flicker.integral_s(begin_s, begin_s + time_s).astype(np.float32)
        return rate * self._gpu.put(of_rows[:, None])

    def capture(
        self,
        scene: AnyScene,
        exposure_s: float,
        *,
        start_s: float = 0.0,
        seed: int = 0,
        frame: int = 0,
        region: Rectangle | None = None,
        temperature_c: float | None = None,
    ) -> GpuFrame:
        """Return a raw frame of a scene; see `Camera.capture` for arguments and errors."""
        shot = Shot(seed, frame, region, self._gpu, temperature_c)
        return self._expose(self.mean_electrons(scene, exposure_s, start_s=start_s), exposure_s, shot, scene)

    def stream(
        self,
        scene: AnyScene,
        exposures_s: float | Iterable[float],
        frames: int = 1,
        *,
        start_s: float = 0.0,
        first_frame: int = 0,
        **shot: Unpack[SequenceOptions],
    ) -> Iterator[GpuFrame]:
        """Yield raw frames of a scene that all start at one time; the mean image of an exposure is computed once.

        Parameters
        ----------
        scene, exposures_s, frames, start_s, first_frame
            As for `Camera.stream`.
        **shot
            `seed`, `region` and `temperature_c` of `Camera.capture`.
        """
        for exposure_s, numbers in exposure_sequence(exposures_s, frames, first_frame):
            mean = self.mean_electrons(scene, exposure_s, start_s=start_s)
            for number in numbers:
                yield self._expose(mean, exposure_s, replace(Shot(**shot, frame=number), device=self._gpu), scene)

    def expose(
        self,
        mean_electrons: Any,
        exposure_s: float,
        *,
        seed: int = 0,
        frame: int = 0,
        region: Rectangle | None = None,
        temperature_c: float | None = None,
        scene: AnyScene | None = None,
    ) -> GpuFrame:
        """Return a raw frame from mean electrons, which several frames may share.

        Parameters
        ----------
        mean_electrons
            (rows, cols) float32 of the whole chip, not negative: an array of the GPU, of any library with
            `__cuda_array_interface__`, or of the host.
        exposure_s, seed, frame, region, temperature_c, scene
            As for `Camera.expose`.

        Raises
        ------
        InputError
            As `Camera.expose`.
        """
        return self._expose(mean_electrons, exposure_s, Shot(seed, frame, region, self._gpu, temperature_c), scene)

    def _expose(self, mean_electrons: Any, exposure_s: float, shot: Shot, scene: AnyScene | None) -> GpuFrame:
        camera, electrons = self.camera, self._gpu.put(mean_electrons)
        numbers = read_frame(camera.sensor, camera.measured_chip, electrons, check_exposure(exposure_s), shot)
        return GpuFrame(numbers, frame_fields(camera, exposure_s, shot, scene), self._gpu.arrays)

    def wait(self) -> None:
        """Wait until the GPU has done all work; the other methods return before, as CuPy does."""
        self._gpu.arrays.wait()

    def _rate(self, scene: Scene) -> Any:
        """Return (rows, cols) mean electrons from light per second, as `mean_image.electron_rate`."""
        camera, arrays = self.camera, self._gpu.arrays
        warn_of_transmittance_range(camera.optics, camera.sensor)
        warn_of_missing_light(scene, camera.sensor)
        coupling, xp = checked_coupling(scene, camera), arrays.xp
        if scene.shape == (1, 1):
            electrons = coupling.sum(axis=2) @ scene.weights[:, 0, 0].astype(np.float64)
            rate = arrays.put(uniform_mosaic(electrons, camera.sensor))
        else:
            parts = mosaic_parts(scene, camera, coupling)
            assert all(map(runs_on_device, parts.layers))
            rate = mosaic_on_device(arrays, *parts)
        rate = self._not_negative(rate, scene)
        if (scale := self._scale(scene.distance_m)) is not None:
            rate = rate * arrays.put(scale)
        stack = camera.sensor.optical_stack
        if stack is not None and stack.crosstalk is not None:
            rate = gathered_on_device(arrays, rate, crosstalk_fractions(stack.crosstalk, camera.sensor.array.cfa))
        return xp.maximum(rate, xp.zeros_like(rate))

    def _not_negative(self, rate: Any, scene: Scene) -> Any:
        """Return the mosaic with what rounding left below 0 set to 0; see `mean_image.clip_negative`."""
        arrays = self._gpu.arrays
        xp = arrays.xp
        if not float(xp.min(rate)) < -1e-5 * max(float(xp.max(rate)), 0.0):
            return xp.maximum(rate, xp.zeros_like(rate))
        # Rare: of a scene's error, or of a scene that is reported as invalid.
        mosaic = arrays.get(rate)
        relative_error = scene.relative_error + low_rank_error(self.camera.optics, scene.distance_m)
        clip_negative(mosaic, relative_error, lambda: brightest_sample(scene, self.camera))
        return arrays.put(mosaic)

    def _scale(self, distance_m: float) -> NDArray[np.float32] | None:
        """Return relative illumination times angular response of a distance, (rows, cols); None if both are 1."""
        if distance_m not in self._scales:
            camera, array = self.camera, self.camera.sensor.array
            scale = np.ones((array.rows, array.cols), np.float32)
            apply_relative_illumination(scale, camera, distance_m)
            stack = camera.sensor.optical_stack
            if stack is not None and stack.angular_response is not None:
                apply_angular_response(scale, stack.angular_response, camera.sensor, camera.optics, distance_m)
            scale.flags.writeable = False
            self._scales.clear()
            self._scales[distance_m] = None if math.isclose(float(scale.min()), 1.0) and (scale == 1).all() else scale
        return self._scales[distance_m]
