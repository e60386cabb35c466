"""Whole experiments, each with its page."""
