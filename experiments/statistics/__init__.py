"""Intervals, comparisons and the curves of several runs."""
