"""Small immutable values that all stages share: measured values, uncertainty propagation, CFA, region, exposure time."""
