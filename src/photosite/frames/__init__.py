"""Raw frames and sets of raw frames: reading, writing, and the settings they were taken under."""
