"""Figures of evaluations and of training runs."""
