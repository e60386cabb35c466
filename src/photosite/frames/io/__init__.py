"""Frames on disk: one file for each format, for protocols and for noise profiles.

Readers raise `FileError` for files that are missing, truncated, damaged or of another kind, with the line where known.
Writers raise `InputError` for what a format cannot hold.
"""
