"""Numeric kernels on plain arrays: random numbers, pixel model, transforms, accumulators; no scenes, no sensors."""
