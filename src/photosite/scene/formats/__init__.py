"""Scenes on disk: a file a format. `photosite.scene.files` is the door to all of them."""
