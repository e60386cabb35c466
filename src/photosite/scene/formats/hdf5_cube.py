"""Cubes in HDF5 files."""
