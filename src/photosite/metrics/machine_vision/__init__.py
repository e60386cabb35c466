"""Machine vision: detection of contrasts, and information in frames."""
