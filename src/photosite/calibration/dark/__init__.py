"""Dark frames: level, noise and fixed pattern, also of clipped or single frames, and their change with temperature."""
