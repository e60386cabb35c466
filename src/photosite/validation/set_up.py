"""The set-up of another simulator, and photosite's simulation of it: patches without noise, or a mosaic."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.color.spectrum import Rule
from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.small import read_small
from photosite.frames.raw_frame import RawFrame
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.charts import MACBETH_NAMES
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.validation.patch_values import PatchValues, Unit
from photosite.values.cfa import channel_sites

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
    names
        Patch names.
    radiance
        (patches, wavelengths) photons/s/sr/m2/nm.
    wavelength_nm
        (wavelengths,), increasing.
    distance_m
        Distance from the lens to the chart.
    chart
        The chart as a scene that fills the frame; None if only the light of its patches is known.
    """

    camera: Camera
    exposure_s: float
    names: tuple[str, ...]
    radiance: NDArray[np.float64]
    wavelength_nm: NDArray[np.float64]
    distance_m: float
    chart: Scene | None = None

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
        JSON file as described in docs/isetcam.md: `wavelength_nm` and one object for each case.
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
    cases = _cases(content)
    name = _chosen(file, cases, case)
    facts = _Facts(file, name, cases[name])
    grid = _Facts(file, "the file", content).table("wavelength_nm", 1)
    try:
        set_up = _set_up(facts, grid, integration)
        if "result" not in facts.content:
            return set_up, None
        result = _Facts(file, f"{name}.result", facts.content["result"])
        electrons = result.table("patch_electrons_rgb", 2)
        return set_up, PatchValues.exact(set_up.names, ("R", "G", "B"), "e", electrons)
    except InputError as error:
        raise error.within(name).in_file(file) from None
    except ValueError as error:  # Pydantic's
        raise FileError(file, " ".join(str(error).split()), where=name) from None


@dataclass(frozen=True)
class _Facts:
    """An object of the file, with access to its entries by name and type."""

    file: Path
    name: str
    content: Mapping[str, Any]

    def __post_init__(self) -> None:
        if not isinstance(self.content, Mapping):
            raise FileError(self.file, self.name, expected="an object")

    def get(self, key: str) -> Any:
        if key not in self.content:
            raise FileError(self.file, f"'{key}' is missing", where=self.name)
        return self.content[key]

    def number(self, key: str) -> float:
        value = self.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise FileError(self.file, key, where=self.name, value=value, expected="a number")
        return float(value)

    def table(self, key: str, dimensions: int) -> NDArray[np.float64]:
        try:
            values = np.asarray(self.get(key), dtype=np.float64)
        except (TypeError, ValueError):
            values = np.empty(())
        if values.ndim != dimensions or not values.size or not np.isfinite(values).all():
            kind = "a list" if dimensions == 1 else "a list of rows of one length"
            raise FileError(self.file, key, where=self.name, expected=f"{kind} of finite numbers")
        return values


def _json(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(read_small(file, "a set-up", _LARGEST_BYTES).decode("utf-8-sig"))
    except json.JSONDecodeError as error:
        raise FileError(file, f"is not valid JSON: {error.msg}", error.lineno) from None
    except (UnicodeDecodeError, RecursionError, ValueError) as error:
        raise FileError(file, f"is not valid JSON: {error}") from None
    if not isinstance(content, dict):
        raise FileError(file, "content", expected="an object with 'wavelength_nm' and a case")
    return content


def case_of(path: str | PathLike[str], case: str | None = None) -> str:
    """Return the name of the case that `read_set_up` selects."""
    file = Path(path)
    return _chosen(file, _cases(_json(file)), case)


def _cases(content: Mapping[str, Any]) -> dict[str, Any]:
    return {name: part for name, part in content.items() if isinstance(part, dict) and "patch_photon_radiance" in part}


def _chosen(file: Path, cases: Mapping[str, Any], case: str | None) -> str:
    if case is not None:
        if case not in cases:
            raise FileError(file, "case", value=case, expected="in the file", hint=did_you_mean(case, cases))
        return case
    finished = [name for name, part in cases.items() if "result" in part]
    for names in (list(cases), finished):
        if len(names) == 1:
            return names[0]
    if not cases:
        raise FileError(
            file, "has no case", hint="A case is an object with 'patch_photon_radiance' and the camera's set-up"
        )
    raise FileError(
        file, f"has several cases: {', '.join(cases)}", hint="Pass {case}", arguments={"case": next(iter(cases))}
    )


def _set_up(facts: _Facts, grid: NDArray[np.float64], integration: Rule) -> SetUp:
    radiance = facts.table("patch_photon_radiance", 2)
    return SetUp(
        Camera(
            DiffractionLimited(facts.number("f_number"), facts.number("focal_length_m") * 1e3),
            _sensor(facts, grid),
            integration,
        ),
        facts.number("exposure_s"),
        _names(facts, len(radiance)),
        radiance,
        grid,
        facts.number("object_distance_m"),
    )


def _names(facts: _Facts, count: int) -> tuple[str, ...]:
    names = facts.content.get("patch_names")
    if names is None:
        return NAMES_DOWN_COLUMNS if count == 24 else tuple(f"patch {number}" for number in range(1, count + 1))
    if not isinstance(names, list) or len(names) != count or not all(isinstance(name, str) for name in names):
        raise FileError(facts.file, "patch_names", where=facts.name, expected=f"{count} names, one for each patch")
    return tuple(names)


def _sensor(facts: _Facts, grid: NDArray[np.float64]) -> Sensor:
    efficiency = facts.table("quantum_efficiency_rgb", 2)
    if efficiency.shape != (grid.size, 3):
        raise FileError(
            facts.file,
            "quantum_efficiency_rgb",
            where=facts.name,
            value=efficiency.shape,
            expected=f"of shape ({grid.size}, 3), one row for each wavelength",
        )
    cfa, bits = str(facts.get("cfa")), str(facts.get("bits")).split()
    if not bits or not bits[0].isdecimal():
        raise FileError(facts.file, "bits", where=facts.name, expected="a whole number first, as in '12 bit'")
    gain_v, swing_v = facts.number("conversion_gain_v_per_e"), facts.number("voltage_swing_v")
    pitch_um = facts.number("pixel_m") * 1e6
    if not gain_v > 0:
        raise FileError(facts.file, "conversion_gain_v_per_e", where=facts.name, value=gain_v, expected="above 0")
    return Sensor.model_validate(
        {
            "name": f"{facts.name} of {facts.file.name}",
            "array": {"rows": 2, "cols": 2, "cfa": cfa.removeprefix("bayer-")},
            "pixel": {
                "width_um": pitch_um,
                "height_um": pitch_um,
                "fill_factor": facts.number("fill_factor"),
                "conversion_gain_uv_per_e": gain_v * 1e6,
                "voltage_swing_v": swing_v,
                "well_capacity_e": swing_v / gain_v,
            },
            "channels": {
                channel: {"wavelength_nm": grid.tolist(), "quantum_efficiency": efficiency[:, k].tolist()}
                for k, channel in enumerate("RGB")
            },
            "noise": {
                "read_noise_mv": facts.number("read_noise_v") * 1e3,
                "dsnu_mv": facts.number("dsnu_v") * 1e3,
                "prnu_percent": facts.number("prnu_percent"),
                "dark_voltage_mv_per_s": 0.0,
            },
            "readout": {"bits": int(bits[0])},
        }
    )
