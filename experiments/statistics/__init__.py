"""Intervals, comparisons, and learning curves over several runs."""
