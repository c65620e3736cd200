"""Where UAVs begin, beyond the Phase I of the paper."""
