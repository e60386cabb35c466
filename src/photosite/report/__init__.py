"""Results as figures, tables, HTML and PDF."""
