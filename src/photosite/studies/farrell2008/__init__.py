"""The experiments of Farrell, Okincha and Parmar (2008)."""
