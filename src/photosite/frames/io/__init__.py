"""Frames on disk: one file for each format, for protocols and for noise profiles."""
