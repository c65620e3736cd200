"""What the documentation reports: evaluations, ablations, tuning, and their pages."""
