"""From radiance to irradiance: lenses, wavefronts, tables and distortion."""
