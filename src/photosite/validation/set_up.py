"""The set-up of another simulator, and photosite's simulation of it: patches without noise, or a mosaic."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError

from photosite.camera.camera import Camera
from photosite.color.spectrum import Rule
from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.small_files import read_small
from photosite.frames.raw_frame import RawFrame
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.charts import MACBETH_NAMES
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.validation.patch_values import PatchValues, Unit
from photosite.values.cfa import channel_sites
from photosite.values.validated import input_error

_LARGEST_BYTES = 1 << 24

NAMES_DOWN_COLUMNS: tuple[str, ...] = tuple(MACBETH_NAMES[6 * row + col] for col in range(6) for row in range(4))
"""The ColorChecker's patches in ISETCam's order, down the columns: the fourth is white, the last is black."""


@dataclass(frozen=True, eq=False)
class SetUp:
    """A camera, an exposure time and the light of a chart's patches.

    Parameters
    ----------
    camera
        Lens, sensor and integration rule.
    exposure_s
        Exposure time.
    names, radiance
        Patches, and their light: (patches, wavelengths) photons/s/sr/m2/nm.
    wavelength_nm
        (wavelengths,), increasing.
    distance_m
        Distance from the lens to the chart.
    chart
        The chart as a scene that fills the frame; None if only the light of its patches is known.
    case
        Name of the case of a file; None for a set-up that is not from a file.
    """

    camera: Camera
    exposure_s: float
    names: tuple[str, ...]
    radiance: NDArray[np.float64]
    wavelength_nm: NDArray[np.float64]
    distance_m: float
    chart: Scene | None = None
    case: str | None = None

    @classmethod
    def from_chart(cls, camera: Camera, chart: Scene, exposure_s: float) -> SetUp:
        """Return the set-up of a chart with named regions, such as `photosite.scene.charts.macbeth`.

        Examples
        --------
        >>> import photosite as ps
        >>> camera = ps.Camera(ps.DiffractionLimited(8, 50), ps.load_sensor("nikon-d200"))
        >>> found = SetUp.from_chart(camera, ps.charts.macbeth("A", 40), 1 / 3).patch_values("e")
        >>> found.channels, round(float(found.mean[found.names.index("white")].max()))
        (('R', 'G', 'B'), 30600)
        """
        middles = [((region.r0 + region.r1) // 2, (region.c0 + region.c1) // 2) for region in chart.regions]
        return cls(
            camera,
            exposure_s,
            tuple(region.name for region in chart.regions),
            np.array([chart.radiance(row, col) for row, col in middles]),
            chart.wavelength_nm,
            chart.distance_m,
            chart,
        )

    def patch_values(self, unit: Unit) -> PatchValues:
        """Return the mean of each patch and channel in an even field of its light, without noise, blur or dark current.

        Parameters
        ----------
        unit
            "e", not clipped; or "dn" above black, where values above the white level or the well capacity are marked
            as saturated.
        """
        sensor = self.camera.sensor
        cfa = sensor.array.cfa
        camera = replace(self.camera, sensor=sensor.with_(rows=len(cfa), cols=len(cfa[0]), serial=sensor.serial))
        sites = {name: channel_sites(cfa, name) for name in sensor.channel_names}
        fields = (Scene.uniform(light, self.wavelength_nm, self.distance_m) for light in self.radiance)
        tiles = [camera.mean_electrons(field, self.exposure_s).astype(np.float64) for field in fields]
        mean_e = np.array([[np.mean([tile[site] for site in sites[name]]) for name in sites] for tile in tiles])
        if unit == "e":
            return PatchValues.exact(self.names, sensor.channel_names, "e", mean_e)
        range_dn = sensor.white_level_dn - sensor.readout.black_level_dn.value
        mean_dn = mean_e * sensor.system_gain_dn_per_e
        found = PatchValues.exact(self.names, sensor.channel_names, "dn", mean_dn)
        return replace(found, saturated=(mean_dn >= range_dn) | (mean_e >= sensor.pixel.well_capacity_e.value))

    def frames(self, shape: tuple[int, int], *, seed: int = 0, count: int = 1) -> list[RawFrame]:
        """Return raw frames of the chart filling a frame, with noise.

        Raises
        ------
        InputError
            If the set-up has no chart, or as for `Camera.capture`.
        """
        chart, camera = self._camera_for(shape)
        return list(camera.stream(chart, self.exposure_s, count, seed=seed))

    def mean_electrons(self, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Return mean electrons, (rows, cols), of the chart filling a frame; raises as `frames`."""
        chart, camera = self._camera_for(shape)
        return camera.mean_electrons(chart, self.exposure_s)

    def _camera_for(self, shape: tuple[int, int]) -> tuple[Scene, Camera]:
        if self.chart is None:
            raise InputError(
                "a mosaic needs a chart that fills the frame, and this set-up has the light of patches only",
                hint="Compare patch values, or describe the set-up by options",
            )
        sensor = self.camera.sensor
        # Another serial, because the other tool's chip has another fixed pattern.
        chip = sensor.with_(rows=shape[0], cols=shape[1], serial=f"{sensor.serial}, simulated")
        return self.chart, replace(self.camera, sensor=chip)


def read_set_up(
    path: str | PathLike[str], case: str | None = None, *, integration: Rule = "trapezoid"
) -> tuple[SetUp, PatchValues | None]:
    """Read a set-up, and the patch electrons that a tool computed for it, from a JSON file.

    Parameters
    ----------
    path
        JSON file as described in docs/validation/isetcam.md: `wavelength_nm` and one object for each case.
    case
        Name of the case; None selects the only case, or the only case with a result.
    integration
        Rule of the integrals over wavelength.

    Returns
    -------
    tuple
        The set-up, and the electrons of the result; None if the case has no result.

    Raises
    ------
    FileError
        If the file cannot be read, or an entry is missing or invalid.
    """
    file = Path(path)
    content = _json(file)
    name = _chosen(file, content, case)
    try:
        found = _Case.model_validate(content[name] | {"wavelength_nm": content.get("wavelength_nm")})
        optics = DiffractionLimited(found.f_number, found.focal_length_m * 1e3)
        camera = Camera(optics, found.sensor(f"{name} of {file.name}"), integration)
        patches = found.names(), found.patch_photon_radiance, found.wavelength_nm
        set_up = SetUp(camera, found.exposure_s, *patches, found.object_distance_m, case=name)
        if found.result is None:
            return set_up, None
        return set_up, PatchValues.exact(set_up.names, ("R", "G", "B"), "e", found.result.patch_electrons_rgb)
    except ValidationError as error:
        raise input_error(error).within(name).in_file(file) from None
    except InputError as error:
        raise error.within(name).in_file(file) from None


def _table(dimensions: int, kind: str) -> PlainValidator:
    def convert(value: Any) -> NDArray[np.float64]:
        try:
            values = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.empty(())
        if values.ndim != dimensions or not values.size or not np.isfinite(values).all():
            raise InputError("values", expected=f"{kind} of finite numbers")
        return values

    return PlainValidator(convert)


def _bits(value: Any) -> int:
    first, *_ = str(value).split() or [""]
    if not first.isdecimal():
        raise InputError("value", value=value, expected="a whole number first, as in '12 bit'")
    return int(first)


_Number = Annotated[float, Field(allow_inf_nan=False)]
_List = Annotated[NDArray[np.float64], _table(1, "a list")]
_Rows = Annotated[NDArray[np.float64], _table(2, "a list of rows of one length")]


class _Result(BaseModel):
    patch_electrons_rgb: _Rows


class _Case(BaseModel):
    """A case of the file, with the wavelengths that all cases share."""

    model_config = ConfigDict(strict=True)

    f_number: _Number
    focal_length_m: _Number
    object_distance_m: _Number
    exposure_s: _Number
    pixel_m: _Number
    fill_factor: _Number
    conversion_gain_v_per_e: Annotated[_Number, Field(gt=0)]
    voltage_swing_v: _Number
    read_noise_v: _Number
    dsnu_v: _Number
    prnu_percent: _Number
    cfa: str
    bits: Annotated[int, PlainValidator(_bits)]
    wavelength_nm: _List
    quantum_efficiency_rgb: _Rows
    patch_photon_radiance: _Rows
    patch_names: list[str] | None = None
    result: _Result | None = None

    def names(self) -> tuple[str, ...]:
        """Return the names of the patches, in ISETCam's order where the file has none."""
        count = len(self.patch_photon_radiance)
        if self.patch_names is None:
            return NAMES_DOWN_COLUMNS if count == 24 else tuple(f"patch {number}" for number in range(1, count + 1))
        if len(self.patch_names) != count:
            raise InputError("patch_names", value=len(self.patch_names), expected=f"{count} names, one for each patch")
        return tuple(self.patch_names)

    def sensor(self, name: str) -> Sensor:
        """Return the sensor, two by two pixels."""
        grid, efficiency = self.wavelength_nm, self.quantum_efficiency_rgb
        if efficiency.shape != (grid.size, 3):
            expected = f"of shape ({grid.size}, 3), one row for each wavelength"
            raise InputError("quantum_efficiency_rgb", value=efficiency.shape, expected=expected)
        pixel = {
            "width_um": self.pixel_m * 1e6,
            "height_um": self.pixel_m * 1e6,
            "fill_factor": self.fill_factor,
            "conversion_gain_uv_per_e": self.conversion_gain_v_per_e * 1e6,
            "voltage_swing_v": self.voltage_swing_v,
            "well_capacity_e": self.voltage_swing_v / self.conversion_gain_v_per_e,
        }
        noise = {
            "read_noise_mv": self.read_noise_v * 1e3,
            "dsnu_mv": self.dsnu_v * 1e3,
            "prnu_percent": self.prnu_percent,
            "dark_voltage_mv_per_s": 0.0,
        }
        channels = {
            channel: {"wavelength_nm": grid.tolist(), "quantum_efficiency": efficiency[:, k].tolist()}
            for k, channel in enumerate("RGB")
        }
        array = {"rows": 2, "cols": 2, "cfa": self.cfa.removeprefix("bayer-")}
        sections = {
            "array": array,
            "pixel": pixel,
            "channels": channels,
            "noise": noise,
            "readout": {"bits": self.bits},
        }
        return Sensor.model_validate({"name": name, **sections})


def _json(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(read_small(file, "a set-up", _LARGEST_BYTES).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        text, line = getattr(error, "msg", error), getattr(error, "lineno", None)
        raise FileError(file, f"is not valid JSON: {text}", line) from None
    if not isinstance(content, dict):
        raise FileError(file, "content", expected="an object with 'wavelength_nm' and a case")
    return content


def _chosen(file: Path, content: Mapping[str, Any], case: str | None) -> str:
    cases = {name: part for name, part in content.items() if isinstance(part, dict) and "patch_photon_radiance" in part}
    if case is not None:
        if case not in cases:
            raise FileError(file, "case", value=case, expected="in the file", hint=did_you_mean(case, cases))
        return case
    finished = [name for name, part in cases.items() if "result" in part]
    for names in (list(cases), finished):
        if len(names) == 1:
            return names[0]
    if not cases:
        hint = "A case is an object with 'patch_photon_radiance' and the camera's set-up"
        raise FileError(file, "has no case", hint=hint)
    what = f"has several cases: {', '.join(cases)}"
    raise FileError(file, what, hint="Pass {case}", arguments={"case": next(iter(cases))})
