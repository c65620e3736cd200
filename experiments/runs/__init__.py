"""The directory of a run: its records, lock, index, filters, removal and archive."""
