"""From frames to a sensor's parameters, each with its uncertainty."""
