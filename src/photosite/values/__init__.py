"""Small immutable values that all stages share: measured value, uncertainty, CFA, region, exposure time."""
