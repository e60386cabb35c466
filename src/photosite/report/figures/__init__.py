"""Figures of results, one module a figure."""
