"""Sharpness: spatial frequency responses of edges, stars and textures."""
