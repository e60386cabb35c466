"""Tone and noise: opto-electronic conversion function, signal-to-noise ratios, dynamic range, speed."""
