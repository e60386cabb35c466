"""Signal-to-noise ratio, sharpness and patches of raw frames."""
