"""Sensors with several captures of one exposure: each capture alone, and frames that combine them."""
