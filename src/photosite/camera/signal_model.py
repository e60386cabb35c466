"""Mean and variance of raw frames as differentiable functions of scene, exposure, lens and sensor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.camera.camera import Camera
from photosite.camera.charge_conversion import COUPLING, DIFFERENTIABLE_EFFECTS, ChargeConversion
from photosite.camera.differentiable_image import DifferentiableImage, ImageValues
from photosite.camera.mean_image import warn_of_missing_light
from photosite.camera.optical_stack import (
    CrosstalkGather,
    apply_optical_stack,
    combined_fractions,
    kernels_of_channels,
    warn_of_transmittance_range,
)
from photosite.engine.clipped_normal import ClippedMoments, clipped_moments
from photosite.errors import InputError, did_you_mean
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.point_spread import RadialPsf
from photosite.scene.scene import Scene
from photosite.sensor.effects.response_curve import ResponseCurve
from photosite.values.exposure import check_exposure
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_IMAGE = ("fill_factor", "f_number", "focal_length_mm")
_KERNELS = ("optical_crosstalk", "electrical_crosstalk")
_EFFICIENCY = "quantum_efficiency"
_POLYNOMIAL = "polynomial_percent"
_CONDITIONS = {
    "exposure_s": "above 0",
    "fill_factor": "above 0 and at most 1",
    "system_gain_dn_per_e": "above 0",
    "well_capacity_e": "above 0",
}
_ROUNDING = 1e-9
"""How far below 0 rounding may leave a dark pixel, relative to the brightest one."""


class SignalMoments(NamedTuple):
    """Mean and variance of the digital numbers of every pixel, (rows, cols) each, or their derivatives."""

    mean_dn: Array
    variance_dn2: Array


@dataclass(frozen=True, eq=False)
class SignalModel(Shown):
    """Mean and variance of the digital numbers of every pixel of a camera's frames, with exact derivatives.

    The variance is that of one pixel over frames and over chips with other fixed patterns. With `prnu_percent`,
    `dsnu_e` and `dcnu_percent` of 0 it is the variance from frame to frame. Row and column noise are part of the read
    noise; their correlation between pixels is not described.

    Parameters
    ----------
    camera
        The lens has a rotationally symmetric blur, the same over the whole field, and no distortion or veiling glare,
        such as `DiffractionLimited`. The sensor has no measured maps, several captures or stacked channels, and of the
        effects at most response curve and interpixel capacitance.
    scene
        A flat scene that does not move.
    exposure_s
        Exposure time.

    Raises
    ------
    InputError
        If the camera or the scene has a part without derivatives; the field names it.

    Notes
    -----
    Values are given by the names of `parameters`; what is not given keeps the camera's value:

    ==================================================  ===============================================================
    `weights`                                           of the scene, (K, rows, cols)
    `exposure_s`                                        s
    `f_number`, `focal_length_mm`                       of a `DiffractionLimited` lens
    `fill_factor`                                       above 0, at most 1
    `quantum_efficiency`                                (channels, wavelengths) of a sensor whose channels have the same
                                                        wavelengths, 0 to 1
    `optical_crosstalk`, `electrical_crosstalk`         (channels, n, n) kernels of a sensor that has them, n as there
    `system_gain_dn_per_e`, `black_level_dn`            of the converter
    `well_capacity_e`                                   e-
    `read_noise_e`, `dsnu_e`                            e-
    `prnu_percent`, `dcnu_percent`                      %
    `dark_current_e_per_s`                              e-/s
    `polynomial_percent`                                (n,) of a response curve that is a polynomial
    `coupling_percent`, `diagonal_percent`              of interpixel capacitance
    ==================================================  ===============================================================

    The mean is exact where neither well nor converter clips a frame. Near these limits it is the mean of a clipped
    normal distribution, rounding included (`photosite.engine.clipped_normal`).

    A response curve counts as straight over the noise of a pixel, which neglects s'' v / 2 electrons of the mean: for a
    deviation of -2 % at the well, 0.02 electrons. With interpixel capacitance, what a pixel gets from its neighbors
    counts as normal noise.

    The light is computed in double precision, without the approximations of `Camera.mean_electrons`, with which it
    agrees to about 1e-5 of the brightest pixel. Memory is about 25 bytes times pixels, channels and basis spectra;
    about 4 bytes times pixels and wavelengths more where the quantum efficiency varies, and 600 bytes times pixels with
    interpixel capacitance.

    References
    ----------
    R. Price, "A useful theorem for nonlinear devices having Gaussian inputs", IRE Trans. Inf. Theory 4 (1958) 69.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=24, cols=36)
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    >>> model = SignalModel(camera, ps.charts.macbeth(), exposure_s=1 / 30)
    >>> mean_dn, variance_dn2 = model({"fill_factor": 0.8})
    >>> mean_dn.shape
    (24, 36)
    >>> slope = model.jvp({"fill_factor": 0.8}, {"fill_factor": 1.0}).mean_dn
    >>> step = model({"fill_factor": 0.8001}).mean_dn - model({"fill_factor": 0.7999}).mean_dn
    >>> bool(np.abs(slope - step / 0.0002).max() < 1e-6 * slope.max())
    True
    >>> gradient = model.vjp({"fill_factor": 0.8}, (np.ones_like(mean_dn), np.zeros_like(mean_dn)))
    >>> bool(np.isclose(gradient["fill_factor"], slope.sum()))
    True
    """

    camera: Camera
    scene: Scene
    exposure_s: float

    def __post_init__(self) -> None:
        check_exposure(self.exposure_s)
        _check(self.camera, self.scene)
        warn_of_missing_light(self.scene, self.camera.sensor)
        warn_of_transmittance_range(self.camera.optics, self.camera.sensor)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the values that this camera and scene can be differentiated by."""
        return tuple(self._own)

    @property
    def values(self) -> dict[str, Array]:
        """The values of camera, scene and exposure by name, float64; numbers are arrays of shape ()."""
        return {name: value.copy() for name, value in self._own.items()}

    def __call__(self, values: Mapping[str, ArrayLike] | None = None) -> SignalMoments:
        """Return mean and variance at given values.

        Parameters
        ----------
        values
            Values by name; what is not given keeps the camera's value.

        Raises
        ------
        InputError
            If a name is not one of `parameters`, or a value has another shape, is not finite, or out of range.
        """
        found = self._state(values).moments
        return SignalMoments(found.mean.copy(), found.variance.copy())

    def mean_electrons(self, values: Mapping[str, ArrayLike] | None = None) -> Array:
        """Return (rows, cols) mean electrons from light, as `Camera.mean_electrons` in float64."""
        return self._state(values).light_e.copy()

    def jvp(self, values: Mapping[str, ArrayLike], tangents: Mapping[str, ArrayLike]) -> SignalMoments:
        """Return the derivative of mean and variance along a direction: a Jacobian-vector product.

        Parameters
        ----------
        values
            As for a call: where to differentiate.
        tangents
            The direction by name, each of the shape of the value; what is not given is 0.

        Returns
        -------
        SignalMoments
            Derivatives of mean and variance.
        """
        state, directions = self._state(values), self._arrays(tangents, "tangents")
        of_inputs = state.inputs_along(directions)
        moments = state.moments
        return SignalMoments(moments.of_mean.along(*of_inputs), moments.of_variance.along(*of_inputs))

    def vjp(
        self,
        values: Mapping[str, ArrayLike],
        cotangents: tuple[ArrayLike, ArrayLike],
        parameters: Iterable[str] | None = None,
    ) -> dict[str, Array]:
        """Return the gradient of a sum over pixels by values: a vector-Jacobian product.

        Parameters
        ----------
        values
            As for a call: where to differentiate.
        cotangents
            (rows, cols) each: the derivatives of a number, such as a likelihood, by mean and variance of every pixel.
        parameters
            The values to differentiate by; None is all in `values`.

        Returns
        -------
        dict
            The derivative of that number by each value, of the value's shape.
        """
        state = self._state(values)
        names = tuple(values if parameters is None else parameters)
        for name in names:
            self._check_name(name)
        if len(cotangents) != 2:
            raise InputError("cotangents", value=len(cotangents), expected="two arrays, of mean and variance")
        of_mean, of_variance = (np.asarray(each, np.float64) for each in cotangents)
        for each in (of_mean, of_variance):
            if each.shape != state.light_e.shape:
                raise InputError("cotangents", value=each.shape, expected=f"two arrays of {state.light_e.shape}")
        moments = state.moments
        of_inputs = tuple(
            of_mean * getattr(moments.of_mean, name) + of_variance * getattr(moments.of_variance, name)
            for name in ("mean", "before", "after", "well")
        )
        gradient = state.gradient(of_inputs, set(names))
        return {name: gradient[name] for name in names}

    def torch(self, values: Mapping[str, Any]) -> tuple[Any, Any]:
        """Return mean and variance as torch tensors that carry gradients; torch must be installed.

        Parameters
        ----------
        values
            Tensors by name, or numbers and arrays. Derivatives reach the tensors that require gradients.

        Returns
        -------
        tuple of torch.Tensor
            Mean and variance, (rows, cols) float64 on the CPU. They can be differentiated once.

        Raises
        ------
        InputError
            As a call; or if torch is not installed.
        """
        from photosite.camera.torch_signal import torch_moments

        mean, variance = torch_moments(self, values)
        return mean, variance

    def camera_at(self, values: Mapping[str, ArrayLike]) -> Camera:
        """Return the camera with given values; weights and exposure time, which are not the camera's, do not matter.

        Raises
        ------
        InputError
            As a call; or if the fractions of a crosstalk kernel are negative or do not sum to 1.
        """
        given = self._arrays(values, "values")
        lens, sensor = self.camera.optics, self.camera.sensor
        of_lens: dict[str, Any] = {
            name: float(given.pop(name)) for name in ("f_number", "focal_length_mm") if name in given
        }
        if of_lens:
            assert isinstance(lens, DiffractionLimited)
            lens = replace(lens, **of_lens)
        if kernels := {name: given.pop(name) for name in _KERNELS if name in given}:
            assert sensor.optical_stack is not None
            assert sensor.optical_stack.crosstalk is not None
            crosstalk = sensor.optical_stack.crosstalk.model_dump()
            for name, of_channels in kernels.items():
                pairs = zip(sensor.channel_names, of_channels.tolist(), strict=True)
                crosstalk[name.removesuffix("_crosstalk")] = dict(pairs)
            sensor = sensor.with_(crosstalk=crosstalk)
        if (efficiencies := given.pop(_EFFICIENCY, None)) is not None:
            pairs = zip(sensor.channel_names, efficiencies.tolist(), strict=True)
            without = {"standard_uncertainty": None}
            changed = {name: sensor.channels[name].model_dump() | without | {_EFFICIENCY: row} for name, row in pairs}
            sensor = sensor.with_(channels={**sensor.channels, **changed})
        if (factors := given.pop(_POLYNOMIAL, None)) is not None:
            sensor = sensor.with_(response_curve={_POLYNOMIAL: factors.tolist()})
        if percents := {name: float(given.pop(name)) for name in COUPLING if name in given}:
            assert sensor.effects is not None
            assert sensor.effects.interpixel_capacitance is not None
            own_percents = {name: getattr(sensor.effects.interpixel_capacitance, name).value for name in COUPLING}
            sensor = sensor.with_(interpixel_capacitance=own_percents | percents)
        changes = {name: float(value) for name, value in given.items() if name not in ("weights", "exposure_s")}
        return replace(self.camera, optics=lens, sensor=sensor.with_(**changes) if changes else sensor)

    @cached_property
    def _own(self) -> dict[str, Array]:
        """The values of camera, scene and exposure."""
        sensor, scene = self.camera.sensor, self.scene
        noise, electrons = sensor.noise, sensor.electrons
        found: dict[str, Any] = {
            "weights": scene.weights,
            "exposure_s": self.exposure_s,
            "fill_factor": sensor.pixel.fill_factor.value,
            "system_gain_dn_per_e": sensor.system_gain_dn_per_e,
            "black_level_dn": sensor.readout.black_level_dn.value,
            "well_capacity_e": sensor.pixel.well_capacity_e.value,
            "read_noise_e": electrons(noise.read_noise_mv.value),
            "dsnu_e": electrons(noise.dsnu_mv.value),
            "prnu_percent": noise.prnu_percent.value,
            "dark_current_e_per_s": electrons(noise.dark_voltage_mv_per_s.value),
            "dcnu_percent": noise.dcnu_percent.value,
        }
        stack = sensor.optical_stack
        if type(self.camera.optics) is DiffractionLimited:
            found["f_number"] = self.camera.optics.f_number
            moves = (
                stack is not None
                and stack.angular_response is not None
                and stack.angular_response.exit_pupil_mm is None
            )
            if scene.width_m is None and not moves:
                found["focal_length_mm"] = self.camera.optics.focal_length_mm
        if stack is not None and (crosstalk := stack.crosstalk) is not None:
            for name, kernels in (("optical", crosstalk.optical), ("electrical", crosstalk.electrical)):
                if kernels is not None:
                    found[f"{name}_crosstalk"] = kernels_of_channels(kernels, sensor.channel_names)
        if len({sensor.channels[name].wavelength_nm for name in sensor.channel_names}) == 1:
            found[_EFFICIENCY] = [sensor.channels[name].quantum_efficiency for name in sensor.channel_names]
        if (effects := sensor.effects) is not None:
            if (curve := effects.response_curve) is not None and curve.polynomial_percent is not None:
                found[_POLYNOMIAL] = curve.polynomial_percent
            if (coupling := effects.interpixel_capacitance) is not None:
                found |= {name: getattr(coupling, name).value for name in COUPLING}
        return {name: np.asarray(value, np.float64) for name, value in found.items()}

    @cached_property
    def _kept(self) -> dict[str, Any]:
        """The latest state and image, which a gradient uses after a call, by what they depend on."""
        return {}

    @cached_property
    def _angular(self) -> Array | None:
        """(rows, cols) angular response of the sensor."""
        sensor = self.camera.sensor
        if sensor.optical_stack is None or sensor.optical_stack.angular_response is None:
            return None
        ones = np.ones((sensor.array.rows, sensor.array.cols), np.float32)
        bare = sensor.with_(crosstalk=None)
        return apply_optical_stack(ones, bare, self.camera.optics, self.scene.distance_m).astype(np.float64)

    def _check_name(self, name: str) -> None:
        if name in self._own:
            return
        where = "SignalModel"
        if name in ("f_number", "focal_length_mm"):
            hint = {
                "f_number": "Use a DiffractionLimited lens",
                "focal_length_mm": "Use a DiffractionLimited lens, a scene without width_m, and exit_pupil_mm in the "
                "angular response",
            }[name]
            raise InputError(f"'{name}' of this camera and scene has no derivative", where=where, hint=hint)
        if name in _KERNELS:
            hint = "Give the sensor kernels, which may be those of no crosstalk"
            raise InputError(f"the sensor has no '{name}'", where=where, hint=hint)
        if name == _EFFICIENCY:
            hint = "Give all channels the same wavelengths"
            raise InputError(f"the channels have '{name}' at different wavelengths", where=where, hint=hint)
        if name in (_POLYNOMIAL, *COUPLING):
            part = "a response curve that is a polynomial" if name == _POLYNOMIAL else "interpixel capacitance"
            raise InputError(f"the sensor has no '{name}'", where=where, hint=f"Give the sensor {part}")
        raise InputError(f"unknown parameter '{name}'", where=where, hint=did_you_mean(name, self._own))

    def _arrays(self, given: Mapping[str, ArrayLike] | None, what: str) -> dict[str, Array]:
        """Return values or tangents as arrays of the right shape."""
        arrays = {}
        if not isinstance(given, Mapping | None):
            raise InputError(what, value=given, expected="a mapping of values by name")
        for name, value in (given or {}).items():
            self._check_name(name)
            try:
                array, shape = np.array(value, np.float64), self._own[name].shape
            except (TypeError, ValueError):
                raise InputError(name, where=what, value=value, expected="a number, or an array of numbers") from None
            if array.shape != shape:
                raise InputError(name, where=what, value=array.shape, expected=f"of shape {shape}")
            if not np.isfinite(array).all():
                raise InputError(name, where=what, expected="finite")
            arrays[name] = array
        return arrays

    def _state(self, values: Mapping[str, ArrayLike] | None) -> _State:
        given = self._arrays(values, "values")
        for name, value in given.items():
            if name == _EFFICIENCY and not (value.min() >= 0.0 and value.max() <= 1.0):
                worst = float(value.min() if value.min() < 0.0 else value.max())
                raise InputError(name, where="values", value=worst, expected="0 to 1")
            if name in ("weights", _EFFICIENCY, _POLYNOMIAL, *_KERNELS):
                continue
            number, condition = float(value), _CONDITIONS.get(name, "0 or above")
            if number < 0 or (number == 0 and name in _CONDITIONS) or (number > 1 and name == "fill_factor"):
                raise InputError(name, where="values", value=number, expected=condition)
        if _POLYNOMIAL in given:
            well_e = float(given.get("well_capacity_e", self._own["well_capacity_e"]))
            try:
                ResponseCurve(polynomial_percent=tuple(given[_POLYNOMIAL].tolist())).check_rising(well_e)
            except InputError as error:
                expected = "factors of a signal that rises with the charge up to the well capacity"
                raise InputError(_POLYNOMIAL, where="values", value=error.value, expected=expected) from None
        key = tuple((name, value.tobytes()) for name, value in sorted(given.items()))
        kept = self._kept.get("state")
        if kept is None or kept[0] != key:
            kept = self._kept["state"] = key, _State(self, self._own | given, given.get(_EFFICIENCY))
        state: _State = kept[1]
        return state

    def _image(self, values: ImageValues) -> DifferentiableImage:
        kept = self._kept.get("image")
        if kept is None or kept[0] != values:
            kept = self._kept["image"] = values, DifferentiableImage(self.camera, self.scene, values)
        image: DifferentiableImage = kept[1]
        return image


class _State:
    """A model at some values: light, moments, and derivatives of each stage."""

    def __init__(self, model: SignalModel, values: dict[str, Array], efficiencies: Array | None) -> None:
        self._values, self._angular, self._cfa = values, model._angular, model.camera.sensor.array.cfa
        own = {name: float(values[name]) for name in _IMAGE if name in values}
        self._image = model._image(replace(ImageValues.of_camera(model.camera), **own))
        if efficiencies is not None:
            self._image = self._image.with_efficiencies(efficiencies)
        self._time_s = float(values["exposure_s"])
        before = self._seen(self._image.image(values["weights"]))
        _check_light(before)
        self._before = np.maximum(before, 0.0)
        names = model.camera.sensor.channel_names
        self._site_channel = np.array([[names.index(name) for name in row] for row in self._cfa])
        self._kernels = {
            name: values.get(name, np.ones((len(names), 1, 1)))[self._site_channel]
            for name in _KERNELS
            if any(kernel in values for kernel in _KERNELS)
        }
        self._gather = None
        if self._kernels:
            self._gather = CrosstalkGather(self._before.shape, combined_fractions(*self._kernels.values()))
        rate = self._before if self._gather is None else self._gather.apply(self._before)
        self.light_e = self._time_s * rate
        # The pixel: mean and variance of the collected charge
        self._dark_e = self._number("dark_current_e_per_s") * self._time_s
        self._prnu, self._dcnu = self._number("prnu_percent") / 100.0, self._number("dcnu_percent") / 100.0
        mean_e = self.light_e + self._dark_e
        variance_e2 = mean_e + (self._prnu * self.light_e) ** 2 + (self._dcnu * self._dark_e) ** 2
        sensor = model.camera.sensor
        self._conversion = ChargeConversion(sensor.effects, values, mean_e, variance_e2)
        self.moments: ClippedMoments = clipped_moments(*self._conversion.inputs, sensor.white_level_dn)

    def _number(self, name: str) -> float:
        return float(self._values[name])

    def _seen(self, image: Array) -> Array:
        return image if self._angular is None else np.asarray(image * self._angular)

    def inputs_along(self, directions: Mapping[str, Array]) -> tuple[Any, ...]:
        """Return the derivatives of the inputs of `clipped_moments` along a direction."""
        rate, time, prnu, dcnu = (
            directions.get(name, 0.0) for name in ("dark_current_e_per_s", "exposure_s", "prnu_percent", "dcnu_percent")
        )
        light = self.light_along(directions)
        dark = rate * self._time_s + self._number("dark_current_e_per_s") * time
        of_prnu = 2.0 * self._prnu * self.light_e * (self._prnu * light + prnu / 100.0 * self.light_e)
        of_dcnu = 2.0 * self._dcnu * self._dark_e * (self._dcnu * dark + dcnu / 100.0 * self._dark_e)
        return self._conversion.along(light + dark, light + dark + of_prnu + of_dcnu, directions)

    def gradient(self, of_inputs: tuple[Array, ...], names: set[str]) -> dict[str, Array]:
        """Return the gradient by values, from the derivatives of a number by the inputs of `clipped_moments`."""
        of_mean_e, of_variance_e2, found = self._conversion.gradient(*of_inputs)
        of_light = of_mean_e + of_variance_e2 * (1.0 + 2.0 * self._prnu**2 * self.light_e)
        of_dark = of_mean_e.sum() + of_variance_e2.sum() * (1.0 + 2.0 * self._dcnu**2 * self._dark_e)
        found["prnu_percent"] = np.asarray((of_variance_e2 * 0.02 * self._prnu * self.light_e**2).sum())
        found["dcnu_percent"] = np.asarray(of_variance_e2.sum() * 0.02 * self._dcnu * self._dark_e**2)
        found["dark_current_e_per_s"] = np.asarray(of_dark * self._time_s)
        found |= self.light_gradient(of_light, names)
        if "exposure_s" in names:
            found["exposure_s"] = found["exposure_s"] + of_dark * self._number("dark_current_e_per_s")
        return found

    def light_along(self, directions: Mapping[str, Array]) -> Array:
        """Return the derivative of `light_e` along a direction."""
        total = np.zeros_like(self.light_e)
        if "exposure_s" in directions:
            total += directions["exposure_s"] * self.light_e / self._time_s
        before = np.zeros_like(total)
        for name, slope in self._image_slopes(set(directions)).items():
            before += directions[name] * slope
        if "weights" in directions:
            before += self._seen(self._image.image(directions["weights"]))
        if _EFFICIENCY in directions:
            before += self._seen(self._image.along_efficiencies(self._values["weights"], directions[_EFFICIENCY]))
        if self._gather is None:
            return total + self._time_s * before
        total += self._time_s * self._gather.apply(before)
        for name in _KERNELS:
            if name in directions:
                fractions = self._fractions_of(name, directions[name])
                total += self._time_s * self._gather.with_fractions(fractions).apply(self._before)
        return total

    def light_gradient(self, cotangent: Array, names: set[str]) -> dict[str, Array]:
        """Return the gradient, by the values that the light depends on, of the sum of cotangent times `light_e`."""
        found: dict[str, Array] = {}
        if "exposure_s" in names:
            found["exposure_s"] = np.asarray((cotangent * self.light_e).sum() / self._time_s)
        before = self._time_s * cotangent
        if self._gather is not None:
            if names & {*_KERNELS}:
                of_fractions = self._gather.by_fractions(before, self._before)
                for name in names & {*_KERNELS}:
                    # The fractions are linear in each entry of a kernel.
                    units = np.eye(self._values[name].size).reshape(-1, *self._values[name].shape)
                    products = [float((of_fractions * self._fractions_of(name, unit)).sum()) for unit in units]
                    found[name] = np.reshape(products, self._values[name].shape)
            before = self._gather.adjoint(before)
        before = self._seen(before)
        for name, slope in self._image_slopes(names, seen=False).items():
            found[name] = np.asarray((before * slope).sum())
        if "weights" in names:
            found["weights"] = self._image.adjoint(before)
        if _EFFICIENCY in names:
            found[_EFFICIENCY] = self._image.by_efficiencies(self._values["weights"], before)
        return found

    def _image_slopes(self, names: set[str], *, seen: bool = True) -> dict[str, Array]:
        """Return the derivatives of the image by those of the names that it depends on."""
        chosen = names & {*_IMAGE}
        if not chosen:
            return {}
        slopes = self._image.derivatives(self._values["weights"], chosen)
        return {name: self._seen(slope) if seen else slope for name, slope in slopes.items()}

    def _fractions_of(self, name: str, kernels: Array) -> Array:
        """Return the gathering kernels with one of the two kernels replaced."""
        return combined_fractions(*(self._kernels | {name: kernels[self._site_channel]}).values())


def _check_light(rate: Array) -> None:
    lowest, highest = float(rate.min()), float(rate.max())
    if not lowest >= -_ROUNDING * max(highest, 0.0):
        hint = "Keep weights and kernels in the range where all radiances are 0 or more"
        raise InputError("electrons from light", where="values", value=lowest, expected="0 or above", hint=hint)


def _check(camera: Camera, scene: Scene) -> None:
    """Raise `InputError` for a camera or a scene that has no derivatives here."""
    if not isinstance(scene, Scene):
        expected = "a flat scene that does not move, of class Scene"
        raise InputError("scene", where="SignalModel", value=type(scene).__name__, expected=expected)
    sensor, lens = camera.sensor, camera.optics
    if (
        scene.polarization is not None
        and scene.polarization.degree.size > 1
        and any(any(sensor.channels[name].polarizer) for name in sensor.channel_names)
    ):
        raise InputError("scene.polarization", where="SignalModel", value="a map", expected="one degree and angle")
    spread = lens.point_spread(scene.distance_m)
    if not isinstance(spread, RadialPsf):
        expected = "a lens with a rotationally symmetric blur, the same over the whole field"
        raise InputError("optics", where="SignalModel", value=type(spread).__name__, expected=expected)
    glare = lens.veiling_glare
    parts: dict[str, Any] = {
        "optics.distortion": None if lens.mapping(scene.distance_m) is None else "a mapping",
        "optics.veiling_glare": None if glare is None or glare.fraction == 0 else glare.fraction,
        "sensor.captures": None if sensor.captures is None else "several",
        "sensor.maps": None if sensor.maps is None else sensor.maps.file,
        "sensor.array.stacked": sensor.array.stacked or None,
    }
    for name in () if sensor.effects is None else type(sensor.effects).model_fields:
        if name not in DIFFERENTIABLE_EFFECTS:
            parts[f"sensor.effects.{name}"] = None if getattr(sensor.effects, name) is None else "given"
    for name, value in parts.items():
        if value is not None:
            hint = "Use with_(maps=None)" if name == "sensor.maps" else None
            raise InputError(name, where="SignalModel", value=value, expected="none, to be differentiable", hint=hint)
