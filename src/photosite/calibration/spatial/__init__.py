"""Spatial nonuniformity: DSNU, PRNU, row and column parts, profiles and spectrograms."""
