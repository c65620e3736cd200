"""Configurations, training runs, evaluations and ablations."""
