"""Ways to the stations and back, and the files that crews load."""
