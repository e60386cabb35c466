"""Closed loop: measure a virtual sensor, simulate it from the result, and compare with the truth."""
