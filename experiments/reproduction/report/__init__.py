"""The page that says what came out of a reproduction."""
