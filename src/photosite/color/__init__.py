"""Spectra, illuminants, colour-matching functions, XYZ, Lab and colour difference."""
