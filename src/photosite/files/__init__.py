"""Helpers for disk: atomic writing, YAML with line numbers, size limits, reading untrusted files."""
