"""Released policies with their full records: one run directory for each key."""
