"""The library of cameras: noise profiles, spectral sensitivities and contributed measurements, found by name."""
