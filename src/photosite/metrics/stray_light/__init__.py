"""Measurements of stray light: flare in light traps."""
