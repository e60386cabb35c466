"""Measurements of geometry: distortion and lateral color of the lens, from the dots of a chart."""
