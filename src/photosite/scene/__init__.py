"""Spectral radiance in front of the camera: scenes, charts, pictures and lights."""
