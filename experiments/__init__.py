"""Studies: configuration, run directory, training."""
