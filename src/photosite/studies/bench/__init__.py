"""Benchmarks: time and memory of photosite on this machine, beside plain ways to do the same work."""
