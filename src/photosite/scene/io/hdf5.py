"""HDF5: photosite's own scenes, cubes in datasets, and MATLAB's version 7.3, which is HDF5 too.

A cube is a dataset of three axes. Attributes (of the dataset, of a group above it, or of the file, the nearest counts)
or datasets beside it say the rest:

    wavelength_nm       (bands,), or wavelength / wavelengths / wave / bands with wavelength_units
    units               of the values; see `photosite.scene.units`
    interleave          "bip" (rows, cols, bands), "bsq" (bands, rows, cols), "bil" (rows, bands, cols); where it is
                        missing, "bip", unless the number of wavelengths fits another axis: then it must be said
    scale               times a value gives these units
    no_data             the value that stands for none
    distance_m, width_m of the scene
    light               (bands,) photons/s/sr/m2/nm from a perfect white
"""

from __future__ import annotations

from pathlib import Path

from photosite.scene.cube import SpectralCube
from photosite.scene.io.hdf5_file import opened
from photosite.scene.io.native import VERSION_KEY, read_native, write_native
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene


def open_cube(path: Path, said: ReadOptions) -> SpectralCube | Scene:
    """The cube, or the scene, in an HDF5 file.

    Raises
    ------
    FileError
        If it holds neither, or what it says cannot be.
    """
    with opened(path) as (file, datasets):
        if VERSION_KEY in file.attrs:
            return read_native(path, file, datasets, said)
        from photosite.scene.io.hdf5_cube import cube_in

        return cube_in(path, file, datasets, said)


def write(scene: Scene, path: Path, *, cube: bool = False) -> None:
    """photosite's own file, or a plain cube of photon radiance.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    if not cube:
        write_native(scene, path)
        return
    from photosite.scene.io.hdf5_cube import write_cube

    write_cube(scene, path)
