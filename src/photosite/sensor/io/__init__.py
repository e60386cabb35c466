"""Sensor files and the maps beside them."""
