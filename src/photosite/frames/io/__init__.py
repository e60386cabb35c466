"""Raw frame files, one module a format."""
