"""Scene files, one module a format."""
