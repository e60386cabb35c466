"""ENVI: a text header (.hdr) and a file of plain numbers beside it, read through the `spectral` library.

Fields used: samples, lines, bands, header offset, data type, interleave, byte order; wavelength and wavelength units;
reflectance scale factor (a divisor); data gain values (a factor per band); data ignore value; bbl, the list of bad
bands (those marked 0 are skipped); and, written by photosite, data units (see `photosite.scene.units`), distance m,
width m, light and data digest.
"""

from __future__ import annotations

import hashlib
import math
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.small_files import read_small, reading
from photosite.files.writing import atomic_path
from photosite.scene.cube import Array, Interleave, RawCube, SpectralCube, Stated, select_bands, wavelengths_in_nm
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import cube_of_scene
from photosite.scene.units import Units, file_units, override_units, parse_units

_DATA_SUFFIXES = ("", ".img", ".dat", ".raw", ".bin", ".hyspex", ".bsq", ".bil", ".bip", ".sli")
_UNIT_FIELDS = ("data units", "radiance units", "units")
_BLOCK_BYTES = 32 << 20
_LARGEST_HEADER = 16 << 20
_INTERLEAVES: tuple[Interleave, ...] = ("bsq", "bil", "bip")


def open_cube(path: Path, options: ReadOptions) -> SpectralCube:
    """Open the cube of an ENVI file, named by its header or by its data."""
    header_path = _header_of(path)
    header = _read_header(header_path)
    with _library_errors(header_path):
        from spectral.io import envi

        stated_order = "byte order" in header
        whole = header if stated_order else {**header, "byte order": "0"}
        envi.check_compatibility(whole)
        layout = envi.gen_params(whole)
        bands = int(layout.nbands)
        shape = int(layout.nrows), int(layout.ncols), bands
        dtype = np.dtype(layout.dtype)
        offset = int(layout.offset)
    interleave = next((kind for kind in _INTERLEAVES if kind == str(header["interleave"]).lower()), None)
    if dtype.kind not in "fiu":
        hint = "Save magnitudes as type 4"
        raise FileError(header_path, "data type", value=str(dtype), expected="integers or real floats", hint=hint)
    if interleave is None:
        raise FileError(header_path, "interleave", value=str(header["interleave"]), expected="bsq, bil or bip")
    if min(shape) <= 0 or offset < 0:
        raise FileError(header_path, "lines, samples and bands", value=shape, expected="above 0")
    data_path = _data_of(path, header_path)
    _check_size(header_path, data_path, offset + math.prod(shape) * dtype.itemsize)
    if not stated_order and dtype.itemsize > 1:
        dtype = _guessed_order(header_path, data_path, dtype, offset)
    if "data digest" in header and str(header["data digest"]) != _digest(data_path):
        hint = "Write the cube again, or remove the line 'data digest' if the data were changed on purpose"
        raise FileError(data_path, f"holds other data than {header_path.name} was written with", hint=hint)
    stated = Stated(header_path, header)
    values: Any = stated.numbers("wavelength", bands)
    unit = str(header["wavelength units"]) if "wavelength units" in header else None
    if unit is not None and unit.strip().lower() in ("", "unknown"):
        unit = None
    if values is None and options.wavelength_nm is None:
        values, unit = _named_wavelengths(header.get("band names"), bands)
    units = _units(header_path, header, stated.number("reflectance scale factor", above_0=True), options)
    gain, added = stated.numbers("data gain values", bands), stated.numbers("data offset values", bands)
    if added is not None and added.any():
        raise FileError(header_path, "has data offset values, which are not supported", hint="Apply them to the data")
    cube = RawCube(
        name=str(path),
        shape=shape,
        wavelength_nm=wavelengths_in_nm(header_path, values, unit, options.wavelength_nm),
        quantity=units.quantity,
        title=path.stem,
        path=data_path,
        dtype=dtype,
        interleave=interleave,
        offset=offset,
        scale=units.scale if gain is None else units.scale * gain,
        **stated.head(bands, "data ignore value"),
    )
    bbl = stated.numbers("bbl", bands)
    return cube if bbl is None or bbl.all() else select_bands(cube, _good_bands(header_path, bbl))


_BAND_NAME = re.compile(r".*?\b(\d+(?:\.\d+)?) *(nm|um|µm|nanometers?|micrometers?)\b.*", re.IGNORECASE)


def _named_wavelengths(names: Any, bands: int) -> tuple[list[float] | None, str | None]:
    """Return the wavelengths in the names of bands, such as `Band 1 (450.2 nm)`, if all state them in one unit."""
    found = [_BAND_NAME.fullmatch(str(name)) for name in names] if isinstance(names, list) else []
    units = {match[2].lower() for match in found if match}
    if len(found) != bands or not all(found) or len(units) != 1:
        return None, None
    return [float(match[1]) for match in found if match], units.pop()


_GUESSED_BYTES = 1 << 20
_CLEAR_RATIO = 4.0


def _guessed_order(header_path: Path, data_path: Path, dtype: np.dtype[Any], offset: int) -> np.dtype[Any]:
    """Return the data type in the byte order in which neighboring numbers are far more alike.

    ENVI requires the field; some programs omit it.
    """
    with reading(data_path), data_path.open("rb") as file:
        file.seek(offset)
        content = file.read(_GUESSED_BYTES // dtype.itemsize * dtype.itemsize)
    kinds = {"little": dtype.newbyteorder("<"), "big": dtype.newbyteorder(">")}
    steps = {}
    for name, kind in kinds.items():
        values = np.frombuffer(content, kind).astype(np.float64)
        with np.errstate(all="ignore"):
            spread = float(np.abs(values - values.mean()).mean())
            steps[name] = float(np.abs(np.diff(values)).mean()) / spread if spread > 0 else math.nan
        if not np.isfinite(values).all():
            steps[name] = math.inf
    likely = min(steps, key=lambda name: math.inf if math.isnan(steps[name]) else steps[name])
    other = steps["big" if likely == "little" else "little"]
    if math.isnan(other) or math.isnan(steps[likely]) or not other > _CLEAR_RATIO * steps[likely]:
        hint = "Add the line 'byte order = 0' (little-endian, as on PCs) or 'byte order = 1' (big-endian)"
        raise FileError(header_path, "states no byte order, and the data do not show it", hint=hint)
    what = f"the header states no byte order; {likely}-endian is used, in which neighboring values are alike"
    hint = f"Add the line 'byte order = {int(likely == 'big')}' to state it"
    warnings.warn(PhotositeWarning(what, where=str(header_path), hint=hint), stacklevel=3)
    return kinds[likely]


def _header_of(path: Path) -> Path:
    if path.suffix.lower() == ".hdr":
        return path
    for candidate in (path.with_suffix(".hdr"), path.with_name(path.name + ".hdr"), path.with_suffix(".HDR")):
        if candidate.is_file():
            return candidate
    with path.open("rb") as file:
        if file.read(4) == b"ENVI":
            return path
    raise FileError(path, f"has no header {path.with_suffix('.hdr').name} beside it")


def _data_of(path: Path, header_path: Path) -> Path:
    if path != header_path:
        return path
    for suffix in _DATA_SUFFIXES:
        for candidate in {header_path.with_suffix(suffix), header_path.with_suffix(suffix.upper())}:
            if candidate.is_file() and candidate != header_path:
                return candidate
    raise FileError(path, f"has no data beside it, such as {header_path.with_suffix('.img').name}")


@contextmanager
def _library_errors(path: Path) -> Iterator[None]:
    """Turn the library's exceptions into a `FileError`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # field names in capitals
            yield
    except ImportError:
        hint = "Run pip install '.[spectral]' in the clone"
        raise FileError(path, "is ENVI, which needs the extra 'spectral'", hint=hint) from None
    except KeyError as error:
        raise FileError(path, f"is not a complete ENVI header: {error} is missing or unknown") from None
    except FileError:
        raise
    except Exception as error:  # the exceptions of the library's parser
        reason = " ".join(str(error).split())[:200]
        raise FileError(path, f"cannot be read as an ENVI header ({reason})") from None


def _read_header(path: Path) -> Mapping[str, Any]:
    with _library_errors(path):
        from spectral.io import envi

        read_small(path, "an ENVI header", _LARGEST_HEADER)
        header = envi.read_envi_header(str(path))
    if str(header.get("file compression", "0")).strip() not in ("0", ""):
        raise FileError(path, "has compressed data", hint="Save it without compression")
    if str(header.get("file type", "")).strip().lower() == "envi spectral library":
        raise FileError(path, "is a library of spectra, not an image")
    return {{"distance m": "distance_m", "width m": "width_m"}.get(name, name): header[name] for name in header}


def _check_size(header_path: Path, data_path: Path, wanted: int) -> None:
    size = data_path.stat().st_size
    if size != wanted:
        hint = f"Check that the file is complete and that {header_path.name} is its header"
        raise FileError(data_path, "size", value=f"{size} bytes", expected=f"{wanted} bytes by its header", hint=hint)


_PARTS, _PART_BYTES = 64, 4096


def _digest(path: Path) -> str:
    """Return a digest of parts of a file, evenly spaced: a cube of gigabytes is not read for it."""
    digest = hashlib.sha256()
    with reading(path), path.open("rb") as file:
        last = max(0, path.stat().st_size - _PART_BYTES)
        for part in range(_PARTS):
            file.seek(last * part // (_PARTS - 1))
            digest.update(file.read(_PART_BYTES))
    return digest.hexdigest()


def _good_bands(path: Path, bbl: Array) -> NDArray[np.bool_]:
    bad = np.flatnonzero(bbl == 0)
    if len(bad) == bbl.size:
        raise FileError(path, "marks all its bands as bad (bbl)", hint="Mark good bands with 1, or remove bbl")
    what = f"{len(bad)} of {bbl.size} bands are marked as bad (bbl) and skipped, the first is band {bad[0] + 1}"
    hint = "Remove bbl from the header to use them"
    warnings.warn(PhotositeWarning(what, where=str(path), hint=hint), stacklevel=3)
    return np.asarray(bbl != 0)


def _units(path: Path, header: Mapping[str, Any], factor: float | None, options: ReadOptions) -> Units:
    stated = next((header[name] for name in _UNIT_FIELDS if name in header), None)
    if factor is None:
        return file_units(path, options, stated)
    own, text = Units("reflectance", 1 / factor), f"reflectance scale factor = {factor:g}"
    if options.units is None:
        units = own if stated is None else file_units(path, options, stated)
        return units if units.quantity != "reflectance" else own
    try:
        if stated is not None and (units := parse_units(str(stated)[:80])).quantity != "reflectance":
            own, text = units, str(stated)
    except InputError:  # unknown units cannot contradict
        pass
    return override_units(path, options.units, text, own)


def write(scene: Scene, path: Path, *, interleave: str = "bsq") -> None:
    """Write header and data (.img) of a scene's photon radiance at every sample, in single precision.

    The two files take their names one after the other; the header's digest tells whether the data are its own.
    """
    kind = next((kind for kind in _INTERLEAVES if kind == interleave), None)
    if kind is None:
        raise InputError("interleave", value=interleave, expected="'bsq', 'bil' or 'bip'")
    cube = cube_of_scene(scene)
    rows, cols, bands = cube.shape
    with atomic_path(path) as header, atomic_path(path.with_suffix(".img")) as numbers:
        with numbers.open("r+b") as file:
            for first, block in cube.blocks(max(1, _BLOCK_BYTES // (8 * cols * bands))):
                values = block.astype("<f4")
                if kind == "bsq":
                    for band in range(bands):
                        file.seek(4 * (band * rows + first) * cols)
                        file.write(np.ascontiguousarray(values[:, :, band]).data)
                else:
                    file.write(np.ascontiguousarray(values.transpose(0, 2, 1) if kind == "bil" else values).data)
        fields: dict[str, Any] = {
            "description": "{written by photosite}",
            "samples": cols,
            "lines": rows,
            "bands": bands,
            "header offset": 0,
            "file type": "ENVI Standard",
            "data type": 4,
            "interleave": kind,
            "byte order": 0,
            "wavelength units": "Nanometers",
            "wavelength": _written(cube.wavelength_nm),
            "data units": "photons/s/sr/m2/nm",
            "distance m": repr(float(scene.distance_m)),
            "data digest": _digest(numbers),
        }
        if scene.width_m is not None:
            fields["width m"] = repr(float(scene.width_m))
        if cube.light is not None:
            fields["light"] = _written(cube.light)
        header.write_text("ENVI\n" + "".join(f"{name} = {value}\n" for name, value in fields.items()), encoding="ascii")


def _written(values: Array) -> str:
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"
