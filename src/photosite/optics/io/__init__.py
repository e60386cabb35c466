"""Optics files and the lens tables they name."""
