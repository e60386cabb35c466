"""Calibration of several gain settings, and the analysis of all settings together."""
