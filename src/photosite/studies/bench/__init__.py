"""Timing and memory of photosite on this machine."""
