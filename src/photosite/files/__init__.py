"""Helpers for disk: atomic writing, YAML with line numbers, size limits, untrusted files read in a child process."""
