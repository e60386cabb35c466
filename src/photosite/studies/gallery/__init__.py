"""Pictures of what scenes, lenses and sensors do."""
