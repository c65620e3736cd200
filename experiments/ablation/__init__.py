"""Variants of a run, trained on the same seeds and compared pair by pair."""
