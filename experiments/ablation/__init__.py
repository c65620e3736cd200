"""Trains variants of a run on the same seeds and compares them seed by seed."""
