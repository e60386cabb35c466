"""Sensor files and the maps of measured chips on disk."""
