"""Pages and figures of the chapters."""
