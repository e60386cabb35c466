"""The pages and figures of the 2008 paper."""
