"""Checks of frame sets, levels and results."""
