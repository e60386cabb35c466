"""The experiments of Farrell, Okincha and Parmar (2008): a file per chapter with its numbers, figures and summary."""
