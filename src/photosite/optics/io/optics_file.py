"""Optics files: a lens in YAML.

photosite_optics: 1
name: my 50 mm
f_number: 2.8
focal_length_mm: 50
transmittance: 0.92                   # or {wavelength_nm: [...], transmittance: [...]}
falloff: cos4                         # or none; or instead of it:
relative_illumination: {field_deg: [0, 10, 20], relative: [1, 0.9, 0.7]}
focus_distance_m: 2                   # or .inf; without it, on every object
blur: {kind: wavefront, zernike: {8: 50}, unit: nm}
distortion: {field_deg: [0, 10, 20], percent: [0, -0.5, -2]}
lateral_color: {wavelength_nm: [450, 550, 650], magnification: [1.0003, 1, 0.9998]}
veiling_glare: {fraction: 0.02}
provenance: {source: ..., license: ...}

Names of files are relative to the optics file. docs/optics.md has all sections.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.yaml import line_of, read_yaml
from photosite.optics.blur_model import KINDS, MisplacedError
from photosite.optics.compound import Blur, Lens
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.io.file_model import OpticsModel, Transmittance
from photosite.optics.lens import DiffractionLimited

VERSION_KEY = "photosite_optics"
_NO_MAPPING = ("dict_type", "model_type", "model_attributes_type")
_Model = TypeVar("_Model", bound=BaseModel)
_Built = TypeVar("_Built")


def load_optics(path: str | PathLike[str]) -> Lens:
    """A lens from an optics file.

    Parameters
    ----------
    path
        A YAML file with the fields that this module's text shows; or the ISETPARMS.txt of a set that ISET's macros
        wrote with Zemax or CODE V (`photosite.optics.io.listings.ray_trace`), or its folder.

    Returns
    -------
    Lens
        With a base alone if the file says nothing more.

    Raises
    ------
    FileError
        If it is missing, is not YAML, or does not describe a lens, with the line; or if a file that it names is so.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "mine.optics.yaml")
    ...     _ = file.write_text("photosite_optics: 1\\nf_number: 2.8\\nfocal_lenght_mm: 50\\n")
    ...     load_optics(file)
    Traceback (most recent call last):
    photosite.errors.FileError: ...mine.optics.yaml:3: unknown field 'focal_lenght_mm'; did you mean 'focal_length_mm'?
    """
    from photosite.optics.io.listings.ray_trace import read_ray_trace, set_of

    file = Path(path)
    if (parameters := set_of(file)) is not None:
        return read_ray_trace(parameters).lens()
    data = read_yaml(file, "an optics file")
    if not isinstance(data, dict) or data.get(VERSION_KEY) != 1:
        line = line_of(data, VERSION_KEY)
        raise FileError(file, f"does not describe a lens: expected '{VERSION_KEY}: 1' and the lens's fields", line)
    found = parse_optics(data, file)
    return found if isinstance(found, Lens) else Lens(found)


def parse_optics(data: Mapping[str, Any], path: str | PathLike[str], section: str = "") -> Lens | DiffractionLimited:
    """A lens from the fields of an optics file.

    Parameters
    ----------
    data
        The fields, as `photosite.files.yaml` reads them.
    path
        The file they stand in, for messages; names of other files are relative to it.
    section
        Of that file, where they do not stand at its top.

    Returns
    -------
    Lens or DiffractionLimited
        The second if nothing is said that it cannot hold: options of `photosite simulate` may then change it.

    Raises
    ------
    FileError
        As `load_optics`.
    """
    reader = _Reader(Path(path), data, section)
    model = reader.validated(OpticsModel, data, ())
    base = reader.built(  # the model has checked the other fields
        "transmittance",
        lambda: DiffractionLimited(model.f_number, model.focal_length_mm, model.transmittance.build(), model.falloff),
    )
    folder = reader.path.parent
    blur = reader.blur() if model.blur is not None else None
    illumination = distortion = lateral = glare = None
    if (told := model.relative_illumination) is not None:
        illumination = reader.built("relative_illumination", lambda: told.build(folder))
    if (curve := model.distortion) is not None:
        distortion, lateral = reader.built("distortion", lambda: curve.build(folder, model.focal_length_mm))
    if (color := model.lateral_color) is not None:
        if lateral is not None:
            raise reader.error("the listing of distortion holds it already; leave out one of them", ("lateral_color",))
        lateral = reader.built("lateral_color", color.build)
    if (veil := model.veiling_glare) is not None:
        glare = reader.built("veiling_glare", veil.build)
    reader.check_mapping(distortion, lateral, model)
    lens = reader.built(
        "falloff" if illumination is not None and model.falloff != "none" else "focus_distance_m",
        lambda: Lens(base, blur, model.focus_distance_m, illumination, distortion, lateral, glare, model.name),
    )
    more = (blur, model.focus_distance_m, illumination, distortion, lateral, glare, model.name)
    return base if all(part is None for part in more) else lens


class _Reader:
    """A mapping of a file, and what to say where it is wrong."""

    def __init__(self, path: Path, data: Mapping[str, Any], section: str) -> None:
        self.path = path
        self.data = data
        self.section = section

    def error(self, message: str, location: Sequence[str | int]) -> FileError:
        """The error, with the line of the deepest part of the location that the file has."""
        node: Any = self.data
        position = getattr(getattr(node, "lc", None), "line", None)
        line = None if position is None or not self.section else position + 1
        for part in location:
            if (found := line_of(node, part)) is None:
                break
            line, node = found, node[part]
        place = ".".join(part for part in (self.section, *map(str, location)) if part)
        return FileError(self.path, f"{place}: {message}" if place else message, line)

    def validated(self, model: type[_Model], data: Any, above: tuple[str, ...]) -> _Model:
        """The model of a mapping."""
        try:
            return model.model_validate(data)
        except ValidationError as error:
            found = error.errors()
            # A misspelt field is also a missing one; the misspelling is what helps.
            first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
        *parents, last = (*above, *first["loc"]) or ("",)
        match first["type"]:
            case "extra_forbidden":
                known = _home(model, first["loc"][:-1]).model_fields
                line = self.error("", (*parents, last)).line
                place = ".".join(part for part in (self.section, *map(str, parents)) if part)
                message = f"unknown field '{last}'; {did_you_mean(str(last), known)}"
                raise FileError(self.path, f"{place}: {message}" if place else message, line)
            case "missing":
                raise self.error(f"field '{last}' is missing", parents)
        if first["type"] in _NO_MAPPING:
            expected = _expected(model, first["loc"])
            raise self.error(f"expected {expected}, not {first['input']!r:.40}", (*parents, last))
        message = str(first["msg"]).removeprefix("Value error, ").replace("Input should be", "expected", 1)
        message = message.replace("a valid tuple", "a list, [...]")
        value = first["input"]
        came = f", not {value!r:.40}" if isinstance(value, str | int | float | bool) else ""
        raise self.error(message + came if first["type"] != "value_error" else message, (*parents, last))

    def built(self, key: str, build: Callable[[], _Built]) -> _Built:
        """What a section becomes; what it cannot be is said with its line."""
        try:
            return build()
        except FileError as error:
            if os.path.exists(error.path):  # False for a name that no file can have
                raise
            named = [part for part in ("file", "source") if part in self.data[key]]
            raise self.error(f"there is no such file, {error.path}", (key, *named)) from None
        except OSError as error:  # a name that no file can have
            raise self.error(f"cannot be read: {error.strerror or error}", (key,)) from None
        except InputError as error:
            inside = error.location if isinstance(error, MisplacedError) else ()
            raise self.error(str(error), (key, *inside) if key in self.data else ()) from None
        except ValueError as error:
            raise self.error(str(error), (key,)) from None

    def blur(self) -> Blur | None:
        """The section `blur`, by its kind."""
        told = self.data["blur"]
        kind = told.get("kind")
        if not isinstance(kind, str) or kind not in KINDS:
            what = "field 'kind' is missing" if kind is None else f"there is no kind '{kind!s:.40}'"
            raise self.error(
                f"{what}; {did_you_mean(str(kind), KINDS)}", ("blur",) if kind is None else ("blur", "kind")
            )
        model: Any = self.validated(KINDS[kind], told, ("blur",))
        blur: Blur | None = self.built("blur", lambda: model.build(self.path.parent))
        return blur

    def check_mapping(self, distortion: Distortion | None, lateral: LateralColor | None, model: OpticsModel) -> None:
        """Refuse tables that together fold back, now rather than when a frame is made."""
        from photosite.optics.distortion import combined_mapping

        key = "lateral_color" if model.lateral_color is not None else "distortion"
        self.built(key, lambda: combined_mapping(distortion, lateral, model.focal_length_mm * 1e-3))


def _expected(model: type[BaseModel], location: Sequence[str | int]) -> str:
    """What a section is, for who wrote something else."""
    if tuple(location) == ("blur",):
        return f"{{kind: {' | '.join(KINDS)}, ...}}"
    home = _home(model, location)
    if location and (said := home.model_fields.get(str(location[-1]))) is not None and said.description is not None:
        return said.description
    number = "a number or " if home is Transmittance else ""
    return f"{number}{{{', '.join(home.model_fields)}}}"


def _home(model: type[BaseModel], location: Sequence[str | int]) -> type[BaseModel]:
    """The model of the mapping at a location."""
    for part in location:
        if not isinstance(part, str) or part not in model.model_fields:
            break
        annotation = model.model_fields[part].annotation
        inner = [a for a in (annotation, *getattr(annotation, "__args__", ())) if isinstance(a, type)]
        model = next((a for a in inner if issubclass(a, BaseModel)), model)
    return model
