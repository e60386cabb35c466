"""Figures of results, as matplotlib `Figure` objects."""
