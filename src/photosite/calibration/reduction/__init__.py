"""Reduction of frames to statistics of groups: reading, exact sums, checkpoints and provenance."""
