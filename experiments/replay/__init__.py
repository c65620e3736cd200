"""Flights that one can watch: recorded slot by slot, as a page, as pictures, as an animation."""
