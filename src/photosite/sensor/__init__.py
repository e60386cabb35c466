"""The sensor: its description, presets, optical stack, chip and readout."""
