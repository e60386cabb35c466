"""Measurements of even fields: shading of luminance and color, defective pixels."""
