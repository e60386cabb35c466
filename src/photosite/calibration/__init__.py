"""Calibration: from dark frames and flat fields to sensor parameters with uncertainties."""
