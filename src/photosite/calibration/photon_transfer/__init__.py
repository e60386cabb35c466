"""Photon transfer, linearity and signal-to-noise ratio."""
