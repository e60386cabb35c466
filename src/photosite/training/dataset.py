"""The dataset: patches of light, exposed to sensors several times."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, fields
from functools import cached_property
from numbers import Integral, Real
from typing import Any, Literal, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from photosite.engine.random_numbers import seed_of_added_noise
from photosite.errors import InputError
from photosite.sensor.clean_frame import clean_numbers
from photosite.sensor.model import Sensor
from photosite.sensor.noise_profile import sensor_noise_profile
from photosite.sensor.readout import digital_numbers
from photosite.sensor.saturation_level import saturation_level_dn
from photosite.training.digest import described
from photosite.training.light import Light, Source
from photosite.training.pair import Pair
from photosite.training.patch import Patch, between, chances, first_of, flip_offset
from photosite.training.spawned_copy import reduced
from photosite.values.cfa import tile_text
from photosite.values.choice import check_choice
from photosite.values.exposure import check_exposure
from photosite.values.shown import Shown

Unit = Literal["dn", "electrons"]
Range = float | tuple[float, float]

MOST_PAIRS = 1 << 32
"""The index is the frame number of the noise, of 32 bits."""


@dataclass(frozen=True, eq=False)
class PairDataset(Shown):
    """Pairs of clean and noisy frames; an item is a function of seed and index alone.

    It has `__len__` and `__getitem__`, pickles, and works in other processes, forked or spawned: torch's DataLoader
    and plain loops take it. Items `draws` i to `draws` (i + 1) - 1 share a patch, its light and
    sensor. Their noise is independent: item i has frame i of the seed. Images follow one another.

    Parameters
    ----------
    source
        The light: `Electrons`, `RawFrames`, or `Scenes` through a lens.
    sensors
        A sensor, or several, of which a patch gets one by chance: other cameras, gain settings
        (`sensor.at_gain_setting(400)`) or chips (`sensor.with_(serial="2")`). A patch lies at a place of the chip that
        is drawn by chance and has the fixed pattern there, drawn or measured.
    crop
        (rows, cols) of a patch, multiples of the color filter array's tile. Default: the source's first image.
    crops, draws
        Patches of each image, and noisy frames of each patch.
    light
        Factor on the light, or (lowest, highest), from which it is drawn, uniform in the logarithm.
    exposure_s
        Exposure time, or (shortest, longest), drawn likewise. It is that of the dark current, and of scenes.
    flips
        Whether half of the patches have their rows reversed, and half their columns; the color filter array stays.
    unit
        "dn": digital numbers, black level included. "electrons": (DN - black level) / gain of both frames, for sensors
        without effects and captures.
    seed
        0 to 2^64 - 1.

    Raises
    ------
    InputError
        If an argument is invalid, a patch does not fit the chip or its filter array, there are more than 2^32 items, or
        the source has more noise than a sensor.

    Notes
    -----
    The metadata of an item: `index`, `image`, `draw` and `seed`; `sensor`, `serial` and `gain_setting` (0: none);
    `exposure_s` and `light`; `bits`, `black_level_dn`, `white_level_dn`, `system_gain_dn_per_e`, and `cfa`; `chip_row`
    and `chip_col`, the place on the chip; `own_shot` and `own_floor_e2`, the noise of the light as in `InputNoise`; and
    what the source knows. The variance of `noisy` around the truth is, in DN squared, `noise_offset_dn2` +
    `noise_slope_dn` (clean - black level) plus PRNU (0 each for companded numbers, which have no such line). Light
    without noise is the truth.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.training import Electrons
    >>> sensor = ps.load_sensor("vendor-2.2um")
    >>> ramp = np.linspace(0, 800, 64 * 64, dtype=np.float32).reshape(64, 64)
    >>> pairs = PairDataset(Electrons([ramp]), sensor, crop=(32, 32), crops=4, draws=2, light=(0.1, 1), seed=7)
    >>> len(pairs), pairs[5].noisy.shape, pairs[5].noisy.dtype
    (8, (32, 32), dtype('uint16'))
    >>> clean, noisy, metadata = pairs[5]
    >>> metadata["sensor"], metadata["draw"]
    ('Vendor 2.2 um', 1)
    >>> bool((pairs[4].clean == clean).all()), bool((pairs[4].noisy == noisy).all())
    (True, False)
    """

    source: Source
    sensors: Sensor | Sequence[Sensor]
    _: KW_ONLY
    crop: tuple[int, int] | None = None
    crops: int = 1
    draws: int = 1
    light: Range = 1.0
    exposure_s: Range = 0.01
    flips: bool = False
    unit: Unit = "dn"
    seed: int = 0

    def __post_init__(self) -> None:
        if not isinstance(self.source, Source):
            expected = "Electrons, RawFrames or Scenes of photosite.training"
            raise InputError("source", value=type(self.source).__name__, expected=expected)
        given = (self.sensors,) if isinstance(self.sensors, Sensor) else tuple(self.sensors)
        if not given or not all(isinstance(sensor, Sensor) for sensor in given):
            raise InputError("sensors", value=self.sensors, expected="a sensor, or a list of sensors")
        object.__setattr__(self, "sensors", given)
        for name in ("crops", "draws"):
            if not isinstance(getattr(self, name), Integral) or getattr(self, name) < 1:
                raise InputError(name, value=getattr(self, name), expected="a whole number of 1 or more")
        low, high = _range("light", self.light)
        if not 0 < low <= high < math.inf:
            raise InputError("light", value=self.light, expected="above 0, or (lowest, highest)")
        shortest, longest = map(check_exposure, _ends(self.exposure_s))
        if shortest > longest:
            raise InputError("exposure_s", value=self.exposure_s, expected="a range with the shortest time first")
        check_choice("unit", self.unit, Unit)
        if not isinstance(self.seed, Integral) or not 0 <= self.seed < 1 << 64:
            raise InputError("seed", value=self.seed, expected="an integer from 0 to 2^64 - 1")
        if self.crop is not None:
            object.__setattr__(self, "crop", _checked_crop(self.crop))
        elif self.source.shape is None:
            hint = "Pass {crop}"
            raise InputError("the size of the patches is not given", hint=hint, arguments={"crop": (512, 512)})
        if len(self) > MOST_PAIRS:
            raise InputError("images x crops x draws", value=len(self), expected="at most 2^32")
        for sensor in self.all_sensors:
            self._check_sensor(sensor, high)

    def _check_sensor(self, sensor: Sensor, light: float) -> None:
        where, (rows, cols) = f"sensor '{sensor.name}'", self.shape
        array, plain = sensor.array, sensor.effects is None and sensor.captures is None
        if array.stacked:
            raise InputError("sensors", where=where, value="stacked channels", expected="one channel in each pixel")
        if self.unit == "electrons" and not plain:
            raise InputError(
                "unit", where=where, value=self.unit, expected="'dn' for a sensor with effects or captures"
            )
        if rows > array.rows or cols > array.cols:
            hint = "Give the sensor more rows and columns"
            expected = f"at most the chip, {array.rows} x {array.cols}"
            raise InputError("crop", where=where, value=(rows, cols), expected=expected, hint=hint)
        if rows % len(array.cfa) or cols % len(array.cfa[0]):
            expected = f"multiples of the filter array's tile, {len(array.cfa)} x {len(array.cfa[0])}"
            raise InputError("crop", where=where, value=(rows, cols), expected=expected)
        if self.flips and None in (flip_offset(array.cfa, size, axis) for axis, size in enumerate((rows, cols))):
            expected = f"False for the filter array {tile_text(array.cfa)}, which no reversed patch has"
            raise InputError("flips", where=where, value=True, expected=expected)
        self.source.check(sensor, light)

    @property
    def all_sensors(self) -> tuple[Sensor, ...]:
        """The sensors that patches get."""
        return self.sensors  # type: ignore[return-value]  # made a tuple in __post_init__

    @cached_property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of every frame."""
        rows, cols = self.crop or self.source.shape or (0, 0)
        return int(rows), int(cols)

    def __reduce__(self) -> tuple[Any, ...]:
        return reduced(self)

    def __len__(self) -> int:
        return len(self.source) * self.crops * self.draws

    def __getitem__(self, index: SupportsIndex) -> Pair:
        """Return an item; raise `IndexError` beyond the last, so that loops end."""
        number = item_number(index, len(self))
        patch_number, draw = divmod(number, self.draws)
        image = patch_number // self.crops
        u = chances(int(self.seed), patch_number)
        which = int(u[0] * len(self.all_sensors))
        sensor = self.all_sensors[which]
        patch = Patch(
            self.shape,
            sensor,
            (u[1], u[2]),
            (self.flips and u[3] < 0.5, self.flips and u[4] < 0.5),
            between(*self._light_range, u[5]),
            between(*self._exposure_range, u[6]),
            (u[7], u[10]),
        )
        seen = self.source.light(image, patch)
        array = sensor.array
        corner = (
            first_of(array.rows - self.shape[0], len(array.cfa), 0, u[8]),
            first_of(array.cols - self.shape[1], len(array.cfa[0]), 0, u[9]),
        )
        clean, noisy = self._exposed(sensor, seen, patch.exposure_s, corner, number)
        facts = {"index": number, "image": image, "draw": draw, "seed": int(self.seed)}
        facts |= self._facts(which, patch, corner, seen)
        if self.unit == "electrons":
            black, gain = np.float32(facts["black_level_dn"]), np.float32(facts["system_gain_dn_per_e"])
            clean, noisy = (clean - black) / gain, (noisy.astype(np.float32) - black) / gain
        return Pair(clean, noisy, facts)

    def _exposed(
        self, sensor: Sensor, seen: Light, exposure_s: float, corner: tuple[int, int], frame: int
    ) -> tuple[NDArray[np.float32], NDArray[Any]]:
        rows, cols = self.shape
        region = corner[0], corner[0] + rows, corner[1], corner[1] + cols
        electrons, inside = seen.electrons, (slice(None), slice(None))
        if sensor.effects is not None or sensor.captures is not None:
            # Stages that move charge need the whole chip, which gets no light outside the patch.
            inside = slice(region[0], region[1]), slice(region[2], region[3])
            electrons = np.zeros((sensor.array.rows, sensor.array.cols), np.float32)
            electrons[inside] = seen.electrons
        # Frames with noise of their own may be virtual ones that were drawn with the same seed.
        seed = int(self.seed) if seen.input_noise is None else seed_of_added_noise(int(self.seed))
        noisy = digital_numbers(
            sensor, electrons, exposure_s, input_noise=seen.input_noise, seed=seed, frame=frame, region=region
        )
        return clean_numbers(sensor, electrons)[inside], noisy

    @cached_property
    def _light_range(self) -> tuple[float, float]:
        return _range("light", self.light)

    @cached_property
    def _exposure_range(self) -> tuple[float, float]:
        return _range("exposure_s", self.exposure_s)

    @cached_property
    def _sensor_facts(self) -> list[_SensorFacts]:
        return [_SensorFacts.of(sensor) for sensor in self.all_sensors]

    def _facts(self, number: int, patch: Patch, corner: tuple[int, int], seen: Light) -> dict[str, Any]:
        shared, own = self._sensor_facts[number], seen.input_noise
        return {
            **shared.facts,
            "exposure_s": patch.exposure_s,
            "light": patch.light,
            "noise_offset_dn2": shared.in_dark_dn2 + shared.in_dark_dn2_per_s * patch.exposure_s,
            "chip_row": corner[0],
            "chip_col": corner[1],
            "own_shot": 0.0 if own is None else own.shot,
            "own_floor_e2": 0.0 if own is None else own.floor_e2,
            **seen.facts,
        }

    def describe(self) -> dict[str, Any]:
        """Return all that the items depend on, for manifests: settings, sensors, and digests of the source."""
        names = (entry.name for entry in fields(self) if entry.name not in ("source", "sensors"))
        settings = {name: getattr(self, name) for name in names} | {"crop": self.shape}
        return {
            "settings": described(settings),
            "sensors": described(self.all_sensors),
            "source": self.source.describe(),
        }


@dataclass(frozen=True)
class _SensorFacts:
    """What the items of a sensor share: metadata, and their variance in the dark, which grows with exposure time."""

    facts: dict[str, Any]
    in_dark_dn2: float
    in_dark_dn2_per_s: float

    @classmethod
    def of(cls, sensor: Sensor) -> _SensorFacts:
        black, _ = sensor.output_levels_dn
        bits, companded = sensor.output_bits, sensor.effects is not None and sensor.effects.companded
        slope = in_dark = in_dark_per_s = 0.0
        if sensor.captures is not None:
            combination = sensor.captures.combination
            black, bits = combination.output_black_level_dn, combination.output_bits
        elif not companded:
            at_0, at_1 = (sensor_noise_profile(sensor, exposure_s) for exposure_s in (0.0, 1.0))
            in_dark, after_1_s = (each.offset[0].value * each.span_dn**2 for each in (at_0, at_1))
            slope, in_dark_per_s = at_0.slope[0].value * at_0.span_dn, after_1_s - in_dark
        facts = {
            "sensor": sensor.name,
            "serial": sensor.serial,
            "gain_setting": float(sensor.gain_setting or 0.0),
            "bits": bits,
            "black_level_dn": float(black),
            "white_level_dn": saturation_level_dn(sensor),
            "system_gain_dn_per_e": float(sensor.system_gain_dn_per_e),
            "cfa": tile_text(sensor.array.cfa),
            "noise_slope_dn": float(slope),
        }
        return cls(facts, float(in_dark), float(in_dark_per_s))


def item_number(index: SupportsIndex, count: int) -> int:
    """Return the number of an item, counted from the first; raise `IndexError` beyond the last."""
    number = operator.index(index)
    if not -count <= number < count:
        raise IndexError(f"item {number} of {count}")
    return number % count


def _checked_crop(crop: Any) -> tuple[int, int]:
    given = crop if isinstance(crop, tuple | list) else ()
    sides = [int(side) for side in given if isinstance(side, Integral)]
    if not len(given) == len(sides) == 2 or min(sides) < 1:
        raise InputError("crop", value=crop, expected="(rows, cols), two whole numbers above 0")
    return sides[0], sides[1]


def _ends(given: Any) -> tuple[Any, Any]:
    return (given[0], given[1]) if isinstance(given, tuple | list) and len(given) == 2 else (given, given)


def _range(name: str, given: Range) -> tuple[float, float]:
    low, high = _ends(given)
    if not (isinstance(low, Real) and isinstance(high, Real)):
        raise InputError(name, value=given, expected="a number, or (lowest, highest)")
    return float(low), float(high)
