"""Several gain settings of one camera."""
