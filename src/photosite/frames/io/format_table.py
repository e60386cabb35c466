"""All file formats of raw frames in one table, which readers, writers, commands and the workbench use.

To add a format: write a module in `photosite.frames.io` and add an entry to `FORMATS`. The module has
`read_headers(path)` and either `read_pixels(path, location)`, for pixels that the headers describe, or
`read_frame(path, bits, cfa)`, which returns a frame with notes for warnings. The other functions are optional:

- `recognizes(path, head)`: whether a file with these first bytes has the format, if signatures do not suffice;
- `write(frame, path)`, and `check_cfa(cfa)`, which rejects color filter arrays that it cannot hold;
- `open_rows(path, location, bits, cfa)`: the frame as `StoredRows`, or None;
- `read_whole(path, location)`: the digital numbers with the border that a header states;
- `read_bordered(path, bits, cfa)`: the frame and notes of `read_frame`, and the means of the lines of its border;
- `overscan_levels(path, location)`: the levels of the overscan that a header states, by amplifier, and
  `read_pixels(path, location, levels, most)`, which shifts the numbers to such levels.

Each raises `FileError` for a file that it cannot read. docs/development/contributing.md lists tests and documentation.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

HEAD_BYTES = 16

_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_FITS = (".fits", ".fit", ".fts", *(f".{kind}.{packed}" for kind in ("fits", "fit", "fts") for packed in ("gz", "fz")))
_CAMERAS = "3fr arw cr2 cr3 crw dcr erf fff iiq kdc mef mos mrw nef nrw orf pef raf rw2 rwl sr2 srf srw x3f"


@dataclass(frozen=True)
class Format:
    """A file format.

    Parameters
    ----------
    name, suffixes, module
        Its name in messages, the suffixes of its files in lower case, and its module in `photosite.frames.io`.
    signatures
        First bytes of its files; none where only `recognizes` of the module tells.
    writes
        Suffixes of the files that frames can be written to.
    most_bits
        Largest bit depth of a file that is written.
    by_suffix
        Whether a file with one of the suffixes and unknown first bytes has the format.
    """

    name: str
    suffixes: tuple[str, ...]
    module: str
    signatures: tuple[bytes, ...] = ()
    writes: tuple[str, ...] = ()
    most_bits: int = 16
    by_suffix: bool = False

    def load(self) -> ModuleType:
        """Import and return its module."""
        return importlib.import_module(f"photosite.frames.io.{self.module}")

    def recognizes(self, path: Path, head: bytes) -> bool:
        """Return whether a file with these first bytes has the format."""
        if self.signatures and not head.startswith(self.signatures):
            return False
        recognizes = getattr(self.load(), "recognizes", None)
        return recognizes is None or recognizes(path, head)


CAMERA_RAW = Format("camera raw", tuple(f".{suffix}" for suffix in _CAMERAS.split()), "camera_raw", by_suffix=True)
TIFF = Format("TIFF", (".tif", ".tiff"), "tiff", _TIFF, writes=(".tif", ".tiff"), most_bits=32)

FORMATS = (
    CAMERA_RAW,
    Format("DNG", (".dng",), "dng", _TIFF, writes=(".dng",)),
    TIFF,
    Format("PNG", (".png",), "png", (b"\x89PNG\r\n\x1a\n",), writes=(".png",)),
    Format("HDF5", (".h5", ".hdf5", ".hdf"), "hdf5", (b"\x89HDF\r\n\x1a\n",), writes=(".h5", ".hdf5"), most_bits=32),
    Format("FITS", _FITS, "fits", (b"SIMPLE  =", b"\x1f\x8b"), writes=(".fits", ".fit"), most_bits=32),
    Format("Raspberry Pi's JPEG with raw data", (), "raspberry_pi", (b"\xff\xd8\xff",)),
)
"""The formats, in the order in which a file is compared with them."""

_BY_SUFFIX = [format.name for format in FORMATS if format.suffixes]
NAMES = f"{', '.join(_BY_SUFFIX[:-1])} or {_BY_SUFFIX[-1]}"

SUFFIXES = frozenset(suffix for format in FORMATS for suffix in format.suffixes)
"""Suffixes of files that are taken for frames."""


def is_frame_name(path: Path) -> bool:
    """Return whether the name of a file ends in one of `SUFFIXES`."""
    return path.name.lower().endswith(_ENDS)


_ENDS = tuple(SUFFIXES)


def frame_stem(path: Path) -> str:
    """Return the name of a file without its suffix, also of compressed FITS.

    Examples
    --------
    >>> frame_stem(Path("dark_07.fits.gz")), frame_stem(Path("a.b.png"))
    ('dark_07', 'a.b')
    """
    return Path(path.stem).stem if path.suffix.lower() in (".gz", ".fz") else path.stem


OME_SUFFIXES = (".ome.tif", ".ome.tiff")
"""Ends of the names of TIFF files that are written with OME-XML (`write_ome` of the module)."""

WRITTEN_SUFFIXES = tuple(suffix for format in FORMATS for suffix in format.writes)

DEEP_SUFFIXES = tuple(suffix for format in FORMATS for suffix in format.writes if format.most_bits > 16)
"""Suffixes of files that hold more than 16 bits, and noise-free mosaics."""


def format_to_write(suffix: str) -> Format | None:
    """Return the format of files to write with a suffix."""
    return next((format for format in FORMATS if suffix.lower() in format.writes), None)
