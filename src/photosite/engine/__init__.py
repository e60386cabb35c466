"""The hot loops, and nothing else: random numbers, pixel kernels, spectral transforms, accumulators.

It knows arrays, not sensors or scenes.
"""
