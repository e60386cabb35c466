"""Whole experiments on virtual cameras, each in a folder with its page, and the virtual laboratory they share."""
