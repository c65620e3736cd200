"""Measurements of speed and memory; speeds are compared as ratios within one run."""
