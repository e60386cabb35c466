"""photosite."""
