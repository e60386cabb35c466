"""Quantum efficiency by wavelength, measured with bands of light and a photodiode, or with a chart."""
