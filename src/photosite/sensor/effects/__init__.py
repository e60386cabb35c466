"""Effects of real sensors beyond the pixel model: a file for each, with its section of the sensor file."""
