"""The camera, a lens in front of a sensor: mean image, captures, sequences, and the camera file."""
