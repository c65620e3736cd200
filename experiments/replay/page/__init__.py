"""The page of a replay: one HTML file that opens from disk and loads nothing."""
