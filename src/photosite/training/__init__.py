"""Training data: pairs of clean and noisy raw frames as map-style datasets."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
