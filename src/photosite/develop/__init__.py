"""From a raw frame to a picture: demosaic, white balance, colour matrix, display encoding."""
