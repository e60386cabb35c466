"""From a raw frame to a picture: demosaic, white balance, color matrix, display encoding."""
