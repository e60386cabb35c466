"""Color: differences from the colors of a chart, white balance, and spectral sensitivities."""
