"""Measurements of motion: rolling shutters, blur, and the timing of frames."""
