"""Measures of raw frames: noise budget, sharpness, and the statistics of patches."""
