"""Flat fields: their levels and channels, flicker of the light, and polarizers in front of it."""
