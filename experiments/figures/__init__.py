"""Drawings of evaluations and of training runs."""
