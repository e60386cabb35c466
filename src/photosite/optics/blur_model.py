"""The section `blur` of an optics file: which kinds there are, and what each becomes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.optics.compound import Blur
from photosite.optics.io.file_model import Number, PositiveNumber, Section
from photosite.optics.lens import camera_wavelengths
from photosite.optics.pupil import Pupil


class MisplacedError(InputError):
    """What is wrong, and where in its section it stands."""

    def __init__(self, message: str, *location: str | int) -> None:
        super().__init__(message)
        self.location = location


@contextmanager
def _at(*location: str | int) -> Iterator[None]:
    """Say where in the section something cannot be."""
    try:
        yield
    except ValueError as error:
        raise MisplacedError(str(error), *location) from None


class Diffraction(Section):
    """A perfect lens; defocus if it is focused elsewhere."""

    kind: Literal["diffraction"]

    def build(self, folder: Path) -> Blur | None:
        """None."""
        return None


class PupilSection(Section):
    """The opening, see `photosite.optics.pupil.Pupil`."""

    obscuration: Number = 0.0
    blades: Annotated[int, Field(strict=True)] = 0
    rotation_deg: Number = 0.0
    roundness: Number = 0.0
    vanes: Annotated[int, Field(strict=True)] = 0
    vane_width: Number = 0.0
    vane_rotation_deg: Number = 0.0
    amplitude: str | None = None

    def build(self, folder: Path) -> Pupil:
        """The opening; an array of its own from an .npz file."""
        from photosite.optics.io.npz import read_amplitude

        array = None if self.amplitude is None else read_amplitude(folder / self.amplitude)
        return Pupil(**self.model_dump(exclude={"amplitude"}), amplitude=array)


class ChromaticFocus(Section):
    """Where each wavelength comes to focus, um behind the sensor."""

    wavelength_nm: tuple[PositiveNumber, ...]
    shift_um: tuple[Number, ...]

    def build(self) -> Spectrum:
        """The table."""
        return Spectrum(camera_wavelengths(self.wavelength_nm), np.array(self.shift_um))


class WavefrontSection(Section):
    """Zernike coefficients and pupil, see `photosite.optics.wavefront.Wavefront`."""

    kind: Literal["wavefront"]
    zernike: dict[int | str, Number] = Field(default_factory=dict, description="{8: 50, 11: -20}, term: value")
    index: Literal["noll", "fringe", "nm"] = "noll"
    unit: Literal["nm", "waves"] = "nm"
    reference_nm: PositiveNumber | None = None
    norm: Literal["rms", "peak"] | None = None
    pupil: PupilSection = PupilSection()
    defocus_um: Number = 0.0
    chromatic_focus: ChromaticFocus | None = None

    @field_validator("zernike", mode="before")
    @classmethod
    def _terms(cls, raw: Any) -> Any:
        for key, value in raw.items() if isinstance(raw, Mapping) else ():
            if not isinstance(key, int | str) or value is None:
                raise ValueError(f"{key} is no term with a value; one of index nm is {_PAIR}")
        return raw

    def build(self, folder: Path) -> Blur:
        """The wavefront."""
        from photosite.optics.wavefront import Wavefront
        from photosite.optics.zernike import zernike_terms

        coefficients: dict[Any, float] = {}
        for key, value in self.zernike.items():
            with _at("zernike", key):
                term = _term(key, self.index)
                zernike_terms({term: value}, self.index, self.norm)
                coefficients[term] = value
        with _at("pupil"):
            pupil = self.pupil.build(folder)
        with _at("chromatic_focus"):
            focus = self.chromatic_focus
            shifts = None if focus is None else focus.build()
        return Wavefront(
            coefficients=coefficients,
            index=self.index,
            unit=self.unit,
            reference_nm=self.reference_nm,
            norm=self.norm,
            pupil=pupil,
            defocus_um=self.defocus_um,
            chromatic_focus=shifts,
        )


_PAIR = 'n and m, written in quotes, "3,-1": 40'


def _term(key: int | str, index: str) -> Any:
    """The key of a coefficient: a number, or "n,m"."""
    if index != "nm":
        if isinstance(key, int):
            return key
        raise ValueError(f"a Zernike term of index {index} is a number from 1, not '{key}'")
    parts = str(key).split(",")
    try:
        n, m = (int(part) for part in parts)
    except ValueError:
        raise ValueError(f"a Zernike term of index nm is {_PAIR}, not '{key}'") from None
    return n, m


class OtfSection(Section):
    """Transfer functions per wavelength, see `photosite.optics.io.table_files.read_otf_table`."""

    kind: Literal["otf"]
    file: str
    beyond: Literal["zero", "diffraction"] = "zero"

    def build(self, folder: Path) -> Blur:
        """The table."""
        from photosite.optics.io.table_files import read_otf_table

        return read_otf_table(folder / self.file, self.beyond)


class PsfSection(Section):
    """Point spreads per wavelength, see `photosite.optics.io.table_files.read_psf_table`."""

    kind: Literal["psf"]
    file: str
    spacing_um: PositiveNumber | None = None
    wavelength_nm: tuple[PositiveNumber, ...] | None = None
    normalise: Annotated[bool, Field(strict=True)] = False

    def build(self, folder: Path) -> Blur:
        """The table."""
        from photosite.optics.io.table_files import read_psf_table

        return read_psf_table(
            folder / self.file,
            spacing_um=self.spacing_um,
            wavelength_nm=self.wavelength_nm,
            normalise=self.normalise,
        )


class LensDesignSection(Section):
    """Point spreads over the field: `photosite.optics.io.listings.design_files.read_lens_design`, or arrays as
    written."""

    kind: Literal["lens_design"]
    source: str
    tolerance: PositiveNumber | None = None
    rank: Annotated[int, Field(strict=True, ge=1)] | None = None
    detail_um: PositiveNumber | None = None
    nodes: Annotated[int, Field(strict=True, ge=3)] | None = None
    symmetric: Annotated[bool, Field(strict=True)] | None = None
    first_row: Literal["top", "bottom"] | None = None

    def build(self, folder: Path) -> Blur:
        """The design."""
        from photosite.optics.io.listings.design_files import read_lens_design
        from photosite.optics.io.npz import read_design

        options = self.model_dump(exclude={"kind", "source"}, exclude_none=True)
        if self.source.lower().endswith(".npz"):
            return read_design(folder / self.source, **options)
        return read_lens_design(folder / self.source, **options)


KINDS: dict[str, type[Section]] = {
    "diffraction": Diffraction,
    "wavefront": WavefrontSection,
    "otf": OtfSection,
    "psf": PsfSection,
    "lens_design": LensDesignSection,
}
