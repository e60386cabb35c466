"""Checks of frames and of results before they are used."""
