"""Maps of offset, variance and gain in the forms of programs for localization microscopy.

Units differ between programs; `MAP_FORMS` has each. Where a form has one gain for all pixels, it is the median. Forms
were checked against the source code of the programs (2026): smite `LoadData.m`, `convertToPhotons.m`; SMAP
`makegainoffsetCMOS.m`; GDSC SMLM `CameraModelManager.java` and `PerPixelCameraModel.java`; Accent
`CalibrationProcessor.java` and `Calibration.java`; PYME `remFitBuf.py` and `gen_sCMOS_maps.py`; DECODE `camera.py`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, message_of
from photosite.files.small_files import check_stored_file, parse_json, read_small
from photosite.files.writing import atomic_path
from photosite.files.yaml import line_of, read_text, read_yaml
from photosite.sensor.chip import MeasuredChip
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured

Array = NDArray[np.float64]

_LARGEST_JSON = 1 << 30
_MOST_PIXELS = 1 << 28
_NOT_HELD = "blinking pixels, defects, uncertainties, the response to light"


@dataclass(frozen=True, eq=False)
class CameraMaps(Shown):
    """Maps of a camera, (rows, cols) each, as localization programs use them; None where a file has none.

    Parameters
    ----------
    offset_dn
        Mean of dark frames.
    variance_dn2
        Temporal variance of dark frames, with rounding and shot noise of the dark current.
    gain_dn_per_e
        Digital numbers per electron.
    dark_rate_dn_per_s
        Dark current.
    notes
        What was assumed when they were read.
    """

    offset_dn: Array | None = None
    variance_dn2: Array | None = None
    gain_dn_per_e: Array | None = None
    dark_rate_dn_per_s: Array | None = None
    notes: tuple[str, ...] = ()

    def chip(self) -> MeasuredChip:
        """Return the chip; raise `InputError` if the variance is missing or a map is invalid."""
        if self.variance_dn2 is None:
            raise InputError("a chip needs the map of the variance, or of the read noise")
        variance = np.asarray(self.variance_dn2, np.float64)
        offset = np.zeros_like(variance) if self.offset_dn is None else np.asarray(self.offset_dn, np.float64)
        black = float(np.median(offset))
        gain = None if self.gain_dn_per_e is None else np.asarray(self.gain_dn_per_e, np.float64)
        if gain is not None and not (gain > 0).all():
            row, col = np.argwhere(~(gain > 0))[0]
            value = float(gain[row, col])
            raise InputError("gain_dn_per_e", where=f"pixel ({row}, {col})", value=value, expected="above 0")
        noise2 = variance - QUANTIZATION_DN2
        rate = self.dark_rate_dn_per_s
        return MeasuredChip(
            offset_dn=(offset - black).astype(np.float32),
            read_noise_dn=np.copysign(np.sqrt(np.abs(noise2)), noise2).astype(np.float32),
            pixel_gain_dn_per_e=None if gain is None else gain.astype(np.float32),
            dark_rate_dn_per_s=None if rate is None else np.asarray(rate).astype(np.float32),
            black_level_dn=black,
            system_gain_dn_per_e=None if gain is None else float(np.median(gain)),
        )


def sensor_of_chip(chip: MeasuredChip, base: Sensor) -> Sensor:
    """Return a sensor with size, black level, gain, read noise and DSNU of a chip's maps, and all else of `base`.

    Written with the chip (`write_sensor`), its frames have the chip's pattern.
    """
    rows, cols = chip.shape
    made = base.with_(rows=rows, cols=cols, black_level_dn=chip.black_level_dn, maps=None)
    source = "maps of the chip"
    noise = chip.read_noise_dn.astype(np.float64)
    read_dn = math.sqrt(max(float((noise * np.abs(noise)).mean()), 0.0))
    dsnu_dn = float(chip.offset_dn.std(dtype=np.float64))
    read_source = f"{source}: root of the mean variance without rounding"
    dsnu_source = f"{source}: standard deviation of the offset, with its measurement"
    gain = chip.gain_dn_per_e(base.system_gain_dn_per_e)
    if chip.system_gain_dn_per_e is None and chip.pixel_gain_dn_per_e is None:
        changes = {
            "read_noise_e": Measured(read_dn / gain, source=read_source),
            "dsnu_e": Measured(dsnu_dn / gain, source=dsnu_source),
        }
    else:
        volts = made.mv_per_dn
        changes = {
            "conversion_gain_uv_per_e": Measured(gain * volts * 1e3, source=f"{source}: median gain, at these volts"),
            "read_noise_mv": Measured(read_dn * volts, source=read_source),
            "dsnu_mv": Measured(dsnu_dn * volts, source=dsnu_source),
        }
    return made.with_(
        **changes,
        source=f"{source}; the rest as in: {base.provenance.source or base.name}",
    )


def camera_maps(chip: MeasuredChip, exposure_s: float = 0.0) -> CameraMaps:
    """Return the maps of a chip for frames of an exposure time: dark current adds to offset and variance.

    Without gains of single pixels, all have the system gain.

    Raises
    ------
    InputError
        If the chip has no gain.
    """
    gain = chip.pixel_gain_dn_per_e
    if gain is None and chip.system_gain_dn_per_e is None:
        raise InputError("the maps have no gain, which the file needs", hint="Calibrate flat fields too")
    per_e = np.full(chip.shape, chip.system_gain_dn_per_e) if gain is None else gain.astype(np.float64)
    noise = chip.read_noise_dn.astype(np.float64)
    # A variance that was measured below 0 counts as 0.
    variance = np.maximum(noise * np.abs(noise), 0.0) + QUANTIZATION_DN2
    offset = chip.black_level_dn + chip.offset_dn.astype(np.float64)
    rate = None if chip.dark_rate_dn_per_s is None else chip.dark_rate_dn_per_s.astype(np.float64)
    if rate is not None:
        offset += rate * exposure_s
        variance += np.maximum(rate, 0.0) * per_e * exposure_s
    return CameraMaps(offset, variance, per_e, rate)


@dataclass(frozen=True)
class MapForm:
    """How a program stores maps.

    Parameters
    ----------
    suffixes
        Of the file; empty for a folder.
    offset, variance, gain
        Name and unit of each.
    write
        Called with the maps and the path.
    has_dark_rate
        The dark current is beside offset and variance, which are those at exposure zero.
    """

    suffixes: tuple[str, ...]
    offset: str
    variance: str
    gain: str
    write: Callable[[CameraMaps, Path], None]
    has_dark_rate: bool = False

    @property
    def loss(self) -> str:
        """What the form does not hold."""
        return f"not in the file: {_NOT_HELD}"


def _known(maps: CameraMaps) -> tuple[Array, Array, Array]:
    offset, variance, gain = maps.offset_dn, maps.variance_dn2, maps.gain_dn_per_e
    if offset is None or variance is None or gain is None:
        raise InputError("the maps", expected="of offset, variance and gain")
    return offset, variance, gain


def _write_mat(content: Mapping[str, Any], path: Path) -> None:
    from scipy.io import savemat

    with atomic_path(path) as temporary, temporary.open("wb") as file:
        savemat(file, dict(content), do_compression=True)


def _write_smite(maps: CameraMaps, path: Path) -> None:
    offset, variance, gain = (values.astype(np.float32) for values in _known(maps))
    camera = {"ROI": np.array([[1.0, 1.0, *map(float, offset.shape)]])}  # YStart, XStart, YEnd, XEnd
    _write_mat({"Params": {"CCDOffset": offset, "CCDVar": variance, "Gain": gain, "CameraObj": camera}}, path)


def _write_smap(maps: CameraMaps, path: Path) -> None:
    offset, variance, gain = _known(maps)
    names = {"offsetmap": offset, "varmap": variance, "gainmap": 1.0 / gain}
    _write_mat({name: values.astype(np.float32) for name, values in names.items()}, path)


def _write_accent(maps: CameraMaps, path: Path) -> None:
    import json

    offset, variance, gain = _known(maps)
    rate = np.zeros_like(offset) if maps.dark_rate_dn_per_s is None else maps.dark_rate_dn_per_s
    rows, cols = offset.shape
    arrays = {
        "baseline": offset,
        "dcPerSec": rate,
        "rnSq": variance,
        "tnSqPerSec": np.maximum(rate, 0.0) * gain,
        "gain": gain,
    }
    content: dict[str, Any] = {"x0": 0, "y0": 0, "width": cols, "height": rows}
    content |= {name: values.astype(np.float32).ravel().tolist() for name, values in arrays.items()}
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, allow_nan=False), encoding="ascii")


def _write_gdsc(maps: CameraMaps, path: Path) -> None:
    import tifffile

    offset, variance, gain = _known(maps)
    pages = np.stack([offset, gain, variance]).astype(np.float32)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        metadata = {"axes": "ZYX", "Labels": ["Bias", "Gain", "Variance"]}
        tifffile.imwrite(file, pages, imagej=True, metadata=metadata)


def _write_ome(maps: CameraMaps, path: Path) -> None:
    import tifffile

    pages = np.stack(_known(maps)).astype(np.float32)
    names = ["Offset (DN)", "Variance (DN^2)", "Gain (DN/e-)"]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        tifffile.imwrite(file, pages, ome=True, metadata={"axes": "CYX", "Channel": {"Name": names}})


@contextmanager
def _new_folder(path: Path) -> Iterator[Path]:
    path.mkdir(parents=True, exist_ok=True)
    yield path


def _write_pyme(maps: CameraMaps, path: Path) -> None:
    import tifffile

    offset, variance, gain = _known(maps)
    middle = float(np.median(gain))
    images = {"dark": offset, "variance": variance / gain**2, "flatfield": middle / gain}
    with _new_folder(path) as folder:
        for name, values in images.items():
            with atomic_path(folder / f"{name}.tif") as temporary, temporary.open("wb") as file:
                tifffile.imwrite(file, values.astype(np.float32), metadata=None)
        lines = [
            f"Camera.ElectronsPerCount: {1.0 / middle!r}",
            f"Camera.ADOffset: {float(np.median(offset))!r}",
            f"Camera.ReadNoise: {math.sqrt(float(np.median(images['variance'])))!r}",
            "Camera.NoiseFactor: 1.0",
            "Camera.TrueEMGain: 1.0",
            *(f"Camera.{kind}MapID: {kind.lower()}.tif" for kind in ("Dark", "Variance", "Flatfield")),
        ]
        with atomic_path(folder / "metadata.yaml") as temporary:
            temporary.write_text("\n".join([*lines, ""]), encoding="ascii")


def _write_decode(maps: CameraMaps, path: Path) -> None:
    offset, variance, gain = _known(maps)
    middle = float(np.median(gain))
    sigma_e = np.sqrt(variance) / gain
    with _new_folder(path) as folder:
        with atomic_path(folder / "read_sigma.npy") as temporary, temporary.open("wb") as file:
            np.save(file, sigma_e.astype(np.float32))
        lines = [
            "Camera:",
            f"  baseline: {float(np.median(offset))!r}",
            f"  e_per_adu: {1.0 / middle!r}",
            "  em_gain: null",
            "  qe: 1.0",
            f"  read_sigma: {float(np.median(sigma_e))!r}",
            "  spur_noise: 0.0",
        ]
        with atomic_path(folder / "camera.yaml") as temporary:
            temporary.write_text("\n".join([*lines, ""]), encoding="ascii")


MAP_FORMS: Mapping[str, MapForm] = {
    "smite": MapForm((".mat",), "Params.CCDOffset, DN", "Params.CCDVar, DN²", "Params.Gain, DN/e⁻", _write_smite),
    "smap": MapForm((".mat",), "offsetmap, DN", "varmap, DN²", "gainmap, e⁻/DN", _write_smap),
    "accent": MapForm((".calb",), "baseline, DN", "rnSq, DN²", "gain, DN/e⁻", _write_accent, has_dark_rate=True),
    "gdsc": MapForm((".tif", ".tiff"), "slice 1, DN", "slice 3, DN²", "slice 2, DN/e⁻", _write_gdsc),
    "ome": MapForm(
        (".ome.tif", ".ome.tiff"), "channel Offset, DN", "channel Variance, DN²", "channel Gain, DN/e⁻", _write_ome
    ),
    "pyme": MapForm((), "dark.tif, DN", "variance.tif, e⁻²", "flatfield.tif: median gain over gain", _write_pyme),
    "decode": MapForm(
        (),
        "baseline, DN, one number",
        "read_sigma.npy, e⁻ (standard deviation)",
        "e_per_adu, e⁻/DN, one number",
        _write_decode,
    ),
}
"""Forms by the name that `photosite export` takes."""


def write_camera_maps(chip: MeasuredChip, path: str | PathLike[str], form: str, *, exposure_s: float = 0.0) -> None:
    """Write the maps of a chip in the form of another program.

    Parameters
    ----------
    chip
        The chip, with a gain.
    path
        The file, or the folder for forms without suffixes.
    form
        A name in `MAP_FORMS`.
    exposure_s
        Exposure time of the frames that will be analyzed; not used by forms that have the dark current.

    Raises
    ------
    InputError
        If the form is unknown, or the chip has no gain.
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> offset, noise = (np.full((4, 6), value, np.float32) for value in (0, 2))
    >>> chip = MeasuredChip(offset_dn=offset, read_noise_dn=noise, black_level_dn=100, system_gain_dn_per_e=2.2)
    >>> folder = tempfile.TemporaryDirectory()
    >>> write_camera_maps(chip, f"{folder.name}/maps.mat", "smap")
    >>> round(float(read_camera_maps([f"{folder.name}/maps.mat"]).gain_dn_per_e.mean()), 6)
    2.2
    """
    if form not in MAP_FORMS:
        raise InputError("form", value=form, expected=f"one of {', '.join(MAP_FORMS)}")
    chosen = MAP_FORMS[form]
    chosen.write(camera_maps(chip, 0.0 if chosen.has_dark_rate else exposure_s), Path(path))


# Reading


_ROLES = {
    "variance": ("variance", "var", "ccdvar", "varmap", "varim", "rnsq", "rn_sq", "readnoisevariance"),
    "gain": ("gain", "ccdgain", "gainmap", "gainim"),
    "offset": ("offset", "ccdoffset", "offsetmap", "offsetim", "bias", "dark", "baseline", "mean", "pixelbaseline"),
    "dark_rate": ("dcpersec", "dc_per_sec", "thermalcountspers"),
    "flatfield": ("flatfield",),
    "sigma_e": ("readsigma", "read_sigma"),
}


def read_camera_maps(
    paths: Sequence[str | PathLike[str]], *, gain_dn_per_e: float | None = None, in_electrons: bool = False
) -> CameraMaps:
    """Read maps from one file that has several, from a file for each, or from a folder.

    A map is known by the name of its variable, channel or slice, or of its file. Arrays are in DN, DN² and DN/e⁻,
    except in SMAP's form (`varmap` and `gainmap` in one MATLAB file), whose gain is in e⁻/DN, DECODE's
    `read_sigma.npy`, which is in electrons, and PYME's `variance.tif`, which is in e⁻²: a flat field or the settings
    beside it show that it is PYME's. Three pages without labels are offset, gain and variance, as in GDSC SMLM;
    three planes of a NumPy array are offset, variance and gain, as in storm-analysis. Pixels without a valid value, up
    to 1 %, get the median of the map.

    Parameters
    ----------
    paths
        MATLAB (.mat), TIFF and OME-TIFF, Accent (.calb) and NumPy (.npy) files, and settings of PYME or DECODE
        (`metadata.yaml`, `camera.yaml`), which are also read where they lie beside a map. A folder stands for all such
        files in it.
    gain_dn_per_e
        Gain where no map has it, instead of that of the settings; PYME's `flatfield.tif` divides it.
    in_electrons
        The variance is in e⁻².

    Raises
    ------
    FileError
        If a file is missing or invalid, it is not clear which map it has, or maps differ in size.
    InputError
        If two maps are of one kind, or a gain is missing.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> for name, value in (("variance", 4.25), ("gain", 2.2)):
    ...     np.save(f"{folder.name}/{name}.npy", np.full((4, 6), value))
    >>> chip = read_camera_maps([f"{folder.name}/variance.npy", f"{folder.name}/gain.npy"]).chip()
    >>> chip.shape, round(float(chip.read_noise_dn[0, 0]), 3)  # without rounding
    ((4, 6), 2.041)
    """
    files = [file for path in map(Path, paths) for file in _files_of(path)]
    settings = _settings_of(files)
    found: dict[str, tuple[Path, Array]] = {}
    notes: list[str] = []
    for path in files:
        if path.suffix.lower() in _SETTINGS_SUFFIXES:
            continue
        for role, values in _maps_of(path).items():
            if role in found:
                both = [str(found[role][0]), str(path)]
                raise InputError(f"the map of the {role}", value=both, expected="given once")
            first = next(iter(found.values()), (path, values))
            if values.shape != first[1].shape:
                expected = f"{first[1].shape}, that of {first[0].name}"
                raise FileError(path, f"the map of the {role}", value=values.shape, expected=expected)
            complete, note = _completed(path, role, values)
            found[role] = path, complete
            notes += [f"{role}: {path.name}, median {float(np.median(complete)):.4g}", *([note] if note else [])]
    if not found:
        raise FileError(files[0], "states settings of a camera, which are no map", hint="Give the maps too")
    maps = {role: values for role, (_, values) in found.items()}
    shape = next(iter(maps.values())).shape
    gain, flat, offset = maps.get("gain"), maps.get("flatfield"), maps.get("offset")
    if gain is not None and gain_dn_per_e is not None:
        raise InputError("gain_dn_per_e", value=gain_dn_per_e, expected="omitted: a map of the gain is given")
    if settings is not None:
        if gain is None and gain_dn_per_e is None:
            gain_dn_per_e = settings.gain_dn_per_e
            notes.append(
                f"gain: {settings.file.name}, {gain_dn_per_e:.4g} DN/e⁻{'' if flat is None else ' over flatfield'}"
            )
        if offset is None and settings.offset_dn is not None:
            offset = np.full(shape, settings.offset_dn)
            notes.append(f"offset: {settings.file.name}, {settings.offset_dn:.6g} DN in all pixels")
    if gain is None and gain_dn_per_e is not None:
        gain = np.full(shape, float(gain_dn_per_e)) / (1.0 if flat is None else flat)
    variance = maps.get("variance")
    in_electrons = in_electrons or flat is not None or (settings is not None and settings.of_pyme)
    if variance is None and "sigma_e" in maps:
        variance, in_electrons = maps["sigma_e"] ** 2, True
    if variance is not None and in_electrons:
        if gain is None:
            hint, arguments = "Give its map, or {gain_dn_per_e}", {"gain_dn_per_e": 2.2}
            raise InputError("a variance in electrons needs the gain", hint=hint, arguments=arguments)
        if "variance" in maps:
            notes.append("variance: in e⁻², converted with the gain")
        variance = variance * gain**2
    if gain is not None:
        notes.append("the gain is in DN per electron; it divides numbers above the offset")
    return CameraMaps(offset, variance, gain, maps.get("dark_rate"), tuple(notes))


_MAP_SUFFIXES = (".mat", ".tif", ".tiff", ".calb", ".npy")
_SETTINGS_SUFFIXES = (".yaml", ".yml")
_SETTINGS_KEYS = ("Camera.ElectronsPerCount", "e_per_adu")
"""Electrons per number in the settings of PYME and DECODE."""


def is_of_maps(path: Path) -> bool:
    """Return whether a path is a folder or a file that `read_camera_maps` may read.

    Examples
    --------
    >>> is_of_maps(Path("variance.mat")), is_of_maps(Path("noiseprofiles.json"))
    (True, False)
    """
    return path.suffix.lower() in _MAP_SUFFIXES or path.is_dir()


@dataclass(frozen=True)
class _Settings:
    """Numbers of all pixels beside the maps of PYME (`metadata.yaml`) or DECODE (`camera.yaml`)."""

    file: Path
    of_pyme: bool
    gain_dn_per_e: float
    offset_dn: float | None


def _files_of(path: Path) -> list[Path]:
    """Return a file, or the maps and settings in a folder."""
    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in _MAP_SUFFIXES and file.is_file())
    if not files:
        raise FileError(path, f"has no file of maps: {', '.join(_MAP_SUFFIXES)}")
    return files


def _settings_of(files: Sequence[Path]) -> _Settings | None:
    """Return the settings among files, else those that lie beside them."""
    stated = [file for file in files if file.suffix.lower() in _SETTINGS_SUFFIXES]
    beside = dict.fromkeys(file.parent / name for file in files for name in ("metadata.yaml", "camera.yaml"))
    found = [_read_settings(file) for file in stated] or [
        _read_settings(file)
        for file in beside
        if file.is_file() and any(key in read_text(file, "settings of a camera") for key in _SETTINGS_KEYS)
    ]
    if len(found) > 1:
        raise InputError("settings of the camera", value=[str(each.file) for each in found], expected="given once")
    return found[0] if found else None


def _read_settings(file: Path) -> _Settings:
    """Return the settings of a file; numbers are divided by electrons per number, and multiplied by the EM gain."""
    data = read_yaml(file, "settings of PYME or DECODE")
    fields = data if isinstance(data, Mapping) else {}
    of_pyme = _SETTINGS_KEYS[0] in fields
    section = fields if of_pyme else fields.get("Camera", fields)
    names = (
        (_SETTINGS_KEYS[0], "Camera.TrueEMGain", "Camera.ADOffset")
        if of_pyme
        else (_SETTINGS_KEYS[1], "em_gain", "baseline")
    )
    if not isinstance(section, Mapping) or names[0] not in section:
        raise FileError(file, f"states no {' or '.join(_SETTINGS_KEYS)}: it is of neither PYME nor DECODE")

    def number(name: str, above: float) -> float | None:
        value = section.get(name)
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not above < value < math.inf:
            expected = "a finite number" if above == -math.inf else f"above {above:g}"
            raise FileError(file, name, line_of(section, name), value=value, expected=expected)
        return float(value)

    electrons, multiplication, offset = number(names[0], 0.0), number(names[1], 0.0), number(names[2], -math.inf)
    if electrons is None:
        raise FileError(file, names[0], line_of(section, names[0]), value=None, expected="above 0")
    return _Settings(file, of_pyme, (multiplication or 1.0) / electrons, offset)


def _role(name: str) -> str | None:
    """Return which map a name stands for: whole words first, the longest before the others."""
    plain = name.lower().replace("-", "_").replace(" ", "_")
    words = {plain, plain.replace("_", ""), *re.split(r"[_.()]+", plain)}
    known = sorted(((text, role) for role, texts in _ROLES.items() for text in texts), key=lambda item: -len(item[0]))
    return next((role for text, role in known if text in words), None) or next(
        (role for text, role in known if len(text) > 2 and text in plain.replace("_", "")), None
    )


def _maps_of(path: Path) -> dict[str, Array]:
    """Return the maps in a file by role, in DN and electrons."""
    suffix = path.suffix.lower()
    readers = dict(zip(_MAP_SUFFIXES, (_read_mat, _read_tiff, _read_tiff, _read_accent, _read_npy), strict=True))
    if suffix not in readers:
        expected = "a file of maps: .mat, .tif, .calb or .npy"
        raise FileError(path, "suffix", value=suffix, expected=expected)
    check_stored_file(path)
    named = readers[suffix](path)
    if not named:
        raise FileError(path, "holds no map: no array of two dimensions")
    roles = {name: _role(name) for name in named}
    if len(named) == 1 and None in roles.values():
        roles = dict.fromkeys(named, _role(path.name.split(".")[0]))
    found: dict[str, Array] = {}
    for name, role in roles.items():
        if role is None:
            continue
        if role in found:
            raise FileError(path, f"has two maps of the {role}", hint="Save each in a file of its own")
        found[role] = named[name]
    if not found:
        what = f"it is not clear which map it has: {', '.join(named)}"
        hint = "Name the file or the variable offset, variance or gain"
        raise FileError(path, what, hint=hint)
    if {"varmap", "gainmap"} <= {name.lower() for name in named}:  # SMAP
        with np.errstate(divide="ignore"):
            found["gain"] = 1.0 / found["gain"]
    return found


_MOST_DEFECTIVE = 0.01
"""Fraction of pixels without a valid value up to which a map is used."""


def _completed(path: Path, role: str, values: Array) -> tuple[Array, str]:
    """Return a map with the median in pixels without a valid value, which are defective ones, and a note on them."""
    if role in ("gain", "flatfield"):
        wrong, expected = ~(np.isfinite(values) & (values > 0)), "above 0"
    elif role in ("variance", "sigma_e"):
        wrong, expected = ~(np.isfinite(values) & (values >= 0)), "0 or above"
    else:
        wrong, expected = ~np.isfinite(values), "finite"
    count = int(wrong.sum())
    if not count:
        return values, ""
    row, col = np.argwhere(wrong)[0]
    where = f"pixel ({row}, {col})"
    if count > _MOST_DEFECTIVE * values.size:
        what = f"the map of the {role} in {count} of {values.size} pixels, first {where}"
        raise FileError(path, what, value=float(values[row, col]), expected=expected)
    note = f"{role}: {count} pixels, first {where}, have no value that is {expected}; they have the median"
    return np.where(wrong, np.median(values[~wrong]), values), note


def _two_dimensional(values: Any) -> Array | None:
    array = np.asarray(values)
    if array.ndim == 2 and min(array.shape) > 1 and array.dtype.kind in "fiu" and array.size <= _MOST_PIXELS:
        return array.astype(np.float64)
    return None


def _read_mat(path: Path) -> dict[str, Array]:
    """Return the matrices of a MATLAB file and of the fields of its structures."""
    try:
        with path.open("rb") as file:
            is_hdf5 = b"MATLAB 7.3" in file.read(116)
        if is_hdf5:
            return _read_mat_73(path)
        from scipy.io import loadmat

        content = loadmat(path, squeeze_me=True, chars_as_strings=True, verify_compressed_data_integrity=True)
    except FileError:
        raise
    except Exception as error:  # scipy raises many types for a damaged file
        raise FileError(path, f"cannot be read as a MATLAB file: {message_of(error)}") from None
    found: dict[str, Array] = {}
    for name, value in content.items():
        if name.startswith("__"):
            continue
        fields = value.dtype.names if isinstance(value, np.ndarray) and value.dtype.names else ()
        parts = {field: value[field].item() for field in fields if value.size == 1} if fields else {name: value}
        found |= {key: array for key, part in parts.items() if (array := _two_dimensional(part)) is not None}
    return found


def _read_mat_73(path: Path) -> dict[str, Array]:
    import h5py

    found: dict[str, Array] = {}
    with h5py.File(path, "r") as file:
        for name, value in [
            *file.items(),
            *(item for group in file.values() if isinstance(group, h5py.Group) for item in group.items()),
        ]:
            if (
                isinstance(value, h5py.Dataset)
                and value.ndim == 2
                and value.size <= _MOST_PIXELS
                and value.dtype.kind in "fiu"
            ):
                array = _two_dimensional(value[()])
                if array is not None:
                    found[name] = array.T  # MATLAB counts columns first
    return found


def _read_tiff(path: Path) -> dict[str, Array]:
    """Return the pages of a TIFF file by their labels (ImageJ), channels (OME), or in the order of GDSC SMLM."""
    import tifffile

    try:
        with tifffile.TiffFile(path) as file:
            pages = file.pages
            labels = list((file.imagej_metadata or {}).get("Labels") or [])
            if file.ome_metadata:
                labels = re.findall(r'<Channel\b[^>]*\bName="([^"]*)"', file.ome_metadata)
            count = len(pages)
            if count > 16 or sum(math.prod(page.shape) for page in pages) > 16 * _MOST_PIXELS:
                raise FileError(path, "has more than 16 pages, which are not maps")
            values = [_two_dimensional(page.asarray()) for page in pages]
    except FileError:
        raise
    except Exception as error:  # tifffile raises many types for a damaged file
        raise FileError(path, f"cannot be read as a TIFF file: {message_of(error)}") from None
    if len(labels) != count:
        labels = ["offset", "gain", "variance"] if count == 3 else [f"page {k + 1}" for k in range(count)]
    return {label: array for label, array in zip(labels, values, strict=True) if array is not None}


def _read_accent(path: Path) -> dict[str, Array]:
    data = parse_json(read_small(path, "a calibration of Accent", _LARGEST_JSON), path)
    try:
        shape = int(data["height"]), int(data["width"])
        names = {"baseline": "baseline", "rnSq": "rnsq", "gain": "gain", "dcPerSec": "dcpersec"}
        return {role: np.array(data[name], np.float64).reshape(shape) for name, role in names.items()}
    except (KeyError, TypeError, ValueError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise FileError(path, f"is not a calibration of Accent: {reason}") from None


def _read_npy(path: Path) -> dict[str, Array]:
    try:
        array = np.load(path, allow_pickle=False)
    except Exception as error:  # NumPy recommends unsafe loading
        raise FileError(path, f"cannot be read as an array: {message_of(error)}") from None
    planes = {path.stem: array}
    if array.ndim == 3 and len(array) == 3:  # storm-analysis
        planes = dict(zip(("offset", "variance", "gain"), array, strict=True))
    return {name: values for name, plane in planes.items() if (values := _two_dimensional(plane)) is not None}
