"""A virtual sensor measured, calibrated and compared with its truth."""
