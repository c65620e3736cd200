"""Flies methods over the same topologies, which no training has seen."""
