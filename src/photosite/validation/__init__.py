"""Measured frames against simulated frames."""
