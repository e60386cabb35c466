"""Photon transfer method of EMVA 1288: levels, saturation, gain, linearity and signal-to-noise ratio."""
