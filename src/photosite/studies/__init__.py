"""Whole experiments on virtual cameras, each in a folder with its page, and the virtual laboratory they share."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
