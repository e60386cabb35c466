"""Maps of one chip: offset, response, dark rate, read noise, defects and temporal noise."""
