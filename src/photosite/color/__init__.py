"""Spectra, illuminants, color-matching functions, XYZ, Lab, sRGB and color difference."""
