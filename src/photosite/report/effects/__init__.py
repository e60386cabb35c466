"""Figures and tables of effects in the report of a calibration: one file an effect."""
