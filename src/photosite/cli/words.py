"""Errors in the command line's words: `--units W/sr/m2/nm` where a function's caller is told units='W/sr/m2/nm'."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from photosite.errors import FileError, InputError, PhotositeError, PhotositeWarning

_OPTIONS = (
    (r"\bwavelength_nm=\[\.\.\.\]", "--wavelengths 400:700:10"),
    (r"\bothers than wavelength_nm\b", "others than --wavelengths"),
    (r"\b(units|illuminant)='([^']*)'", r"--\1 \2"),
    (r"\bmean_luminance_cd_m2=([\d.]+)", r"--luminance \1"),
    (r"\band mean_luminance_cd_m2(?![=\w])", "and --luminance"),
)
_READING = (
    (r"\bband_range_nm=\(([\d.]+), ([\d.]+)\)", r"--scene-option band_range_nm=[\1,\2]"),
    (r"\bpatch_cols=(\d+)", r"--scene-option patch_cols=\1"),
    (r"\bsort_bands=True", "--scene-option sort_bands=true"),
    (r"\b(no_data|negative)='zero'", r"--scene-option \1=zero"),
    (r"\binterleave='(\w+)'", r"--scene-option interleave=\1"),
    (r"\bvariable='\.\.\.'", "--scene-option variable=NAME"),
    (r"\bpatches=False", "--scene-option patches=false"),
    (r"\b(method|out_of_gamut)='([\w-]+)'", r"--scene-option \1=\2"),
)
_OWN = (
    (r"\bband_range_nm=\(([\d.]+), ([\d.]+)\)", r"--bands \1:\2"),
    (r"\bpatch_cols=(\d+)", r"--patch-cols \1"),
    (r"\bsort_bands=True", "--sort-bands"),
    (r"\bno_data='zero'", "--no-data zero"),
    (r"\bnegative='zero'", "--negative zero"),
    (r"\binterleave='(\w+)'", r"--interleave \1"),
    (r"\bvariable='\.\.\.'", "--variable NAME"),
    (r"\bmethod='([\w-]+)'", r"--method \1"),
    (r"\bout_of_gamut='clip'", "--out-of-gamut clip"),
)


def in_options(message: str, *, own: bool = False) -> str:
    """A message whose advice is options of a command.

    Parameters
    ----------
    message
        Of an error, in words of Python.
    own
        Whether the command has options of its own for how a file is read, as `convert` has; else they are given as
        `--scene-option NAME=VALUE`.

    Examples
    --------
    >>> in_options("holds reflectances; say the light (illuminant='D65', mean_luminance_cd_m2=100)")
    'holds reflectances; say the light (--illuminant D65, --luminance 100)'
    >>> in_options("say that they be sorted (sort_bands=True)"), in_options("(sort_bands=True)", own=True)
    ('say that they be sorted (--scene-option sort_bands=true)', '(--sort-bands)')
    """
    for pattern, said in (*_OPTIONS, *(_OWN if own else _READING)):
        message = re.sub(pattern, said, message)
    return message


@contextmanager
def told_in_options(*, own: bool = False) -> Iterator[None]:
    """Errors and warnings from inside advise the command's options (`in_options`)."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _translating(warnings.showwarning, own)
            yield
    except PhotositeError as error:
        if error.arguments or error.expected is not None or not isinstance(error, FileError | InputError):
            raise  # spelled by the command
        if isinstance(error, InputError):
            raise InputError(in_options(str(error), own=own)) from None
        raise FileError(error.path, in_options(error.format_content(), own=own), error.line) from None


def _translating(show: Callable[..., None], own: bool) -> Callable[..., None]:
    """What shows warnings, with photosite's in the command's words."""

    def shown(message: Warning | str, *place: Any, **more: Any) -> None:
        if isinstance(message, PhotositeWarning) and not message.arguments:
            message = PhotositeWarning(in_options(str(message), own=own))
        show(message, *place, **more)

    return shown
