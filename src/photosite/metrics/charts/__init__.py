"""Charts in frames: where they lie, what their patches reflect, and their detection."""
