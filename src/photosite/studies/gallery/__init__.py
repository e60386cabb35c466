"""The gallery: pictures of what scenes, lenses and sensors do, each made anew by `photosite reproduce gallery`."""
