"""Dark frames that are clipped at 0."""
