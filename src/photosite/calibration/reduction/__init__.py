"""Frames reduced to sums and levels."""
