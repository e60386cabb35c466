"""Measurements weighted by human vision at a viewing condition: visible noise, color differences, sharpness."""
