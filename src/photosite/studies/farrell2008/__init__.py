"""The experiments of Farrell, Okincha and Parmar (2008): one file per chapter, and their pages in `page/`."""
