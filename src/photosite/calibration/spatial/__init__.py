"""Spatial nonuniformity: row, column and pixel parts, per-pixel slopes, and the pattern of a mean frame."""
