"""Scene files, one module a format, and what formats share: units, color spaces, patch tables."""
