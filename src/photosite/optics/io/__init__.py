"""Files of optics, one module per kind of file; `formats` lists all formats."""
