"""Helpers for disk: atomic writing, YAML with line numbers, size limits, untrusted files read in a child process.

Readers raise `FileError` for files that are missing, truncated, damaged or of another kind, with the line where known.
"""
