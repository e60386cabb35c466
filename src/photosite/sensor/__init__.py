"""The sensor's description and its chip: model, presets, optical stack, readout."""
