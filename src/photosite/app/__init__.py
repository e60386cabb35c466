"""The workbench: a page in the browser, served on this machine, that calls the same functions as the commands."""
