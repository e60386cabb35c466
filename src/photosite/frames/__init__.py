"""Raw frames and sets of raw frames."""
