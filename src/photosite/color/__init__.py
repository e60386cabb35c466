"""Spectra, illuminants, colour-matching functions, XYZ, Lab, sRGB and colour difference."""
