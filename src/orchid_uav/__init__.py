"""ORCHID."""
