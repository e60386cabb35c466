"""One file an effect, beside the effect's section in `sensor/effects`: what a calibration shows of it."""
