"""Sources of light: arrays of electrons, and linear raw frames whose own noise is accounted for."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from os import PathLike
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import read_only
from photosite.engine.patches import scaled_patch
from photosite.engine.threads import threads_for
from photosite.errors import FileError, InputError, message_of
from photosite.files.small_files import check_stored_file
from photosite.frames.io.formats import read_raw
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.input_noise import InputNoise as InputNoise
from photosite.sensor.input_noise import check_noisier, largest_light
from photosite.sensor.model import Sensor
from photosite.sensor.noise_profile import NoiseProfile
from photosite.training.digest import described, described_files
from photosite.training.kept import Kept
from photosite.training.patch import Patch
from photosite.values.cfa import channel_names, tile_text
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured

Electrons2D = NDArray[np.float32]
FileName = str | PathLike[str]


@dataclass(frozen=True, eq=False)
class Light(Shown):
    """The light of a patch.

    Parameters
    ----------
    electrons
        (rows, cols) float32 mean electrons of the patch, at its light and exposure time.
    input_noise
        Noise that the electrons have; None where they are exact.
    facts
        What goes into the item's metadata.
    """

    electrons: Electrons2D
    input_noise: InputNoise | None
    facts: dict[str, Any]


@runtime_checkable
class Source(Protocol):
    """Images that patches of light are taken from."""

    def __len__(self) -> int:
        """Return the number of images."""
        ...

    @property
    def shape(self) -> tuple[int, int] | None:
        """(rows, cols) of the patches where the dataset does not set them; None if it must."""
        ...

    def light(self, image: int, patch: Patch) -> Light:
        """Return the light of a patch of an image."""
        ...

    def check(self, sensor: Sensor, light: float) -> None:
        """Raise `InputError` if a sensor cannot be exposed to the images times a factor."""
        ...

    def describe(self) -> dict[str, Any]:
        """Return what the images are, with digests of their contents, for manifests."""
        ...


@dataclass(frozen=True, eq=False)
class Electrons(Shown):
    """Mean electrons, given as arrays.

    Parameters
    ----------
    images
        (rows, cols) arrays of electrons, or .npy files of them. The color filter array of a sensor begins at their
        first pixel.
    input_noise
        Noise that the values have; None if they are exact means, such as those of `Camera.mean_electrons`.

    Raises
    ------
    InputError
        If there are no images, or one is not a two-dimensional array of finite numbers; without `input_noise` they must
        not be negative.
    FileError
        If a file is missing.

    Examples
    --------
    >>> source = Electrons([np.full((8, 8), 100.0, np.float32)])
    >>> len(source), source.shape
    (1, (8, 8))
    """

    images: Sequence[NDArray[Any] | FileName]
    input_noise: InputNoise | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "images", listed("images", self.images))
        check_exist(self.images)
        for number, image in enumerate(self.images):
            if not isinstance(image, str | PathLike):
                self._check(image, f"images[{number}]")

    def _check(self, image: NDArray[Any], where: str) -> None:
        if getattr(image, "ndim", None) != 2 or image.size == 0 or image.dtype.kind not in "fiu":
            found = f"{getattr(image, 'shape', type(image).__name__)}"
            raise InputError(where, value=found, expected="a (rows, cols) array of electrons")
        low, high = float(image.min()), float(image.max())
        if not (np.isfinite(low) and np.isfinite(high) and (low >= 0 or self.input_noise is not None)):
            raise InputError(where, value=(low, high), expected="finite and not negative")

    def __len__(self) -> int:
        return len(self.images)

    @property
    def shape(self) -> tuple[int, int] | None:
        """(rows, cols) of the first image."""
        rows, cols = self._image(0).shape
        return int(rows), int(cols)

    def _image(self, number: int) -> NDArray[Any]:
        image = self.images[number]
        if not isinstance(image, str | PathLike):
            return image
        check_stored_file(image)
        try:
            found: NDArray[Any] = np.load(image, mmap_mode="r", allow_pickle=False)
        except OSError as error:
            raise FileError(image, f"cannot be read: {message_of(error)}") from None
        except Exception:  # of many types for a damaged header; the reason in NumPy's message is a guess
            raise FileError(image, "is not an .npy file of numbers, or is damaged") from None
        return found

    def check(self, sensor: Sensor, light: float) -> None:
        """Raise `InputError` if the values times a factor have more noise than a sensor."""
        check_light(sensor, self.input_noise, light)

    def light(self, image: int, patch: Patch) -> Light:
        """Return the electrons of a patch times its light; its exposure time changes the dark current only."""
        whole = self._image(image)
        check_covers(whole.shape, patch.shape, self.images[image] if whole is not self.images[image] else image)
        corner = patch.corner((whole.shape[0], whole.shape[1]))
        if whole.dtype == np.float32 and whole.flags.c_contiguous:
            with threads_for(math.prod(patch.shape)):
                electrons = scaled_patch(read_only(whole), corner, patch.shape, patch.flips, np.float32(patch.light))
        else:
            electrons = np.multiply(patch.cut(whole, corner), np.float32(patch.light), dtype=np.float32, order="C")
        if isinstance(whole, np.memmap):
            self._check(electrons, str(self.images[image]))
        own = self.input_noise
        return Light(electrons, None if own is None else own.scaled(patch.light), place_facts(corner, patch))

    def describe(self) -> dict[str, Any]:
        """Return names and SHA-256 of the images."""
        # Manifests keep the names of their first version.
        own = None if self.input_noise is None else described(self.input_noise) | {"type": "OwnNoise"}
        return {"kind": "electrons", "own_noise": own, "images": described_files(self.images)}


@dataclass(frozen=True, eq=False)
class RawFrames(Shown):
    """Linear raw frames as light: black level taken away, digital numbers divided by the gain.

    Their own shot and read noise are accounted for: a frame gets only the noise that it lacks. What is in a raw frame
    besides temporal noise, such as its fixed pattern, stays in the clean and in the noisy frame. Saturated pixels hold
    no light beyond saturation.

    Parameters
    ----------
    frames
        `RawFrame` objects, or raw files.
    sensor
        The sensor of the frames, for their gain and noise. None: each frame's own noise profile (DNG's NoiseProfile),
        whose slope is taken for photon noise, mean over the channels.
    averaged
        Number of exposures that each frame is the mean of.

    Raises
    ------
    InputError
        If there are no frames, or a frame states no noise profile and no sensor is given.
    FileError
        If a file is missing.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=8, cols=8, black_level_dn=64)
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    >>> raw = camera.expose(np.full((8, 8), 1000, np.float32), 0.01)
    >>> electrons, noise = RawFrames([raw]).electrons(0)
    >>> bool(abs(electrons.mean() / 1000 - 1) < 0.02), noise.shot
    (True, 1.0)
    """

    frames: Sequence[RawFrame | FileName]
    sensor: Sensor | None = None
    averaged: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", listed("frames", self.frames))
        check_exist(self.frames)
        for number, frame in enumerate(self.frames):
            if not isinstance(frame, RawFrame | str | PathLike):
                raise InputError(f"frames[{number}]", value=type(frame).__name__, expected="a RawFrame or a raw file")
        if not isinstance(self.averaged, Integral) or self.averaged < 1:
            raise InputError("averaged", value=self.averaged, expected="a whole number, 1 or more")
        if not isinstance(self.sensor, Sensor | None):
            raise InputError("sensor", value=self.sensor, expected="a Sensor, as from load_sensor, or None")
        if self.sensor is not None and (self.sensor.effects is not None or self.sensor.captures is not None):
            hint = "Linearize the frames, and name a sensor without effects"
            raise InputError(
                "sensor", value=self.sensor.name, expected="linear, without effects or captures", hint=hint
            )
        object.__setattr__(self, "_kept", Kept())
        for frame in self.frames:
            if isinstance(frame, RawFrame):
                self._gain(frame)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def shape(self) -> tuple[int, int] | None:
        """(rows, cols) of the first frame."""
        rows, cols = self._frame(0).dn.shape
        return int(rows), int(cols)

    def _frame(self, number: int) -> RawFrame:
        frame = self.frames[number]
        if isinstance(frame, RawFrame):
            return frame
        kept: Kept[RawFrame] = self._kept  # type: ignore[attr-defined]  # set in __post_init__
        return kept.get(number, lambda: read_raw(frame), lambda raw: raw.dn.nbytes)

    def _gain(self, raw: RawFrame) -> tuple[float, InputNoise]:
        """Return DN per electron, and the frame's noise."""
        if self.sensor is not None:
            return self.sensor.system_gain_dn_per_e, InputNoise.of_sensor(self.sensor, self.averaged)
        if raw.noise_profile is None:
            hint = "Pass the frames' sensor to RawFrames, or --input-sensor to photosite dataset"
            raise InputError("a raw frame has no noise profile", hint=hint)
        names = channel_names(raw.cfa)
        slope, offset = (tuple(map(Measured, column.tolist())) for column in raw.noise_profile.T)
        profile = NoiseProfile(names, slope, offset, None, raw.black_level_dn, raw.white_level_dn)
        gain = profile.system_gain_dn_per_e.value
        return gain, InputNoise(1 / self.averaged, (profile.dark_noise_dn.value / gain) ** 2 / self.averaged)

    def electrons(self, image: int) -> tuple[Electrons2D, InputNoise]:
        """Return the electrons of a whole frame, negative in places where it is dark, and their noise."""
        raw = self._frame(image)
        gain, own = self._gain(raw)
        return (raw.dn - np.float32(raw.black_level_dn)) / np.float32(gain), own

    def check(self, sensor: Sensor, light: float) -> None:
        """Raise `InputError` if the first frame times a factor has more noise than a sensor, or another filter array.

        Further frames are checked when they are read.
        """
        self._check(self._frame(0), sensor, light)

    def _check(self, raw: RawFrame, sensor: Sensor, light: float) -> None:
        if raw.cfa != sensor.array.cfa:
            expected = f"that of the frames, {tile_text(raw.cfa)}"
            raise InputError(
                "cfa", where=f"sensor '{sensor.name}'", value=tile_text(sensor.array.cfa), expected=expected
            )
        check_light(sensor, self._gain(raw)[1], light)

    def light(self, image: int, patch: Patch) -> Light:
        """Return the electrons of a patch times its light; its exposure time changes the dark current only."""
        raw = self._frame(image)
        check_covers(raw.dn.shape, patch.shape, image)
        self._check(raw, patch.sensor, patch.light)
        corner = patch.corner((raw.dn.shape[0], raw.dn.shape[1]))
        dn, (gain, own) = patch.cut(raw.dn, corner), self._gain(raw)
        electrons = (dn - np.float32(raw.black_level_dn)) * np.float32(patch.light / gain)
        facts = {"input_saturated": float((dn >= raw.white_level_dn).mean())}
        return Light(electrons, own.scaled(patch.light), place_facts(corner, patch) | facts)

    def describe(self) -> dict[str, Any]:
        """Return names and SHA-256 of the frames."""
        settings = {"sensor": described(self.sensor), "averaged": self.averaged}
        return {"kind": "raw frames", **settings, "images": described_files(self.frames)}


def check_light(sensor: Sensor, own: InputNoise | None, light: float) -> None:
    """Raise `InputError` if measured light times a factor has more noise than a sensor."""
    if own is None:
        return
    check_noisier(sensor, own.scaled(0.0))
    if light > (limit := largest_light(sensor, own)):
        raise InputError(
            "light",
            where=f"sensor '{sensor.name}'",
            value=light,
            expected=f"at most {limit:.3g}, where the input is as noisy as the sensor",
            hint="Choose less, or inputs that are the mean of several exposures",
        )


def check_covers(shape: tuple[int, ...], wanted: tuple[int, int], what: object) -> None:
    """Raise `InputError` if an image is smaller than a patch."""
    if shape[0] < wanted[0] or shape[1] < wanted[1]:
        raise InputError(
            "crop", where=f"image {what}", value=wanted, expected=f"at most the image, {shape[0]} x {shape[1]}"
        )


def check_exist(inputs: Sequence[Any]) -> None:
    """Raise `FileError` if an input is the name of a file that is missing."""
    for given in inputs:
        if isinstance(given, str | PathLike) and not os.path.isfile(given):
            raise FileError(given, "there is no such file")


def place_facts(corner: tuple[int, int], patch: Patch) -> dict[str, Any]:
    """Return the place of a patch in its image."""
    return {
        "image_row": corner[0],
        "image_col": corner[1],
        "flipped_rows": patch.flips[0],
        "flipped_cols": patch.flips[1],
    }


def listed(name: str, values: Any) -> tuple[Any, ...]:
    """Return a sequence as a tuple; raise `InputError` if it is empty or a single value."""
    if isinstance(values, str | PathLike | RawFrame | np.ndarray):
        raise InputError(name, value=type(values).__name__, expected="a list")
    if not (found := tuple(values)):
        raise InputError(name, value=found, expected="a list with at least one entry")
    return found
