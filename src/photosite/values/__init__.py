"""Small immutable values shared by all stages: measured values, uncertainty propagation, CFA, region, exposure time."""
