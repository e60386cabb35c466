"""Quantum efficiency by wavelength, from a monochromator or a chart."""
