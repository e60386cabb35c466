"""Scene, lens and sensor joined: mean image, captures, sequences and the camera file."""
