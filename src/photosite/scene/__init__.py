"""Spectral radiance in front of the camera: scenes, charts, pictures and lights."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
