"""From a raw frame to a picture."""
